//! Maps that lie where weak evidence from many has put them, though a pair that carries says otherwise.
//!
//! Walls that look alike all over a building add up. A map that no pair alone would put where it lies, while one
//! would put it beside a map that is not sure to be there, is no surer than that other one. Where many maps are
//! looked at, some pair of two that are far apart carries by chance: it is outvoted by the pairs that are right.

use crate::evidence::World;
use crate::local_map::LocalMap;
use crate::pair_table::PairTable;
use crate::registration::SAME_WORLD;
use crate::result::Known;
use crate::se2::Se2;
use std::collections::HashMap;

/// Most that one pair's probability counts for: what looks alike twice is no two independent mistakes.
const SUREST: f64 = 0.999;

/// What a pair counts for: its log odds. One that is more likely wrong than right, which carries where little is asked
/// for, counts for nothing: it must not speak against what it finds.
pub fn vote(probability: f64) -> f64 {
    log_odds(probability.max(0.5))
}

fn log_odds(probability: f64) -> f64 {
    let p = probability.min(SUREST);
    (p / (1.0 - p)).ln()
}

/// The probability that log odds are of.
pub fn probability(log_odds: f64) -> f64 {
    1.0 / (1.0 + (-log_odds).exp())
}

/// Whether pairs that alone would be merged put a map where it lies, next to some of the other maps that are `placed`,
/// more than elsewhere.
pub fn is_held(
    maps: &[LocalMap],
    pairs: &PairTable,
    placed: &HashMap<usize, Se2>,
    map: usize,
    by: &[usize],
) -> bool {
    let Some(x) = placed.get(&map) else { return false };
    let votes =
        pairs.carried(map).filter(|(other, ..)| by.contains(other)).filter_map(|(other, t, p)| {
            let agrees = is_there(maps, other, &x.compose(&t), placed.get(&other)?);
            Some(if agrees { vote(p) } else { -vote(p) })
        });
    votes.sum::<f64>() > 0.0
}

/// How probable it is that the first map of a part belongs to the others, where pairs put it elsewhere for sure (by
/// `least`): nobody doubts a reference otherwise, as all are placed as seen from it. `whole` is the world that the
/// part is of. Pairs that put the map where it lies, beside maps of other parts, say nothing of this one.
pub fn of_first(
    maps: &[LocalMap],
    pairs: &PairTable,
    (part, whole): (&World, &World),
    known: &Known,
    least: f64,
) -> Option<f64> {
    let (first, _) = *part.poses.first()?;
    let x = whole.pose(first)?;
    let is_given = known.is_told(first) || known.order.as_ref().is_some_and(|o| o.contains(&first));
    if is_given || part.poses.len() < 3 {
        return None;
    }
    let votes = pairs.carried(first).map(|(other, t, p)| {
        let there = whole.pose(other).is_some_and(|y| is_there(maps, other, &x.compose(&t), &y));
        match (there, part.pose(other)) {
            (true, Some(_)) => vote(p),
            (true, None) => 0.0,
            (false, _) => -vote(p),
        }
    });
    let votes: f64 = votes.sum();
    (votes < -vote(least)).then(|| probability(votes))
}

/// Whether two poses put a map at the same place.
pub fn is_there(maps: &[LocalMap], map: usize, x: &Se2, y: &Se2) -> bool {
    let (distance, angle) = SAME_WORLD;
    x.is_close_at(y, maps[map].center.unwrap_or_default(), distance, angle)
}

