//! From particles to verdicts: the worlds that they hold, their probabilities, the standing of each map.

use crate::cluster::Cluster;
use crate::filter::Particle;
use crate::local_map::LocalMap;
use crate::perception::Overlay;
use crate::registration::SAME_WORLD;
use crate::result::Placement;
use crate::se2::Se2;
use nalgebra::Matrix3;
use std::cell::OnceCell;
use std::collections::HashMap;

/// The standing of a map.
#[derive(Debug, Clone, PartialEq)]
pub enum Status {
    /// Placed with others.
    Merged,
    /// It belongs to others for sure, but not where; or pairs contradict the place that it had among them: placed in a
    /// component of its own.
    Ambiguous,
    /// No other map shares enough walls with it: a component of its own.
    NoEvidence,
    /// Placed by its prior alone.
    Prior,
    /// Of a pair: its match is known to be wrong.
    Forbidden,
    /// Nothing is known in it: it can be placed nowhere.
    Blank,
}

impl Status {
    /// Name in results.
    pub fn name(&self) -> &'static str {
        match self {
            Status::Merged => "merged",
            Status::Ambiguous => "ambiguous",
            Status::NoEvidence => "no evidence",
            Status::Prior => "prior",
            Status::Forbidden => "forbidden",
            Status::Blank => "blank",
        }
    }
}

/// One arrangement of a component's maps, and how probable the particles make it.
#[derive(Debug, Clone, Default)]
pub struct World {
    /// Maps and `T_component_map` in merge order, the reference first.
    pub poses: Vec<(usize, Se2)>,
    /// Probability that each map lies at one of the places that some world has it at, given those before it;
    /// one for the reference. Which of them is told by the worlds' shares.
    pub certainties: Vec<f64>,
    /// Share of the particles' weight.
    pub probability: f64,
}

impl World {
    /// This world with another one placed in it, where it lies with some certainty.
    pub fn with(&self, other: &World, t_world_other: &Se2, certainty: f64) -> World {
        let mut world = self.clone();
        world.poses.extend(other.poses.iter().map(|(m, t)| (*m, t_world_other.compose(t))));
        world.certainties.push(certainty);
        world.certainties.extend(other.certainties.iter().skip(1));
        world.probability *= other.probability;
        world
    }

    /// Probability that all of it is right.
    pub fn certainty(&self) -> f64 {
        self.probability * self.certainties.iter().product::<f64>()
    }

    /// Where a map is, if it is placed.
    pub fn pose(&self, map: usize) -> Option<Se2> {
        self.poses.iter().find(|(m, _)| *m == map).map(|(_, x)| *x)
    }

    /// Where each of its maps is.
    pub fn placed(&self) -> HashMap<usize, Se2> {
        self.poses.iter().copied().collect()
    }

    /// Takes some of its maps out.
    pub(crate) fn remove(&mut self, gone: &[usize]) {
        let kept = self.poses.iter().zip(&self.certainties);
        (self.poses, self.certainties) = kept.filter(|((m, _), _)| !gone.contains(m)).unzip();
    }

    /// Makes maps no surer than they are at `most`.
    pub(crate) fn lower(&mut self, most: &HashMap<usize, f64>) {
        for ((m, _), certainty) in self.poses.iter().zip(&mut self.certainties) {
            *certainty = most.get(m).map_or(*certainty, |most| certainty.min(*most));
        }
    }

    /// Some of the maps, the first of which must be there, in its frame.
    pub(crate) fn restricted(&self, members: &[usize]) -> Option<World> {
        let t_lead_world = self.pose(members[0])?.inverse();
        let kept = self.poses.iter().zip(&self.certainties);
        let (mut poses, mut certainties): (Vec<_>, Vec<f64>) = kept
            .filter(|((m, _), _)| members.contains(m))
            .map(|((m, x), c)| ((*m, t_lead_world.compose(x)), *c))
            .unzip();
        // The lead comes first, in whatever order this world was made.
        let lead = poses.iter().position(|(m, _)| *m == members[0])?;
        poses[..=lead].rotate_right(1);
        certainties[..=lead].rotate_right(1);
        certainties[0] = 1.0;
        Some(World { poses, certainties, probability: self.probability })
    }
}

