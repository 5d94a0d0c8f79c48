//! Maps that lie where weak evidence from many has put them, though a pair that carries says otherwise.
//!
//! Walls that look alike all over a building add up. A map that no pair alone would put where it lies, while one
//! would put it beside a map that is not sure to be there, is no surer than that other one.

use crate::evidence::World;
use crate::local_map::LocalMap;
use crate::pair_table::PairTable;
use crate::registration::SAME_WORLD;
use crate::result::Known;
use crate::se2::Se2;
use std::collections::HashMap;

/// Lowers the certainties in a world of maps without support: if a map lies right and a pair is right, the
/// pair's other map lies where both put it, so the first is at most as probable as that, or as the pair
/// being wrong. `least` is how sure a map must be to support others.
pub fn doubt(maps: &[LocalMap], pairs: &PairTable, world: &mut World, known: &Known, least: f64) {
    let placed: HashMap<usize, (Se2, f64)> = world
        .poses
        .iter()
        .zip(&world.certainties)
        .map(|((m, x), certainty)| (*m, (*x, *certainty)))
        .collect();
    let is_told = |m: usize| {
        known.priors.get(m).is_some_and(Option::is_some)
            || known.relations.iter().any(|r| r.a == m || r.b == m)
    };
    // The probability that the other map lies where the first one and their pair put it.
    let there = |x: &Se2, other: usize, t: &Se2| -> f64 {
        let Some((y, certainty)) = placed.get(&other) else { return 0.0 };
        let (distance, angle) = SAME_WORLD;
        let center = maps[other].center.unwrap_or_default();
        match x.compose(t).is_close_at(y, center, distance, angle) {
            true => *certainty,
            false => 1.0 - certainty,
        }
    };
    let others = world.poses.iter().zip(&mut world.certainties).skip(1);
    for ((m, x), certainty) in others.filter(|((m, _), _)| !is_told(*m)) {
        let carried = pairs.carried(*m).map(|(other, t, p)| (there(x, other, &t), p));
        let (mut highest, mut least_of_all) = (0.0_f64, 1.0_f64);
        for (there, p) in carried {
            highest = highest.max(there);
            least_of_all = least_of_all.min(there + 1.0 - p);
        }
        if highest < least {
            *certainty = certainty.min(least_of_all);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use crate::evidence::Status;
    use crate::grid::OccupancyGrid;
    use crate::perception::WallEvidence;
    use crate::registration::{Mode, PairModes, Rung, Source};
    use nalgebra::Matrix3;

    fn pair((a, b): (usize, usize), t_a_b: Se2, probability: f64) -> PairModes {
        let evidence = WallEvidence { log_likelihood: 50.0, ..WallEvidence::default() };
        let covariance = Matrix3::identity();
        let mode = Mode { t_a_b, covariance, evidence, log_odds: 0.0, source: Source::Corners };
        let status = if probability < 0.85 { Status::NoEvidence } else { Status::Merged };
        let found = Rung { modes: vec![mode], decoys: Vec::new() };
        PairModes { a, b, candidates: 1, found, status, probability }
    }

    fn doubted(pairs: Vec<PairModes>, of_last: f64) -> Vec<f64> {
        let grid = OccupancyGrid::new("g", 2, 2, 0.1, Se2::IDENTITY, vec![0; 4]).unwrap();
        let maps = vec![LocalMap::new(grid, &Config::default()); 3];
        let at = |x: f64| Se2::new(x, 0.0, 0.0);
        let mut world = World {
            poses: vec![(0, at(0.0)), (1, at(5.0)), (2, at(9.0))],
            certainties: vec![1.0, 0.9, of_last],
            probability: 1.0,
        };
        doubt(&maps, &PairTable::new(3, pairs), &mut world, &Known::default(), 0.85);
        world.certainties
    }

    #[test]
    fn a_map_is_no_surer_than_the_one_that_alone_holds_it() {
        let at = |x: f64| Se2::new(x, 0.0, 0.0);
        let held = pair((1, 2), at(4.0), 0.99);
        let near = |got: Vec<f64>, expected: [f64; 3]| {
            got.iter().zip(expected).for_each(|(g, e)| assert!((g - e).abs() < 1e-9, "{got:?}"));
        };
        // The other one lies there, and is not sure.
        near(doubted(vec![held.clone()], 0.3), [1.0, 0.31, 0.3]);
        // The other one is sure of it.
        near(doubted(vec![held.clone()], 0.95), [1.0, 0.9, 0.95]);
        // It lies elsewhere, and is sure of that.
        let elsewhere = pair((1, 2), at(-3.0), 0.99);
        near(doubted(vec![elsewhere.clone()], 0.95), [1.0, 0.06, 0.11]);
        // A pair that carries supports the place, whatever else does not.
        let support = pair((0, 1), at(5.0), 0.9);
        near(doubted(vec![support, elsewhere], 0.3), [1.0, 0.9, 0.11]);
        // Nothing carries: the evidence of all together counts.
        near(doubted(vec![pair((0, 1), at(5.0), 0.6)], 0.3), [1.0, 0.9, 0.3]);
    }
}