/// Lowers the certainties in a world of maps without support: if a map lies right and a pair is right, the
/// pair's other map lies where both put it, so the first is at most as probable as that, or as the pair
/// being wrong. So it does of maps that more pairs put elsewhere than where they lie: beside maps that are sure to lie
/// elsewhere, or that the robot found no place for. `least` is how sure a map must be to support others.
pub fn doubt(maps: &[LocalMap], pairs: &PairTable, world: &mut World, known: &Known, least: f64) {
    // However little is asked for: what is more likely wrong than right supports nothing.
    let least = least.max(0.5);
    let placed: HashMap<usize, (Se2, f64)> = world
        .poses
        .iter()
        .zip(&world.certainties)
        .map(|((m, x), certainty)| (*m, (*x, *certainty)))
        .collect();
    // The probability that the other map lies where the first one and their pair put it.
    let there = |x: &Se2, other: usize, t: &Se2| -> f64 {
        let Some((y, certainty)) = placed.get(&other) else { return 0.0 };
        match is_there(maps, other, &x.compose(t), y) {
            true => *certainty,
            false => 1.0 - certainty,
        }
    };
    let others = world.poses.iter().zip(&mut world.certainties).skip(1);
    for ((m, x), certainty) in others.filter(|((m, _), _)| !known.is_told(*m)) {
        let carried = pairs.carried(*m).map(|(other, t, p)| (there(x, other, &t), p));
        let (mut highest, mut least_of_all, mut votes) = (0.0_f64, 1.0_f64, 0.0);
        for (there, p) in carried {
            highest = highest.max(there);
            least_of_all = least_of_all.min(there + 1.0 - p);
            if there >= least {
                votes += vote(p);
            } else if there <= 1.0 - least {
                votes -= vote(p);
            }
        }
        if highest < least {
            *certainty = certainty.min(least_of_all);
        } else if votes < 0.0 {
            *certainty = certainty.min(probability(votes + log_odds(*certainty)));
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::config::Config;
    use crate::evidence::Status;
    use crate::grid::OccupancyGrid;
    use crate::perception::WallEvidence;
    use crate::registration::{Mode, PairModes, Rung, Source};
    use nalgebra::Matrix3;

    pub(crate) fn pair((a, b): (usize, usize), t_a_b: Se2, probability: f64) -> PairModes {
        let evidence = WallEvidence { log_likelihood: 50.0, ..WallEvidence::default() };
        let covariance = Matrix3::identity();
        let mode = Mode { t_a_b, covariance, evidence, log_odds: 0.0, source: Source::Corners };
        let status = if probability < 0.85 { Status::NoEvidence } else { Status::Merged };
        let found = Rung { modes: vec![mode], decoy: None, apart: SAME_WORLD.0 };
        PairModes { a, b, candidates: 1, found, status, probability, stretch: None }
    }

    fn doubted(pairs: Vec<PairModes>, of_last: f64) -> Vec<f64> {
        doubted_by(pairs, of_last, 0.85)
    }

    fn doubted_by(pairs: Vec<PairModes>, of_last: f64, least: f64) -> Vec<f64> {
        let grid = OccupancyGrid::new("g", 2, 2, 0.1, Se2::IDENTITY, vec![0; 4]).unwrap();
        let maps = vec![LocalMap::new(grid, &Config::default()); 3];
        let at = |x: f64| Se2::new(x, 0.0, 0.0);
        let mut world = World {
            poses: vec![(0, at(0.0)), (1, at(5.0)), (2, at(9.0))],
            certainties: vec![1.0, 0.9, of_last],
            probability: 1.0,
        };
        doubt(&maps, &PairTable::new(3, pairs), &mut world, &Known::default(), least);
        world.certainties
    }

    #[test]
    fn a_first_map_that_pairs_put_elsewhere_is_no_part_of_the_others() {
        let grid = OccupancyGrid::new("g", 2, 2, 0.1, Se2::IDENTITY, vec![0; 4]).unwrap();
        let maps = vec![LocalMap::new(grid, &Config::default()); 5];
        let at = |x: f64| Se2::new(x, 0.0, 0.0);
        let poses = vec![(0, at(0.0)), (1, at(5.0)), (2, at(9.0))];
        let world = World { poses, certainties: vec![1.0; 3], probability: 1.0 };
        let of_first = |pairs: Vec<PairModes>, known: &Known| {
            of_first(&maps, &PairTable::new(5, pairs), (&world, &world), known, 0.85)
        };
        let (here, there) = (pair((0, 1), at(5.0), 0.9), pair((0, 3), at(2.0), 0.9));
        let other = pair((0, 4), at(2.0), 0.95);
        let unknown = Known::default();
        assert_eq!(of_first(vec![here.clone(), there.clone()], &unknown), None);
        let both = vec![here, there, other];
        assert!(of_first(both.clone(), &unknown).is_some_and(|p| p < 0.15));
        // Who was told to begin there begins there.
        let told = Known { order: Some(vec![0, 1]), ..Known::default() };
        assert_eq!(of_first(both, &told), None);
    }

    #[test]
    fn pairs_to_other_parts_speak_against_a_first_map_where_its_world_does() {
        let grid = OccupancyGrid::new("g", 2, 2, 0.1, Se2::IDENTITY, vec![0; 4]).unwrap();
        let maps = vec![LocalMap::new(grid, &Config::default()); 6];
        let at = |x: f64| Se2::new(x, 0.0, 0.0);
        // The part begins with the second map of its world, which lies half a turn off.
        let lead = Se2::new(5.0, 0.0, std::f64::consts::PI);
        let poses = vec![(0, at(0.0)), (1, lead), (2, at(9.0)), (3, at(2.0)), (4, at(3.0))];
        let whole = World { poses, certainties: vec![1.0; 5], probability: 1.0 };
        let part = whole.restricted(&[1, 2, 3]).unwrap();
        let of_first = |pairs: Vec<PairModes>| {
            let pairs = PairTable::new(6, pairs);
            of_first(&maps, &pairs, (&part, &whole), &Known::default(), 0.85)
        };
        let (right, too) = (pair((0, 1), lead, 0.95), pair((1, 4), lead.between(&at(3.0)), 0.95));
        assert_eq!(of_first(vec![right.clone(), too.clone()]), None);
        // They say where it lies, not that this part does.
        let wrong = |other: usize| pair((1, other), at(20.0), 0.9);
        assert!(of_first(vec![right, too, wrong(2), wrong(3)]).is_some_and(|p| p < 0.15));
        // Elsewhere than the world has it, or beside a map that it has nowhere.
        let elsewhere = pair((0, 1), at(5.0), 0.9);
        assert!(of_first(vec![elsewhere, wrong(5)]).is_some_and(|p| p < 0.15));
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
        // So does one against one that is as sure of another place; one that is surer lowers what the walls say.
        let elsewhere = pair((0, 2), at(-3.0), 0.9);
        let (other, held) = (pair((1, 2), at(-3.0), 0.9), pair((1, 2), at(4.0), 0.9));
        near(doubted(vec![elsewhere.clone(), held.clone()], 0.95), [1.0, 0.9, 0.95]);
        let surer = pair((0, 2), at(-3.0), 0.95);
        near(doubted(vec![surer, held], 0.95), [1.0, 0.9, 0.9]);
        near(doubted(vec![elsewhere, other], 0.95), [1.0, 0.15, 0.1]);
        // Nothing carries: the evidence of all together counts.
        near(doubted(vec![pair((0, 1), at(5.0), 0.6)], 0.3), [1.0, 0.9, 0.3]);
    }

    fn carried(pair: PairModes) -> PairModes {
        PairModes { status: Status::Merged, ..pair }
    }

    #[test]
    fn where_little_is_asked_for_no_pair_speaks_against_what_it_finds() {
        let at = |x: f64| Se2::new(x, 0.0, 0.0);
        let right = || carried(pair((0, 1), at(5.0), 0.4));
        for least in [0.3, 0.0] {
            assert_eq!(doubted_by(vec![right()], 0.3, least)[1], 0.9, "{least}");
            // A map that a pair puts elsewhere is not sure, however little is asked for.
            let wrong = pair((0, 1), at(-3.0), 0.99);
            assert!(doubted_by(vec![wrong.clone()], 0.3, least)[1] < 0.02, "{least}");
            let grid = OccupancyGrid::new("g", 2, 2, 0.1, Se2::IDENTITY, vec![0; 4]).unwrap();
            let maps = vec![LocalMap::new(grid, &Config::default()); 3];
            let poses = vec![(0, at(0.0)), (1, at(5.0)), (2, at(9.0))];
            let world = World { poses, certainties: vec![1.0; 3], probability: 1.0 };
            let of_first = |pairs: Vec<PairModes>| {
                let pairs = PairTable::new(3, pairs);
                of_first(&maps, &pairs, (&world, &world), &Known::default(), least)
            };
            assert_eq!(of_first(vec![]), None, "{least}");
            assert_eq!(of_first(vec![right()]), None, "{least}");
            assert_eq!(of_first(vec![carried(pair((0, 1), at(-3.0), 0.4))]), None, "{least}");
            assert!(of_first(vec![wrong]).is_some_and(|p| p < 0.5), "{least}");
        }
    }
}
