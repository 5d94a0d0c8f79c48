//! Which pairs of many maps are worth registering.
//!
//! Two maps of one place show the same marks (corners of rooms, ends of walls) in the same arrangement, in whatever
//! frame. Every two marks of a map that lie near each other are a word: how the second lies as seen from the first.
//! An index knows in which maps each word stands; rare words count more. Words that two maps share vote for the
//! transform between the maps, so that only those that agree with each other add up (geometric hashing: Lamdan,
//! Wolfson, ICCV 1988). A short look at the walls puts those with the most votes in order.

mod index;

use crate::config::{Config, PerceptionConfig};
use crate::local_map::LocalMap;
use crate::parallel;
use crate::perception::rigid;
use crate::prior::Prior;
use crate::registration::climb::{self, Climb};
use crate::registration::glance::Glance;
use crate::result::Known;
use crate::se2::{Se2, Vec2};
use crate::vicinity::Circle;
use index::{marks, Index};
use std::collections::{BTreeMap, BTreeSet};

/// Up to so many maps every pair is registered, unless the options say otherwise.
pub const ALL_PAIRS_UP_TO: usize = 40;
/// Partners of a map where there are more maps than that.
pub const PARTNERS: usize = 18;

/// Most transforms of a map that are led uphill, the best by a glance at the walls.
const MAX_CLIMBS: usize = 100;
/// Steps uphill.
const STEPS: usize = 6;
/// Wall samples of a map that a glance takes.
const SAMPLES: usize = 100;

/// Whether all pairs of so many maps are worth registering.
pub fn are_all(maps: usize, config: &Config) -> bool {
    match config.registration.partners {
        Some(partners) => partners + 1 >= maps,
        None => maps <= ALL_PAIRS_UP_TO,
    }
}

/// The pairs (a before b) that are worth registering: all of a few maps; of many, those of every map with its most
/// promising partners, and those that are known to lie near each other.
pub fn pairs(maps: &[LocalMap], known: &Known, config: &Config) -> Vec<(usize, usize)> {
    let n = maps.len();
    let partners = config.registration.partners.unwrap_or(PARTNERS);
    if are_all(n, config) {
        return (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b))).collect();
    }
    let ordered = |(a, b): (usize, usize)| (a.min(b), a.max(b));
    let mut found: BTreeSet<(usize, usize)> = BTreeSet::new();
    for (a, ranked) in ranked(maps, config).iter().enumerate() {
        found.extend(ranked.iter().take(partners).map(|(b, _)| ordered((a, *b))));
    }
    let order = known.order.as_deref().unwrap_or_default();
    found.extend(order.windows(2).map(|two| ordered((two[0], two[1]))));
    found.extend(near_by_priors(maps, known));
    found.extend(known.relations.iter().map(|r| ordered((r.a, r.b))));
    found.into_iter().collect()
}

/// Pairs of maps that their priors, give or take three standard deviations, place near each other.
fn near_by_priors(maps: &[LocalMap], known: &Known) -> Vec<(usize, usize)> {
    let circle = |(m, prior): (usize, &Option<Prior>)| {
        let prior = prior.as_ref()?;
        let mut circle = Circle::around(&maps[m].grid, &prior.t_world_map);
        circle.radius +=
            3.0 * (prior.covariance[(0, 0)] + prior.covariance[(1, 1)]).max(0.0).sqrt();
        Some((m, circle))
    };
    let placed: Vec<_> = known.priors.iter().enumerate().filter_map(circle).collect();
    let two =
        placed.iter().enumerate().flat_map(|(k, a)| placed[k + 1..].iter().map(move |b| (a, b)));
    two.filter(|(a, b)| a.1.is_near(&b.1)).map(|(a, b)| (a.0, b.0)).collect()
}

/// Every map's partners, the most promising first, each with the log-likelihood ratio of the best transform that was
/// looked at, nats. What two maps have to say to each other does not depend on the order of the maps.
pub fn ranked(maps: &[LocalMap], config: &Config) -> Vec<Vec<(usize, f64)>> {
    let marks = parallel::map(maps, marks);
    let centers: Vec<Vec2> = maps.iter().map(|m| m.center.unwrap_or_default()).collect();
    let index = Index::new(&marks);
    let all: Vec<usize> = (0..maps.len()).collect();
    let rungs = config.perception.rungs();
    let rigid = rungs[rungs.len() / 2].rigid();
    let looked = parallel::map(&all, |map| {
        let proposed = index.proposed(*map, &marks, &centers);
        let mut glanced: Vec<(f32, usize, Se2)> = proposed
            .into_iter()
            .map(|(other, t)| (Glance::new(&maps[*map], &maps[other]).score(&t), other, t))
            .collect();
        glanced.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        glanced.truncate(MAX_CLIMBS);
        let mut best: BTreeMap<usize, f64> = BTreeMap::new();
        for (_, other, t) in glanced {
            let score = look(&maps[*map], &maps[other], &t, &rigid);
            let entry = best.entry(other).or_insert(score);
            *entry = entry.max(score);
        }
        best
    });
    // Either map asks with its own words.
    let mut found: Vec<BTreeMap<usize, f64>> = looked.clone();
    for (a, of_a) in looked.iter().enumerate() {
        for (b, score) in of_a {
            let entry = found[*b].entry(a).or_insert(*score);
            *entry = entry.max(*score);
        }
    }
    let sorted = |of_map: BTreeMap<usize, f64>| {
        let mut of_map: Vec<(usize, f64)> = of_map.into_iter().collect();
        of_map.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        of_map
    };
    found.into_iter().map(sorted).collect()
}

/// The log-likelihood ratio a few steps uphill from a transform, nats.
fn look(a: &LocalMap, b: &LocalMap, t_a_b: &Se2, p: &PerceptionConfig) -> f64 {
    let climb =
        Climb { samples: SAMPLES, steps: STEPS, scale: climb::wide(a, b), still: climb::STILL };
    let top = climb.top(a, b, t_a_b, p).unwrap_or(*t_a_b);
    rigid::log_likelihoods(a, b, &top, 2 * SAMPLES, std::slice::from_ref(p))[0]
}