/// One arrangement of all maps.
#[derive(Debug, Clone)]
pub struct Hypothesis {
    /// Probability that all of it is right.
    pub probability: f64,
    /// Component and `T_component_map` of the maps that it places.
    pub maps: Vec<(usize, usize, Se2)>,
}

/// Most hypotheses that are told.
const MAX_HYPOTHESES: usize = 10;

/// Groups particles that tell the same story: the same maps, each at the same pose. The heaviest
/// particle speaks for its world. Most probable first.
pub fn worlds(maps: &[LocalMap], particles: &[Particle<Overlay>]) -> Vec<World> {
    let mut order: Vec<usize> = (0..particles.len()).collect();
    order.sort_by(|a, b| particles[*b].log_weight.0.total_cmp(&particles[*a].log_weight.0));
    let mut found: Vec<World> = Vec::new();
    for k in order {
        let p = &particles[k];
        let mut poses: Vec<(usize, Se2)> =
            p.state.layers().map(|l| (l.map, l.t_world_map)).collect();
        poses.reverse();
        let mut certainties: Vec<f64> = p.state.layers().map(|l| l.probability).collect();
        certainties.reverse();
        let weight = p.log_weight.0.exp();
        match found.iter_mut().find(|w| is_same_world(maps, &w.poses, &poses)) {
            Some(w) => w.probability += weight,
            None => found.push(World { poses, certainties, probability: weight }),
        }
    }
    found.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    found
}

fn is_same_world(maps: &[LocalMap], a: &[(usize, Se2)], b: &[(usize, Se2)]) -> bool {
    let is_close = |m: usize, x: &Se2, y: &Se2| {
        let center = maps[m].center.unwrap_or_default();
        x.is_close_at(y, center, SAME_WORLD.0, SAME_WORLD.1)
    };
    if a.len() != b.len() {
        return false;
    }
    if a.iter().zip(b).all(|((m, _), (k, _))| m == k) {
        return a.iter().zip(b).all(|((m, x), (_, y))| is_close(*m, x, y));
    }
    let there: HashMap<usize, &Se2> = b.iter().map(|(m, y)| (*m, y)).collect();
    a.iter().all(|(m, x)| there.get(m).is_some_and(|y| is_close(*m, x, y)))
}

