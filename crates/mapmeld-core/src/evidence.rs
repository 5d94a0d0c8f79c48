//! From particles to verdicts: the worlds that they hold, their probabilities, the standing of each map.

use crate::cluster::Cluster;
use crate::config::Config;
use crate::filter::Particle;
use crate::local_map::LocalMap;
use crate::perception::Overlay;
use crate::registration::SAME_WORLD;
use crate::result::Placement;
use crate::se2::Se2;
use nalgebra::Matrix3;

/// The standing of a map.
#[derive(Debug, Clone, PartialEq)]
pub enum Status {
    /// Placed with others.
    Merged,
    /// Placed with others, while other placements are nearly as probable.
    Ambiguous,
    /// No other map shares enough walls with it: a component of its own.
    NoEvidence,
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
            Status::Blank => "blank",
        }
    }
}

/// One arrangement of a component's maps, and how probable the particles make it.
#[derive(Debug, Clone)]
pub struct World {
    /// Maps and `T_component_map` in merge order, the reference first.
    pub poses: Vec<(usize, Se2)>,
    /// Share of the particles' weight.
    pub probability: f64,
}

impl World {
    /// This world with another one placed in it.
    pub fn with(&self, other: &World, t_world_other: &Se2) -> World {
        let mut poses = self.poses.clone();
        poses.extend(other.poses.iter().map(|(m, t)| (*m, t_world_other.compose(t))));
        World { poses, probability: self.probability * other.probability }
    }
}

/// One arrangement of all maps.
#[derive(Debug, Clone)]
pub struct Hypothesis {
    /// Probability, given that one of the hypotheses is true.
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
        let weight = p.log_weight.0.exp();
        match found.iter_mut().find(|w| is_same_world(maps, &w.poses, &poses)) {
            Some(w) => w.probability += weight,
            None => found.push(World { poses, probability: weight }),
        }
    }
    found.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    found
}

fn is_same_world(maps: &[LocalMap], a: &[(usize, Se2)], b: &[(usize, Se2)]) -> bool {
    a.len() == b.len()
        && a.iter().all(|(m, x)| {
            let center = maps[*m].center.unwrap_or_default();
            b.iter().any(|(k, y)| k == m && x.is_close_at(y, center, SAME_WORLD.0, SAME_WORLD.1))
        })
}

/// Standing of every map from the clusters, which are the components of the result.
pub fn placements(maps: &[LocalMap], clusters: &[Cluster], config: &Config) -> Vec<Placement> {
    let blank = Placement {
        component: None,
        t_component_map: None,
        covariance: Matrix3::zeros(),
        status: Status::Blank,
        probability: 0.0,
    };
    let mut out = vec![blank; maps.len()];
    for (component, c) in clusters.iter().enumerate() {
        for (i, (m, x)) in c.worlds[0].poses.iter().enumerate() {
            let center = maps[*m].center.unwrap_or_default();
            // Worlds that leave the map where it is, or leave it out, do not contradict its place.
            let elsewhere: f64 = c.worlds[1..]
                .iter()
                .filter(|w| {
                    w.poses.iter().any(|(k, y)| {
                        k == m && !x.is_close_at(y, center, SAME_WORLD.0, SAME_WORLD.1)
                    })
                })
                .map(|w| w.probability)
                .sum();
            let status = if c.members.len() == 1 {
                Status::NoEvidence
            } else if elsewhere > config.evidence.ambiguous_above {
                Status::Ambiguous
            } else {
                Status::Merged
            };
            out[*m] = Placement {
                component: Some(component),
                t_component_map: Some(c.poses[i]),
                covariance: c.covariances[i],
                status,
                probability: 1.0 - elsewhere,
            };
        }
    }
    out
}

/// Whole arrangements: one world from each component, most probable first.
pub fn hypotheses(clusters: &[Cluster]) -> Vec<Hypothesis> {
    let mut out = vec![Hypothesis { probability: 1.0, maps: Vec::new() }];
    for (component, c) in clusters.iter().enumerate() {
        let mut next: Vec<Hypothesis> = Vec::new();
        for h in &out {
            for w in c.worlds.iter().take(MAX_HYPOTHESES) {
                let mut maps = h.maps.clone();
                maps.extend(w.poses.iter().map(|(m, t)| (*m, component, *t)));
                next.push(Hypothesis { probability: h.probability * w.probability, maps });
            }
        }
        next.sort_by(|a, b| b.probability.total_cmp(&a.probability));
        next.truncate(MAX_HYPOTHESES);
        // Probabilities are given that one of those told is true.
        let told: f64 = next.iter().map(|h| h.probability).sum();
        next.iter_mut().for_each(|h| h.probability /= told);
        out = next;
    }
    out
}
