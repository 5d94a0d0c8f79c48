//! gamma: how little unlike classes fall on each other (paper, section 4).
//!
//! `gamma = -D`, where D sums the same kernel as Psi across different classes: free against
//! occupied. The paper says that gamma's magnitude grows with the inconsistency and multiplies it
//! with Psi; the negative sign is the one reading under which both hold.

use crate::grid::Class;
use crate::perception::psi::Comparison;

/// gamma of a comparison, zero or negative.
pub fn gamma(comparison: &Comparison) -> f64 {
    -(comparison.kernel_sum(Class::Occupied, Class::Free)
        + comparison.kernel_sum(Class::Free, Class::Occupied))
}