/// Parts of the first world that lie sure in themselves: maps whose place relative to the part's first map the
/// worlds agree on. The first part holds the reference. Each with its worlds and the share of probability that
/// its first map's place had. `is_held` tells whether pairs hold a map beside some others where it lies in the first
/// world.
pub fn parts(
    maps: &[LocalMap],
    worlds: &[World],
    least: f64,
    is_held: impl Fn(usize, &[usize]) -> bool,
) -> Vec<(Vec<World>, f64)> {
    let first = &worlds[0];
    let poses: Vec<HashMap<usize, Se2>> = worlds.iter().map(World::placed).collect();
    // Whether a world puts a map where the first does, as seen from another map; none where it lacks one.
    let agrees = |w: usize, lead: usize, map: usize| -> Option<bool> {
        let seen = |w: usize| Some(poses[w].get(&lead)?.between(poses[w].get(&map)?));
        let (here, there) = (seen(0)?, seen(w)?);
        let center = maps[map].center.unwrap_or_default();
        Some(there.is_close_at(&here, center, SAME_WORLD.0, SAME_WORLD.1))
    };
    let total: f64 = worlds.iter().map(|w| w.probability).sum();
    let weight = |f: &dyn Fn(usize) -> bool| -> f64 {
        (0..worlds.len()).filter(|w| f(*w)).map(|w| worlds[w].probability).sum::<f64>()
    };
    // Worlds without the map do not contradict its place.
    let agreement = |lead: usize, map: usize| -> f64 {
        1.0 - weight(&|w| agrees(w, lead, map) == Some(false)) / total
    };
    // A map that another one holds, which was split off, goes where that one goes: it must be seen to stay
    // where that one does not. Where no world moves that one, pairs tell.
    let holds_without =
        |lead: usize, other: usize, map: usize, do_pairs: &dyn Fn() -> bool| -> bool {
            let moved = weight(&|w| agrees(w, lead, other) == Some(false));
            let stays = weight(&|w| {
                agrees(w, lead, other) == Some(false) && agrees(w, lead, map) == Some(true)
            });
            match moved > 0.0 {
                true => stays >= least * moved,
                false => do_pairs(),
            }
        };
    let mut groups: Vec<(Vec<usize>, f64)> = Vec::new();
    for ((map, _), certainty) in first.poses.iter().zip(&first.certainties) {
        let sure = |g: &(Vec<usize>, f64)| {
            let lead = g.0[0];
            // What pairs say is asked once, and only where worlds leave it to them.
            let told = OnceCell::new();
            let do_pairs = || *told.get_or_init(|| is_held(*map, &g.0));
            let holds = |other: usize| holds_without(lead, other, *map, &do_pairs);
            certainty * agreement(lead, *map) >= least
                && groups.iter().all(|h| h.0[0] == lead || holds(h.0[0]))
        };
        // Of a map that no group holds by itself, the last that it is sure to lie to takes care.
        let near = |g: &(Vec<usize>, f64)| certainty * agreement(g.0[0], *map) >= least;
        let found = groups.iter().position(sure).or_else(|| groups.iter().rposition(near));
        match found {
            Some(k) => groups[k].0.push(*map),
            None => {
                let reference = groups.first().map(|g| g.0[0]);
                let share = reference.map_or(1.0, |r| agreement(r, *map) * certainty);
                groups.push((vec![*map], share));
            }
        }
    }
    let of_group = |(members, share): (Vec<usize>, f64)| {
        (united(maps, worlds.iter().filter_map(|w| w.restricted(&members))), share)
    };
    groups.into_iter().map(of_group).collect()
}

/// Worlds without those that are the same as another one: the first stays first, the rest are sorted, most probable
/// first.
pub(crate) fn united(maps: &[LocalMap], worlds: impl Iterator<Item = World>) -> Vec<World> {
    let mut own: Vec<World> = Vec::new();
    for w in worlds {
        match own.iter_mut().find(|o| is_same_world(maps, &o.poses, &w.poses)) {
            Some(o) => o.probability += w.probability,
            None => own.push(w),
        }
    }
    own[1..].sort_by(|a, b| b.probability.total_cmp(&a.probability));
    own
}

/// Standing of every map from the clusters, which are the components of the result.
pub fn placements(maps: &[LocalMap], clusters: &[Cluster]) -> Vec<Placement> {
    let blank = Placement {
        component: None,
        t_component_map: None,
        covariance: Matrix3::zeros(),
        status: Status::Blank,
        probability: 0.0,
    };
    let mut out = vec![blank; maps.len()];
    for (component, c) in clusters.iter().enumerate() {
        let first = &c.worlds[0];
        for (i, ((m, x), certainty)) in first.poses.iter().zip(&first.certainties).enumerate() {
            let center = maps[*m].center.unwrap_or_default();
            // Worlds that leave the map where it is, or leave it out, do not contradict its place.
            let (distance, angle) = SAME_WORLD;
            let elsewhere = c.worlds[1..].iter().filter(|w| {
                w.pose(*m).is_some_and(|y| !x.is_close_at(&y, center, distance, angle))
            });
            let elsewhere: f64 = elsewhere.map(|w| w.probability).sum();
            let (status, probability) = match c.elsewhere {
                Some(share) => (Status::Ambiguous, share),
                None if c.by_prior.contains(m) => (Status::Prior, 1.0),
                None if c.members.len() == 1 => (Status::NoEvidence, 1.0),
                None => (Status::Merged, (1.0 - elsewhere).min(1.0) * certainty),
            };
            out[*m] = Placement {
                component: Some(component),
                t_component_map: Some(c.poses[i]),
                covariance: c.covariances[i],
                status,
                probability,
            };
        }
    }
    out
}

