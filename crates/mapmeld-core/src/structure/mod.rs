//! What a map shows: straight walls, and the corners where they meet (paper, section 5).

pub mod corners;
pub mod lines;

pub use corners::Corner;
pub use lines::Line;
