//! The perception model (paper, section 4) and the absolute likelihood that goes past it.

pub mod bend;
pub mod ceiling;
pub mod gamma;
mod held;
pub mod likelihood;
pub mod noise;
pub mod overlay;
pub mod placed;
pub mod pool;
pub mod psi;
pub mod pull;
pub mod rigid;

pub use likelihood::WallEvidence;
pub use overlay::{Layer, Overlay};
