//! Weights as logarithms.

/// The natural logarithm of a weight; minus infinity is a weight of zero.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct LogWeight(pub f64);

impl LogWeight {
    /// The weight zero.
    pub const ZERO: LogWeight = LogWeight(f64::NEG_INFINITY);
    /// The weight one.
    pub const ONE: LogWeight = LogWeight(0.0);

    /// True for the weight zero.
    pub fn is_zero(self) -> bool {
        self.0 == f64::NEG_INFINITY
    }
}

impl std::ops::Mul for LogWeight {
    type Output = LogWeight;
    // The product of weights is the sum of their logarithms.
    #[allow(clippy::suspicious_arithmetic_impl)]
    fn mul(self, other: LogWeight) -> LogWeight {
        LogWeight(self.0 + other.0)
    }
}

/// Log of the sum of weights, shifted by their maximum so that nothing overflows.
pub fn log_sum(weights: impl Iterator<Item = LogWeight> + Clone) -> LogWeight {
    let max = weights.clone().map(|w| w.0).fold(f64::NEG_INFINITY, f64::max);
    if max == f64::NEG_INFINITY {
        return LogWeight::ZERO;
    }
    LogWeight(max + weights.map(|w| (w.0 - max).exp()).sum::<f64>().ln())
}

/// Linear weights that sum to one; uniform when all are zero.
pub fn normalise(weights: &[LogWeight]) -> Vec<f64> {
    let total = log_sum(weights.iter().copied());
    if total.is_zero() {
        return vec![1.0 / weights.len() as f64; weights.len()];
    }
    weights.iter().map(|w| (w.0 - total.0).exp()).collect()
}

/// N_eff = 1 / sum w^2 of normalised weights: from 1 (one particle has it all) to their number.
pub fn effective_sample_size(normalised: &[f64]) -> f64 {
    1.0 / normalised.iter().map(|w| w * w).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_far_below_underflow() {
        let w = [LogWeight(-5000.0), LogWeight(-5000.0 + 3f64.ln()), LogWeight::ZERO];
        assert!((log_sum(w.iter().copied()).0 - (-5000.0 + 4f64.ln())).abs() < 1e-9);
        let n = normalise(&w);
        assert!((n[0] - 0.25).abs() < 1e-12 && (n[1] - 0.75).abs() < 1e-12 && n[2] == 0.0);
        assert!((effective_sample_size(&n) - 1.6).abs() < 1e-9);
        assert_eq!(normalise(&[LogWeight::ZERO; 4]), [0.25; 4]);
        assert!(log_sum(std::iter::empty()).is_zero());
    }
}
