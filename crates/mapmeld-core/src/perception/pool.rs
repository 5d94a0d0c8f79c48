//! Normalisation of Psi and gamma over the pool of candidate poses (paper, section 4).
//!
//! `Psi~_j = Psi_j / sum Psi`, `gamma~_j = (gamma_j - min gamma) / sum (gamma_k - min gamma)`, and the
//! likelihood of pose j is their product, normalised. Degenerate pools are defined: one pose has
//! gamma~ = 1; all gamma equal or all Psi zero is uniform; the worst pose keeps a small floor, since
//! with two poses it would be winner takes all.

/// Normalised terms of a pool of poses; each vector has one entry a pose and sums to one.
#[derive(Debug, Clone, PartialEq)]
pub struct Normalised {
    /// Psi~.
    pub psi: Vec<f64>,
    /// gamma~.
    pub gamma: Vec<f64>,
    /// Psi~ * gamma~, normalised.
    pub product: Vec<f64>,
}

/// Normalises a pool. `floor` is the worst pose's gamma before normalisation, as a share of the
/// range of gamma. Empty in, empty out.
pub fn normalise(psi: &[f64], gamma: &[f64], floor: f64) -> Normalised {
    assert_eq!(psi.len(), gamma.len(), "one Psi and one gamma a pose");
    let lowest = gamma.iter().copied().fold(f64::INFINITY, f64::min);
    let highest = gamma.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let least = floor * (highest - lowest);
    let above: Vec<f64> = gamma.iter().map(|g| (g - lowest).max(least)).collect();
    let psi = shares(psi);
    let gamma = shares(&above);
    let product = shares(&psi.iter().zip(&gamma).map(|(p, g)| p * g).collect::<Vec<_>>());
    Normalised { psi, gamma, product }
}

/// The values divided by their sum; uniform when the sum is zero.
fn shares(values: &[f64]) -> Vec<f64> {
    let sum: f64 = values.iter().sum();
    if sum > 0.0 {
        values.iter().map(|v| v / sum).collect()
    } else {
        vec![1.0 / values.len() as f64; values.len()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_printed_without_a_floor() {
        let n = normalise(&[1.0, 3.0, 4.0], &[-5.0, -1.0, -3.0], 0.0);
        assert_eq!(n.psi, [0.125, 0.375, 0.5]);
        assert_eq!(n.gamma, [0.0, 4.0 / 6.0, 2.0 / 6.0]);
        let total = 0.375 * 4.0 + 0.5 * 2.0;
        assert_eq!(n.product[0], 0.0);
        assert!((n.product[1] - 1.5 / total).abs() < 1e-12);
    }

    #[test]
    fn degenerate_pools_are_defined() {
        assert_eq!(normalise(&[], &[], 0.01).product, Vec::<f64>::new());
        let one = normalise(&[7.0], &[-3.0], 0.01);
        assert_eq!((one.psi[0], one.gamma[0], one.product[0]), (1.0, 1.0, 1.0));
        assert_eq!(normalise(&[1.0, 3.0], &[-2.0, -2.0], 0.01).gamma, [0.5, 0.5]);
        assert_eq!(normalise(&[0.0, 0.0], &[-2.0, -1.0], 0.5).psi, [0.5, 0.5]);
        let two = normalise(&[1.0, 1.0], &[-2.0, -1.0], 0.01);
        assert!(two.product[0] > 0.005 && two.product[0] < 0.02, "{:?}", two.product);
    }
}
