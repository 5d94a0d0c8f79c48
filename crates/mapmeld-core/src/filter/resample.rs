//! Low-variance resampling (Thrun, Burgard, Fox, Probabilistic Robotics, table 4.4).

/// Indices of the survivors, ascending: index i appears `floor` or `ceil` of `n * weights[i]` times.
/// `weights` sum to one; `start` in [0, 1) is the one random number.
pub fn low_variance(weights: &[f64], n: usize, start: f64) -> Vec<usize> {
    let mut out = Vec::with_capacity(n);
    let (mut i, mut upto) = (0, weights[0]);
    for k in 0..n {
        let u = (k as f64 + start) / n as f64;
        // The last index also takes what rounding leaves over.
        while u >= upto && i + 1 < weights.len() {
            i += 1;
            upto += weights[i];
        }
        out.push(i);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_particle_has_its_share(
            raw in prop::collection::vec(0.0..1.0f64, 1..40), start in 0.0..1.0f64, n in 1usize..200,
        ) {
            let sum: f64 = raw.iter().sum();
            prop_assume!(sum > 1e-6);
            let weights: Vec<f64> = raw.iter().map(|w| w / sum).collect();
            let picked = low_variance(&weights, n, start);
            prop_assert_eq!(picked.len(), n);
            prop_assert!(picked.windows(2).all(|w| w[0] <= w[1]));
            for (i, w) in weights.iter().enumerate() {
                let count = picked.iter().filter(|k| **k == i).count() as f64;
                prop_assert!((count - n as f64 * w).abs() < 1.0 + 1e-6, "{count} of {}", n as f64 * w);
            }
        }
    }
}
