//! Out of optima that pairs contradict: maps moved to where a pair would have them, if all others agree.
//!
//! Walls pull at what is near them. Between bent maps, which fit nowhere at once, that ends in a neighbouring optimum
//! now and then, with residuals as small; what the walls say of the whole tells the two apart.

use super::narrow;
use crate::config::Config;
use crate::local_map::LocalMap;
use crate::pair_table::PairTable;
use crate::parallel;
use crate::perception::likelihood;
use crate::registration::climb::LEVER;
use crate::registration::SAME_WORLD;
use crate::result::Known;
use crate::se2::{self, Se2};
use crate::vicinity;
use std::collections::HashMap;

/// Samples of each map that tell how well two fit.
const SAMPLES: usize = 256;

/// What a move must add to all that the walls say, nats.
const GAIN: f64 = 10.0;

/// Members at their refined poses, and what walls say of them.
pub(super) struct Arrangement<'a> {
    maps: &'a [LocalMap],
    members: &'a [usize],
    /// `T_world_map` of each member.
    pub poses: Vec<Se2>,
    config: &'a Config,
    /// Log-likelihood of each pair of members whose grids overlap, nats; i before j.
    said: Vec<((usize, usize), f64)>,
}

impl<'a> Arrangement<'a> {
    /// Asks the walls of every pair of members whose grids overlap and that is not forbidden.
    pub fn new(
        maps: &'a [LocalMap],
        members: &'a [usize],
        poses: Vec<Se2>,
        known: &Known,
        config: &'a Config,
    ) -> Self {
        let mut near = vicinity::pairs(maps, members, &poses);
        near.retain(|(i, j)| !known.is_forbidden(members[*i], members[*j]));
        let mut found = Self { maps, members, poses, config, said: Vec::new() };
        let said = parallel::map(&near, |(i, j)| {
            found.between(*i, *j, &found.poses[*i].between(&found.poses[*j]))
        });
        found.said = near.into_iter().zip(said).collect();
        found
    }

    /// All that the walls say, nats.
    pub fn evidence(&self) -> f64 {
        self.said.iter().map(|(_, l)| l).sum()
    }

    /// What the walls of two members say of `T_i_j`, nats.
    fn between(&self, i: usize, j: usize, t_i_j: &Se2) -> f64 {
        let (a, b) = (&self.maps[self.members[i]], &self.maps[self.members[j]]);
        likelihood::pair(a, b, t_i_j, SAMPLES, &self.config.perception.rigid()).log_likelihood
    }

    /// The poses with those members moved that pairs would have elsewhere within the same world, where all of a
    /// member's pairs together say more; of members near each other the one that gains most. None where there is no
    /// such member.
    pub fn moved(&self, held: &[usize], pairs: &PairTable, known: &Known) -> Option<Vec<Se2>> {
        let tries = self.tries(held, pairs, known);
        let mut of_member: HashMap<usize, Vec<(usize, f64)>> = HashMap::new();
        for ((i, j), l) in &self.said {
            of_member.entry(*i).or_default().push((*j, *l));
            of_member.entry(*j).or_default().push((*i, *l));
        }
        let gains = parallel::map(&tries, |(k, pose)| -> f64 {
            let gain = |(other, l): &(usize, f64)| {
                let (i, j) = (*k.min(other), *k.max(other));
                let at = |m: usize| if m == *k { pose } else { &self.poses[m] };
                self.between(i, j, &at(i).between(at(j))) - l
            };
            of_member[k].iter().map(gain).sum()
        });
        let mut order: Vec<usize> = (0..tries.len()).filter(|t| gains[*t] > GAIN).collect();
        order.sort_by(|a, b| gains[*b].total_cmp(&gains[*a]));
        let mut chosen: Vec<usize> = Vec::new();
        let mut poses = self.poses.clone();
        for t in order {
            let (k, pose) = tries[t];
            if of_member[&k].iter().all(|(other, _)| !chosen.contains(other))
                && !chosen.contains(&k)
            {
                chosen.push(k);
                poses[k] = pose;
            }
        }
        (!chosen.is_empty()).then_some(poses)
    }

    /// Members, and where pairs would have them that say less of the arrangement than of their best mode.
    fn tries(&self, held: &[usize], pairs: &PairTable, known: &Known) -> Vec<(usize, Se2)> {
        let narrow = narrow(self.maps, self.members, self.config);
        let is_free = |k: &usize| !held.contains(k) && !known.is_told(self.members[*k]);
        let of_pair = |((i, j), l): &((usize, usize), f64)| -> Vec<(usize, Se2)> {
            let best = pairs.modes(self.members[*i], self.members[*j]).into_iter().next();
            let Some((t_i_j, _, _)) = best else { return Vec::new() };
            let both = [
                (*j, self.poses[*i].compose(&t_i_j)),
                (*i, self.poses[*j].compose(&t_i_j.inverse())),
            ];
            let is_worth_it = |(k, pose): &(usize, Se2)| {
                let center = self.maps[self.members[*k]].center.unwrap_or_default();
                let moved = (pose.apply(center) - self.poses[*k].apply(center)).norm();
                let turned = se2::wrap(pose.theta - self.poses[*k].theta).abs();
                let is_elsewhere = moved + LEVER * turned > narrow;
                is_elsewhere && moved <= SAME_WORLD.0 && turned <= SAME_WORLD.1
            };
            let both: Vec<(usize, Se2)> =
                both.into_iter().filter(|(k, _)| is_free(k)).filter(is_worth_it).collect();
            if both.is_empty() || self.between(*i, *j, &t_i_j) <= l + GAIN {
                Vec::new()
            } else {
                both
            }
        };
        parallel::map(&self.said, of_pair).into_iter().flatten().collect()
    }
}
