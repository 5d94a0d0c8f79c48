//! Maps that lie together: what one travel of the virtual robot leaves behind.
//!
//! A merged map is a map. Clusters that share too little with any single map may share enough with each
//! other, so the robot travels again with whole clusters as its sensor readings, until nothing joins.

use crate::config::Config;
use crate::error::Result;
use crate::evidence::{self, World};
use crate::filter::Step;
use crate::fuse;
use crate::grid::OccupancyGrid;
use crate::local_map::LocalMap;
use crate::pair_table::PairTable;
use crate::perception::Overlay;
use crate::prior::{self, Prior};
use crate::refine;
use crate::result::Known;
use crate::se2::Se2;
use crate::strays::Strays;
use crate::support;
use nalgebra::Matrix3;

/// Most arrangements of a cluster that are carried on.
pub const MAX_WORLDS: usize = 10;

/// Most motions between two clusters that are taken from their members.
const MAX_MOTIONS: usize = 100;

/// Maps placed in one frame, that of one of them.
#[derive(Debug, Clone)]
pub struct Cluster {
    /// The map whose frame is the cluster's.
    pub reference: usize,
    /// Maps in merge order.
    pub members: Vec<usize>,
    /// `T_cluster_map` of each member, refined.
    pub poses: Vec<Se2>,
    /// Covariance of each pose relative to the reference.
    pub covariances: Vec<Matrix3<f64>>,
    /// Root mean square of the walls' residuals, metres.
    pub rms: Option<f64>,
    /// Arrangements of the members that the particles hold, most probable first; the first is this one,
    /// unrefined.
    pub worlds: Vec<World>,
    /// The arrangements of all that the particles placed, in the frame of this cluster; empty where another
    /// cluster's tell of these maps.
    pub stories: Vec<World>,
    /// Whether it was split off for lying elsewhere as well, and how probable its place was.
    pub elsewhere: Option<f64>,
    /// The filter's steps.
    pub steps: Vec<Step>,
    /// Whether its frame is the priors' world.
    pub in_world: bool,
    /// Members that nothing but their priors placed there.
    pub by_prior: Vec<usize>,
}

impl Cluster {
    /// The clusters that one travel leaves behind: the maps whose place is sure, and those whose place is
    /// not, each with the maps that lie sure in relation to it. Each is refined.
    pub fn of_travel(
        maps: &[LocalMap],
        pairs: &PairTable,
        (mut stories, steps): (Vec<World>, Vec<Step>),
        known: &Known,
        config: &Config,
    ) -> Vec<Cluster> {
        support::doubt(maps, pairs, &mut stories[0], known, config.evidence.min_probability);
        let placed = stories[0].placed();
        let held = |m: usize, by: &[usize]| support::is_held(maps, pairs, &placed, m, by);
        let parts = evidence::parts(maps, &stories, config.evidence.min_probability, held);
        let found = Strays::of(maps, pairs, (parts, &stories[0]), known, config);
        found.tell(maps, &mut stories);
        let parts = found.parts;
        // What lies alone where all others were split off is as unsure as they are.
        let next = parts.get(1).map(|(_, share)| *share);
        let clusters = parts.into_iter().enumerate().map(|(k, (worlds, share))| {
            let (members, poses): (Vec<usize>, Vec<Se2>) = worlds[0].poses.iter().copied().unzip();
            let alone = members.len() == 1;
            let fixed = prior::held(&members, &known.priors);
            let refined = refine::refine(maps, &members, &poses, &fixed, pairs, known, config);
            Cluster {
                reference: members[0],
                members,
                poses: refined.poses,
                covariances: refined.covariances,
                rms: refined.rms,
                worlds,
                stories: if k == 0 { stories.clone() } else { Vec::new() },
                elsewhere: if k > 0 { Some(share) } else { next.filter(|_| alone) },
                steps: if k == 0 { steps.clone() } else { Vec::new() },
                in_world: false,
                by_prior: Vec::new(),
            }
        });
        clusters.collect()
    }

    /// Takes another member's frame.
    pub fn rebase(&mut self, reference: usize, maps: &[LocalMap], known: &Known, config: &Config) {
        let Some(k) = self.members.iter().position(|m| *m == reference) else { return };
        let into = self.poses[k].inverse();
        self.poses.iter_mut().for_each(|t| *t = into.compose(t));
        self.poses[k] = Se2::IDENTITY;
        self.covariances =
            refine::uncertainty(maps, &self.members, &self.poses, &[k], known, config);
        for worlds in [&mut self.worlds, &mut self.stories] {
            let Some(into) = worlds.first().and_then(|w| w.pose(reference)) else { continue };
            let into = into.inverse();
            worlds.iter_mut().flat_map(|w| &mut w.poses).for_each(|(_, t)| *t = into.compose(t));
        }
        self.reference = reference;
    }

