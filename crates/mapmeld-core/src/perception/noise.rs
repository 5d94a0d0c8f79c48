//! How clean the maps at hand are, learnt from the pairs that fit best.
//!
//! What a wall in clear free space means depends on the maps: at a true pose of undistorted maps there
//! is none, at one of bent maps there are some. The pairs that fit best tell which maps these are. They
//! can only make conflicts dearer than configured: maps that fit nowhere must not earn leniency.

use crate::config::PerceptionConfig;
use crate::perception::WallEvidence;
use crate::registration::PairModes;

/// Observations that a pair must share before it has a say.
const MIN_HITS: f64 = 8.0;
/// Share of contradicting observations at a true pose that is believed without having been seen.
const CLEANEST: f64 = 0.02;
/// Log-likelihood ratio of a conflict, nats, from which maps count as clean.
const CLEAN: f64 = -6.0;
/// Share of missing among the hits and missing of a chance alignment.
const MISSED_BY_CHANCE: f64 = 0.5;
/// The least that is believed of the same at a true pose.
const LEAST_MISSED: f64 = 0.05;
/// Prior observations at the configured rate, so that one short wall does not prove maps clean.
const PRIOR: f64 = 2.0;
/// Share of contradicting observations between unrelated maps.
const UNRELATED: f64 = 0.5;

/// Log-likelihood ratio from which a pair is beyond doubt, nats.
const BEYOND_DOUBT: f64 = 25.0;
/// Pairs beyond doubt that it takes to learn from them.
const MIN_STRONG: usize = 3;
/// Share of opposed among the hits and opposed of a chance alignment.
const OPPOSED_BY_CHANCE: f64 = 0.15;
/// Largest log-likelihood ratio that an opposed wall can earn.
const MAX_OPPOSED: f64 = 1.0;

/// The perception model as fitted to the maps at hand.
#[derive(Debug, Clone)]
pub struct Learnt {
    /// The configuration with the fitted ratios in place.
    pub perception: PerceptionConfig,
    /// Whether pairs beyond doubt have shown that the maps are clean.
    pub is_clean: bool,
}

/// Fits the perception model to the pairs of `n` maps.
pub fn learn(config: &PerceptionConfig, pairs: &[PairModes], n: usize) -> Learnt {
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
    let strong = beyond_doubt(&best);
    let conflict = conflict_ratio(&best, config);
    let is_clean = strong.len() >= MIN_STRONG && conflict <= CLEAN;
    let perception = PerceptionConfig {
        conflict,
        miss: miss_ratio(&best, config),
        opposed: if is_clean { opposed_ratio(&strong, config) } else { config.opposed },
        ..config.clone()
    };
    Learnt { perception, is_clean }
}

/// Log-likelihood ratio of a wall that is not there: from the median share among the best fits. Dearer
/// than configured at most, as with conflicts.
fn miss_ratio(best: &[Option<&PairModes>], config: &PerceptionConfig) -> f64 {
    let mut rates: Vec<f64> = best
        .iter()
        .flatten()
        .map(|p| {
            let e = &p.modes[0].evidence;
            (e.misses + PRIOR * MISSED_BY_CHANCE) / (e.misses + e.hits + PRIOR)
        })
        .collect();
    if rates.is_empty() {
        return config.miss;
    }
    rates.sort_by(f64::total_cmp);
    let rate = rates[rates.len() / 2].max(LEAST_MISSED);
    (rate / MISSED_BY_CHANCE).ln().min(config.miss)
}

/// Log-likelihood ratio of a conflict: from the median share among the best fits.
fn conflict_ratio(best: &[Option<&PairModes>], config: &PerceptionConfig) -> f64 {
    // Both directions are halved in the evidence; conflicts of each are events of their own.
    let prior = UNRELATED * (0.5 * config.conflict).exp();
    let mut rates: Vec<f64> = best
        .iter()
        .flatten()
        .map(|p| {
            let e = &p.modes[0].evidence;
            (2.0 * e.conflicts + PRIOR * prior) / (2.0 * (e.conflicts + e.hits) + PRIOR)
        })
        .collect();
    if rates.is_empty() {
        return config.conflict;
    }
    rates.sort_by(f64::total_cmp);
    let rate = rates[rates.len() / 2].max(CLEANEST);
    (2.0 * (rate / UNRELATED).ln()).min(config.conflict)
}

/// The distinct pairs among the best fits that leave no doubt.
fn beyond_doubt<'p>(best: &[Option<&'p PairModes>]) -> Vec<&'p PairModes> {
    let mut strong: Vec<&PairModes> = best
        .iter()
        .flatten()
        .copied()
        .filter(|p| {
            let e = &p.modes[0].evidence;
            e.log_likelihood >= BEYOND_DOUBT && e.conflict_share() <= 0.05
        })
        .collect();
    strong.sort_by_key(|p| (p.a, p.b));
    strong.dedup_by_key(|p| (p.a, p.b));
    strong
}

/// Log-likelihood ratio of a wall that another map shows from its other side. Where walls are thin that
/// is the same wall, and speaks for the pose: how often it happens is learnt from pairs beyond doubt.
fn opposed_ratio(strong: &[&PairModes], config: &PerceptionConfig) -> f64 {
    let sum = |f: fn(&WallEvidence) -> f64| -> f64 {
        strong.iter().map(|p| f(&p.modes[0].evidence)).sum()
    };
    let (hits, opposed) = (sum(|e| e.hits), sum(|e| e.opposed));
    let rate = (opposed + 10.0 * OPPOSED_BY_CHANCE) / (hits + opposed + 10.0);
    (rate / OPPOSED_BY_CHANCE).ln().min(MAX_OPPOSED).max(config.opposed)
}

/// Weighs the modes of all pairs anew after the model has changed from `before` to `now`.
pub fn reweigh(pairs: &mut [PairModes], before: &PerceptionConfig, now: &PerceptionConfig) {
    let change = |e: &WallEvidence| {
        (now.conflict - before.conflict) * e.conflicts
            + (now.miss - before.miss) * e.misses
            + (now.opposed - before.opposed) * e.opposed
    };
    for p in pairs {
        for m in &mut p.modes {
            let change = change(&m.evidence);
            m.evidence.log_likelihood += change;
            m.log_odds += change;
        }
        for e in &mut p.decoys {
            e.log_likelihood += change(e);
        }
        p.modes.sort_by(|x, y| y.evidence.log_likelihood.total_cmp(&x.evidence.log_likelihood));
    }
}
