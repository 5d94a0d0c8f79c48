//! First maps of a part that pairs put elsewhere, and what holds without them.
//!
//! All maps of a part are placed as seen from its first one. If that one does not belong there, what it alone held
//! together is held by nothing: the rest is split into what pairs among its own maps hold. Where walls hold more than
//! that, the robot finds it when it travels among the clusters.

use crate::config::Config;
use crate::evidence::{self, World};
use crate::local_map::LocalMap;
use crate::pair_table::PairTable;
use crate::result::Known;
use crate::se2::Se2;
use crate::support::{self, is_there, probability, vote};
use std::cmp::Reverse;
use std::collections::HashMap;

/// Parts of a travel without their strays.
pub struct Strays {
    /// Worlds of each part, and the share of probability that its first map's place had; the strays come last, each
    /// alone.
    pub parts: Vec<(Vec<World>, f64)>,
    /// The maps that were taken out.
    maps: Vec<usize>,
    /// How sure the others of their parts are at most.
    most: HashMap<usize, f64>,
}

impl Strays {
    /// Takes the first map of each part out where pairs put that elsewhere. `whole` is the world that the parts are
    /// of.
    pub fn of(
        maps: &[LocalMap],
        pairs: &PairTable,
        (parts, whole): (Vec<(Vec<World>, f64)>, &World),
        known: &Known,
        config: &Config,
    ) -> Strays {
        let least = config.evidence.min_probability;
        let (mut kept, mut split, mut strays) = (Vec::new(), Vec::new(), Vec::new());
        let mut most = HashMap::new();
        for (worlds, share) in parts {
            let part = (&worlds[0], whole);
            let Some(of_stray) = support::of_first(maps, pairs, part, known, least) else {
                kept.push((worlds, share));
                continue;
            };
            let placed = worlds[0].placed();
            let members: Vec<usize> = worlds[0].poses.iter().map(|(m, _)| *m).collect();
            let rest = &members[1..];
            let mut groups = held_together(maps, pairs, &placed, rest, least);
            // The first of the largest is what the others are split off from.
            groups.sort_by_key(|g| Reverse(g.len()));
            for (k, group) in groups.into_iter().enumerate() {
                let members: Vec<usize> = group.iter().map(|(m, _)| *m).collect();
                most.extend(group);
                let own = worlds.iter().filter_map(|w| w.restricted(&members));
                let mut own = evidence::united(maps, own);
                own.iter_mut().for_each(|w| w.lower(&most));
                if k == 0 {
                    kept.push((own, share));
                    continue;
                }
                // It is where it is for the sake of the stray.
                let at = worlds[0].poses.iter().position(|(m, _)| *m == members[0]);
                let certainty = at.map_or(1.0, |at| worlds[0].certainties[at]);
                let of_lead = share * certainty * of_stray;
                most.insert(members[0], of_lead);
                split.push((own, of_lead));
            }
            let poses = vec![(members[0], Se2::IDENTITY)];
            let alone = World { poses, certainties: vec![1.0], probability: 1.0 };
            strays.push((members[0], (vec![alone], of_stray)));
        }
        let (maps, strays): (Vec<usize>, Vec<_>) = strays.into_iter().unzip();
        kept.extend(split.into_iter().chain(strays));
        Strays { parts: kept, maps, most }
    }

    /// Takes the strays out of the arrangements of all that the particles placed, which are in the frame of the first
    /// part then.
    pub fn tell(&self, maps: &[LocalMap], stories: &mut Vec<World>) {
        if self.maps.is_empty() {
            return;
        }
        let lead = self.parts[0].0[0].poses[0].0;
        let first = stories[0].poses[0].0;
        let of_first = stories[0].pose(lead);
        for w in stories.iter_mut() {
            // Those that lack it lie as the first does.
            if let Some(t) = w.pose(lead).or(of_first).filter(|_| first != lead) {
                let into = t.inverse();
                w.poses.iter_mut().for_each(|(_, t)| *t = into.compose(t));
            }
            w.remove(&self.maps);
            w.lower(&self.most);
            let own = w.poses.iter().position(|(m, _)| *m == lead);
            own.into_iter().for_each(|k| w.certainties[k] = 1.0);
        }
        stories.retain(|w| !w.poses.is_empty());
        *stories = evidence::united(maps, stories.drain(..));
    }
}

