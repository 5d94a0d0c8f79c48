//! Where the filter's random numbers come from, and what resampling does with its only one.

use mapmeld_core::filter::{low_variance, stream};
use rand::Rng;
use std::collections::HashSet;

/// Over all values of the one random number, every particle has just as many offspring as is due.
#[test]
fn resampling_is_unbiased() {
    let weights = [0.13, 0.02, 0.5, 0.0, 0.35];
    let n = 7;
    let mut offspring = [0.0; 5];
    let starts = 10_000;
    for k in 0..starts {
        let start = (f64::from(k) + 0.5) / f64::from(starts);
        low_variance(&weights, n, start).into_iter().for_each(|i| offspring[i] += 1.0);
    }
    for (i, w) in weights.iter().enumerate() {
        let (got, due) = (offspring[i] / f64::from(starts), n as f64 * w);
        assert!((got - due).abs() < 1e-3, "particle {i}: {got} offspring, {due} due");
    }
}

#[test]
fn random_streams_are_distinct_and_uncorrelated() {
    let mut seen = HashSet::new();
    let (mut sum, mut n) = (0.0, 0.0);
    for seed in 0..4 {
        for step in 1..20 {
            let mut last = 0.0;
            for index in (0..200).chain([u64::MAX]) {
                let mut rng = stream(seed, step, index);
                let u: f64 = rng.random();
                assert!(seen.insert(u.to_bits()), "stream ({seed}, {step}, {index}) is not new");
                sum += (u - 0.5) * (last - 0.5);
                n += 1.0;
                last = u;
            }
        }
    }
    // The product of two independent uniform numbers about zero has standard deviation 1/12.
    assert!((sum / n).abs() * 12.0 < 4.0 / f64::sqrt(n), "correlation {}", sum / n * 12.0);
}