/// Whole arrangements: one world from each component, most probable first. What their probabilities lack to one
/// is that of none of them being right.
pub fn hypotheses(clusters: &[Cluster]) -> Vec<Hypothesis> {
    let mut out = vec![Hypothesis { probability: 1.0, maps: Vec::new() }];
    for (component, c) in clusters.iter().enumerate() {
        if c.stories.is_empty() {
            continue;
        }
        let mut next: Vec<Hypothesis> = Vec::new();
        for h in &out {
            for w in c.stories.iter().take(MAX_HYPOTHESES) {
                let mut maps = h.maps.clone();
                // Stories of two components may both tell of a map that was split off.
                let told = |m: usize| h.maps.iter().any(|(k, _, _)| *k == m);
                let new = w.poses.iter().filter(|(m, _)| !told(*m));
                maps.extend(new.map(|(m, t)| (*m, component, *t)));
                next.push(Hypothesis { probability: h.probability * w.certainty(), maps });
            }
        }
        next.sort_by(|a, b| b.probability.total_cmp(&a.probability));
        next.truncate(MAX_HYPOTHESES);
        out = next;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use crate::grid::OccupancyGrid;
    use std::cell::RefCell;

    #[test]
    fn what_pairs_hold_does_not_go_with_a_map_that_is_split_off() {
        let grid = OccupancyGrid::new("g", 2, 2, 0.1, Se2::IDENTITY, vec![0; 4]).unwrap();
        let maps = vec![LocalMap::new(grid, &Config::default()); 3];
        let world = World {
            poses: (0..3).map(|m| (m, Se2::new(5.0 * m as f64, 0.0, 0.0))).collect(),
            certainties: vec![1.0, 0.1, 0.95],
            probability: 1.0,
        };
        let members = |is_held: bool| -> Vec<Vec<usize>> {
            let held = |map: usize, by: &[usize]| is_held && map == 2 && by.contains(&0);
            let parts = parts(&maps, std::slice::from_ref(&world), 0.85, held);
            let of_part = |(w, _): &(Vec<World>, f64)| w[0].poses.iter().map(|(m, _)| *m).collect();
            parts.iter().map(of_part).collect()
        };
        assert_eq!(members(true), [vec![0, 2], vec![1]]);
        // It may be there for the sake of the one that is not sure alone.
        assert_eq!(members(false), [vec![0], vec![1, 2]]);
    }

    #[test]
    fn pairs_are_asked_once_for_each_map_and_part() {
        let grid = OccupancyGrid::new("g", 2, 2, 0.1, Se2::IDENTITY, vec![0; 4]).unwrap();
        let maps = vec![LocalMap::new(grid, &Config::default()); 5];
        let world = World {
            poses: (0..5).map(|m| (m, Se2::new(5.0 * m as f64, 0.0, 0.0))).collect(),
            certainties: vec![1.0, 0.1, 0.1, 0.1, 0.95],
            probability: 1.0,
        };
        let asked = RefCell::new(Vec::new());
        let held = |map: usize, by: &[usize]| {
            asked.borrow_mut().push((map, by.to_vec()));
            true
        };
        let parts = parts(&maps, std::slice::from_ref(&world), 0.85, held);
        assert_eq!(parts.len(), 4);
        assert_eq!(asked.into_inner(), [(4, vec![0])]);
    }
}