/// The members of a world in groups that carrying pairs among their own hold together, whatever other maps there are:
/// each map with the probability that its pairs into the group give its place there, one for the first. No pair that
/// puts a member elsewhere outvotes those that put it there, by less than `least`. In merge order, by their first.
fn held_together(
    maps: &[LocalMap],
    pairs: &PairTable,
    placed: &HashMap<usize, Se2>,
    members: &[usize],
    least: f64,
) -> Vec<Vec<(usize, f64)>> {
    let votes_of = |map: usize| {
        pairs.carried(map).filter_map(move |(other, t, p)| {
            let (x, y) = (placed.get(&map)?, placed.get(&other)?);
            let agrees = is_there(maps, other, &x.compose(&t), y);
            Some((other, if agrees { vote(p) } else { -vote(p) }))
        })
    };
    let is_enough = |votes: f64| votes > 0.0 && votes >= vote(least);
    // What speaks for each map of a group, grown from the first of the candidates.
    let grown = |candidates: &[usize]| -> Vec<(usize, f64)> {
        let mut left = candidates.to_vec();
        let mut votes: HashMap<usize, f64> = candidates.iter().map(|m| (*m, 0.0)).collect();
        let (mut group, mut next) = (Vec::new(), Some(0));
        while let Some(k) = next {
            let new = left.remove(k);
            group.push(new);
            for (other, v) in votes_of(new) {
                votes.entry(other).and_modify(|sum| *sum += v);
            }
            next = left.iter().position(|m| is_enough(votes[m]));
        }
        group.into_iter().map(|m| (m, votes[&m])).collect()
    };
    let mut left = members.to_vec();
    let mut groups = Vec::new();
    while !left.is_empty() {
        let mut candidates = left.clone();
        // Who came in early may be outvoted by those that came later.
        let group = loop {
            let group = grown(&candidates);
            let is_out = |(_, votes): &(usize, f64)| !is_enough(*votes);
            if group.len() == 1 || !group.iter().any(is_out) {
                break group;
            }
            if is_out(&group[0]) {
                break vec![group[0]];
            }
            let out: Vec<usize> = group.iter().filter(|m| is_out(m)).map(|(m, _)| *m).collect();
            candidates.retain(|m| !out.contains(m));
        };
        left.retain(|m| group.iter().all(|(k, _)| k != m));
        let sure = |(k, (m, votes)): (usize, (usize, f64))| match k {
            0 => (m, 1.0),
            _ => (m, probability(votes)),
        };
        groups.push(group.into_iter().enumerate().map(sure).collect());
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::OccupancyGrid;
    use crate::registration::PairModes;
    use crate::support::tests::pair;

    fn at(map: usize) -> Se2 {
        Se2::new(3.0 * map as f64, 0.0, 0.0)
    }

    fn right(a: usize, b: usize) -> PairModes {
        pair((a, b), at(a).between(&at(b)), 0.9)
    }

    fn wrong(a: usize, b: usize) -> PairModes {
        pair((a, b), Se2::new(-20.0, 0.0, 1.0), 0.95)
    }

    fn world(poses: Vec<(usize, Se2)>, probability: f64) -> World {
        let mut certainties = vec![0.95; poses.len()];
        certainties[0] = 1.0;
        World { poses, certainties, probability }
    }

    /// What is left of one part of maps that lie at [`at`] in its first world.
    fn left(worlds: &[World], pairs: Vec<PairModes>) -> (Strays, Vec<World>) {
        let grid = OccupancyGrid::new("g", 2, 2, 0.1, Se2::IDENTITY, vec![0; 4]).unwrap();
        let maps = vec![LocalMap::new(grid, &Config::default()); 7];
        let pairs = PairTable::new(7, pairs);
        let parts = (vec![(worlds.to_vec(), 1.0)], &worlds[0]);
        let found = Strays::of(&maps, &pairs, parts, &Known::default(), &Config::default());
        let mut stories = worlds.to_vec();
        found.tell(&maps, &mut stories);
        (found, stories)
    }

    fn members(found: &Strays) -> Vec<Vec<usize>> {
        let of = |(w, _): &(Vec<World>, f64)| w[0].poses.iter().map(|(m, _)| *m).collect();
        found.parts.iter().map(of).collect()
    }

    #[test]
    fn what_a_stray_alone_held_together_is_split() {
        let all = world((0..5).map(|m| (m, at(m))).collect(), 1.0);
        let pairs = vec![right(0, 1), right(0, 2), wrong(0, 5), wrong(0, 6), wrong(0, 3)];
        // Maps 3 and 4 hold each other; 1 and 2 were held by the stray alone.
        let held = [pairs.clone(), vec![right(3, 4)]].concat();
        let (found, _) = left(std::slice::from_ref(&all), held);
        assert_eq!(members(&found), [vec![3, 4], vec![1], vec![2], vec![0]]);
        assert!(found.parts[1..].iter().all(|(_, share)| *share < 0.5));
        // They hold no surer than their pair does.
        assert!((found.parts[0].0[0].certainties[1] - 0.9).abs() < 1e-9);
        // Pairs among the rest hold it.
        let held = [pairs, vec![right(1, 2), right(2, 3), right(3, 4)]].concat();
        assert_eq!(members(&left(&[all], held).0), [vec![1, 2, 3, 4], vec![0]]);
    }

    #[test]
    fn nothing_is_told_of_where_a_stray_was_and_worlds_that_differ_by_it_alone_are_one() {
        let turn = Se2::new(1.0, 40.0, 2.0);
        let moved = |m: usize, t: &Se2| (m, t.compose(&at(m)));
        let worlds = [
            world((0..4).map(|m| (m, at(m))).collect(), 0.5),
            // The same but for the stray, and one with map 3 elsewhere.
            world(vec![(0, at(0)), moved(1, &turn), moved(2, &turn), moved(3, &turn)], 0.3),
            world(vec![(0, at(0)), (1, at(1)), (2, at(2)), (3, at(40))], 0.15),
            world(vec![(0, at(0))], 0.05),
        ];
        let pairs = vec![wrong(0, 4), wrong(0, 5), wrong(0, 1), right(1, 2), right(2, 3)];
        let (found, stories) = left(&worlds, pairs);
        assert_eq!(members(&found), [vec![1, 2, 3], vec![0]]);
        for told in [&found.parts[0].0, &stories] {
            let probabilities: Vec<f64> = told.iter().map(|w| w.probability).collect();
            assert_eq!(probabilities, [0.8, 0.15]);
            assert!(told.iter().all(|w| w.pose(0).is_none()), "{told:?}");
            assert!(told.iter().all(|w| w.poses[0] == (1, Se2::IDENTITY)), "{told:?}");
            assert!(told.iter().all(|w| w.certainties[0] == 1.0), "{told:?}");
        }
    }

    #[test]
    fn groups_are_what_pairs_among_members_hold() {
        let grid = OccupancyGrid::new("g", 2, 2, 0.1, Se2::IDENTITY, vec![0; 4]).unwrap();
        let maps = vec![LocalMap::new(grid, &Config::default()); 6];
        let at = |m: usize| Se2::new(3.0 * m as f64, 0.0, 0.0);
        let placed: HashMap<usize, Se2> = (0..6).map(|m| (m, at(m))).collect();
        let right = |a: usize, b: usize, p: f64| pair((a, b), at(a).between(&at(b)), p);
        let wrong = |a: usize, b: usize, p: f64| pair((a, b), Se2::new(-20.0, 0.0, 1.0), p);
        let groups = |pairs: Vec<PairModes>| -> Vec<Vec<usize>> {
            let pairs = PairTable::new(6, pairs);
            let groups = held_together(&maps, &pairs, &placed, &[1, 2, 3, 4, 5], 0.85);
            let of = |g: &Vec<(usize, f64)>| g.iter().map(|(m, _)| *m).collect();
            groups.iter().map(of).collect()
        };
        // What the map that is no member holds is held by nothing, nor is it by a pair that does not carry.
        let held = vec![right(0, 1, 0.99), right(0, 2, 0.99), right(1, 2, 0.7), right(3, 5, 0.9)];
        assert_eq!(groups(held), [vec![1], vec![2], vec![3, 5], vec![4]]);
        // Of two that speak against each other the first comes in, until the other one is held by more.
        let first = vec![right(1, 3, 0.9), right(1, 4, 0.9), wrong(3, 4, 0.95)];
        assert_eq!(groups(first), [vec![1, 3], vec![2], vec![4], vec![5]]);
        let (one, two) = (right(1, 4, 0.95), right(2, 4, 0.95));
        let outvoted = vec![right(1, 2, 0.9), right(1, 3, 0.9), one, two, wrong(3, 4, 0.9)];
        assert_eq!(groups(outvoted), [vec![1, 2, 4], vec![3], vec![5]]);
        // So it is with the one that the others come in by.
        let lead = vec![right(1, 3, 0.9), wrong(1, 4, 0.95), right(3, 4, 0.995)];
        assert_eq!(groups(lead), [vec![1], vec![2], vec![3, 4], vec![5]]);
    }
}
