//! How clean the maps at hand are, learnt from the pairs that fit best.
//!
//! What a wall in clear free space means depends on the maps: at a true pose of undistorted maps there
//! is none, at one of bent maps there are some. The pairs that fit best tell which maps these are. They
//! can only make the model stricter than its configuration: maps that fit nowhere must not earn leniency.

use crate::config::PerceptionConfig;
use crate::registration::PairModes;

/// Observations that a pair must share before it has a say.
const MIN_HITS: f64 = 8.0;
/// Share of contradicting observations at a true pose that is believed without having been seen.
const CLEANEST: f64 = 0.005;
/// Prior observations at the configured rate, so that one short wall does not prove maps clean.
const PRIOR: f64 = 2.0;
/// Share of contradicting observations between unrelated maps.
const UNRELATED: f64 = 0.5;

/// The perception model with the conflict's log-likelihood ratio fitted to `n` maps' pairs.
pub fn adapt(config: &PerceptionConfig, pairs: &[PairModes], n: usize) -> PerceptionConfig {
    // The best fit of each map, whichever map it is with.
    let mut best: Vec<Option<&PairModes>> = vec![None; n];
    let value = |p: &PairModes| p.modes[0].evidence.log_likelihood;
    for p in pairs.iter().filter(|p| p.modes.first().is_some_and(|m| m.evidence.hits >= MIN_HITS)) {
        for m in [p.a, p.b] {
            if best[m].is_none_or(|b| value(p) > value(b)) {
                best[m] = Some(p);
            }
        }
    }
    // Both directions are halved in the evidence; conflicts of each are events of their own.
    let rate_of = |log_ratio: f64| UNRELATED * (0.5 * log_ratio).exp();
    let prior = rate_of(config.conflict);
    let mut rates: Vec<f64> = best
        .iter()
        .flatten()
        .map(|p| {
            let e = &p.modes[0].evidence;
            (2.0 * e.conflicts + PRIOR * prior) / (2.0 * (e.conflicts + e.hits) + PRIOR)
        })
        .collect();
    if rates.is_empty() {
        return config.clone();
    }
    rates.sort_by(f64::total_cmp);
    let rate = rates[rates.len() / 2].max(CLEANEST);
    let conflict = (2.0 * (rate / UNRELATED).ln()).min(config.conflict);
    PerceptionConfig { conflict, ..config.clone() }
}

/// Weighs the modes of all pairs anew after the conflict's ratio has changed from `before` to `now`.
pub fn reweigh(pairs: &mut [PairModes], before: &PerceptionConfig, now: &PerceptionConfig) {
    let change = now.conflict - before.conflict;
    for p in pairs {
        for m in &mut p.modes {
            m.evidence.log_likelihood += change * m.evidence.conflicts;
            m.log_odds += change * m.evidence.conflicts;
        }
        p.modes.sort_by(|x, y| y.evidence.log_likelihood.total_cmp(&x.evidence.log_likelihood));
    }
}