    /// Where a map lies in the cluster; none when it is no member.
    pub fn pose(&self, map: usize) -> Option<Se2> {
        self.members.iter().position(|m| *m == map).map(|k| self.poses[k])
    }

    /// The members with priors, in their places.
    pub fn with_priors<'p>(&self, priors: &'p [Option<Prior>]) -> Vec<(Se2, &'p Prior)> {
        let placed = self.members.iter().zip(&self.poses);
        placed.filter_map(|(m, t)| Some((*t, priors.get(*m)?.as_ref()?))).collect()
    }

    /// The members' grids in their places.
    pub fn placed<'m>(&self, maps: &'m [LocalMap]) -> Vec<(&'m OccupancyGrid, Se2)> {
        self.members.iter().zip(&self.poses).map(|(m, t)| (&maps[*m].grid, *t)).collect()
    }

    /// The members as layers, with the wall samples that each adds.
    pub fn overlay(&self, maps: &[LocalMap]) -> Overlay {
        let members = self.members.iter().zip(&self.poses);
        members.fold(Overlay::default(), |below, (m, t)| below.with(maps, *m, *t, 1.0, false))
    }

    /// The cluster's merged map.
    pub fn fused(&self, maps: &[LocalMap], config: &Config) -> Result<OccupancyGrid> {
        Ok(fuse::fuse("cluster", &self.placed(maps), &config.fuse)?.grid)
    }

    /// `T_self_other` by the modes of every pair of members, where they are no worse than chance.
    pub fn motions(&self, other: &Cluster, pairs: &PairTable) -> Vec<Se2> {
        let mut found: Vec<(f64, Se2)> = Vec::new();
        for (i, x_i) in self.members.iter().zip(&self.poses) {
            for (j, x_j) in other.members.iter().zip(&other.poses) {
                for (t, _, log_likelihood) in pairs.modes(*i, *j) {
                    if log_likelihood > 0.0 {
                        found.push((log_likelihood, x_i.compose(&t).compose(&x_j.inverse())));
                    }
                }
            }
        }
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        found.truncate(MAX_MOTIONS);
        found.into_iter().map(|(_, t)| t).collect()
    }

    /// Clusters joined as a travel among them found: `worlds` place clusters, by their index. One that was
    /// left alone stays what it is.
    pub fn join(
        maps: &[LocalMap],
        pairs: &PairTable,
        clusters: &[Cluster],
        (worlds, steps): (&[World], Vec<Step>),
        known: &Known,
        config: &Config,
    ) -> Vec<Cluster> {
        if let [World { poses, .. }] = worlds {
            if let [(only, _)] = poses[..] {
                return vec![clusters[only].clone()];
            }
        }
        let mut joined: Vec<World> = Vec::new();
        for (i, w) in worlds.iter().enumerate() {
            let mut of_world = vec![World { probability: w.probability, ..World::default() }];
            for ((k, t), certainty) in w.poses.iter().zip(&w.certainties) {
                // Around the first arrangement the refined poses are the better start.
                let mut inner = clusters[*k].worlds.clone();
                inner[0].poses =
                    clusters[*k].members.iter().copied().zip(clusters[*k].poses.clone()).collect();
                if i > 0 {
                    // Around other arrangements of the clusters their inner ones do not matter.
                    inner.truncate(1);
                    inner[0].probability = 1.0;
                }
                of_world = of_world
                    .iter()
                    .flat_map(|a| inner.iter().map(|b| a.with(b, t, *certainty)))
                    .collect();
                // The first holds all members, a more probable one may lack some: it stays first.
                of_world[1..].sort_by(|a, b| b.probability.total_cmp(&a.probability));
                of_world.truncate(MAX_WORLDS);
            }
            joined.extend(of_world);
        }
        // The first stays first: the rest are alternatives to it.
        joined[1..].sort_by(|a, b| b.probability.total_cmp(&a.probability));
        joined.truncate(MAX_WORLDS);
        let mut all_steps: Vec<Step> =
            worlds[0].poses.iter().flat_map(|(k, _)| clusters[*k].steps.clone()).collect();
        all_steps.extend(steps);
        Self::of_travel(maps, pairs, (joined, all_steps), known, config)
    }
}
