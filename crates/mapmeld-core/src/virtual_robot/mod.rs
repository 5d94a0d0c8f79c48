//! The virtual robot (paper, section 2): map merging as the particle filter's model.
//!
//! At step t the robot stands at the origin of local map phi_t: its pose x_t is `T_world_map` of that
//! map, the local map is its sensor reading z_t, and its odometry u_t comes from registering similar
//! structures. The state is the trajectory, which holds the merge order, and the merged map.

mod look;
mod motion;
mod settling;

use crate::config::{Config, PerceptionConfig, PerceptionModel};
use crate::filter::{LogWeight, Model, Particle, Stream};
use crate::local_map::LocalMap;
use crate::memory::{Memory, Motion};
use crate::pair_table::PairTable;
use crate::parallel;
use crate::perception::psi::Comparison;
use crate::perception::{gamma, pool, psi, Overlay, WallEvidence};
use crate::prior::{self, Prior};
use crate::registration;
use crate::result::Known;
use crate::se2::Se2;
use crate::verdict::{self, Background};
use nalgebra::{Matrix3, Vector3};
use rand_distr::{Distribution, StandardNormal};

/// Particles that lie closer than this (metres, radians) differ by the noise of their draws alone.
const NOISE: (f64, f64) = (0.2, 0.04);

/// Probability from which one map is as sure as another.
const SURE: f64 = 0.999;

/// A possible next pose of the virtual robot.
#[derive(Debug, Clone)]
pub struct NextPose {
    /// The map that is read there: phi_t.
    pub map: usize,
    /// Mean of the mode: x_t.
    pub t_world_map: Se2,
    /// Its covariance.
    pub covariance: Matrix3<f64>,
    /// What the walls say of the map against all merged so far.
    pub evidence: WallEvidence,
    /// Probability that the pose is right, given what is merged so far.
    pub probability: f64,
    /// Probability that one of the poses of this map that are followed is.
    pub any: f64,
    psi: f64,
    gamma: f64,
}

/// The filter's model for maps.
pub struct VirtualRobot<'a> {
    /// The local maps: the sensor readings.
    pub maps: &'a [LocalMap],
    /// Registration of pairs: the odometry.
    pub pairs: &'a PairTable,
    /// Maps that may be visited: not blank, not in another component.
    pub open: Vec<bool>,
    /// The merge order, when it is known.
    pub order: Option<&'a [usize]>,
    /// Options, with the perception model that fits the maps.
    pub config: &'a Config,
    /// Which degree of bending that is, 0 the finest.
    pub rung: usize,
    /// What is known of the maps' poses.
    pub known: &'a Known,
    /// What the maps are merged of, when they are merged maps themselves.
    pub parts: Option<Parts<'a>>,
    /// What it has worked out so far.
    pub memory: Memory,
}

/// What is placed in one particle's merged map.
struct Here<'a> {
    merged: &'a Overlay,
    placed: Vec<(usize, Se2)>,
    is_placed: Vec<bool>,
    background: Background,
    /// Number of local maps that all these are made of.
    member_count: usize,
}

/// The maps that merged maps are made of.
pub struct Parts<'a> {
    /// The local maps.
    pub maps: &'a [LocalMap],
    /// For each merged map, its local maps in its own frame.
    pub overlays: &'a [Overlay],
    /// What is known of the local maps.
    pub known: &'a Known,
    /// Their registration.
    pub pairs: &'a PairTable,
}

impl VirtualRobot<'_> {
    /// The state at the start: the reference map at the world's origin, and where it is pinned, all others that
    /// are.
    pub fn start(&self, reference: usize) -> Overlay {
        let start = self.fold(&Overlay::default(), reference, Se2::IDENTITY, 1.0);
        let pin = |m: usize| self.prior(m).filter(|p| p.is_pinned).map(|p| p.t_world_map);
        let Some(t_world_reference) = pin(reference) else { return start };
        let others = (0..self.maps.len()).filter(|m| *m != reference && self.open[*m]);
        others
            .filter_map(|m| Some((m, pin(m)?)))
            .fold(start, |merged, (m, t)| self.fold(&merged, m, t_world_reference.between(&t), 1.0))
    }

    /// Whether all particles have placed every map that may be visited.
    pub(crate) fn is_everywhere(&self, particles: &[Particle<Overlay>]) -> bool {
        let open = self.open.iter().filter(|open| **open).count();
        particles.iter().all(|p| p.state.layers().count() == open)
    }

    /// What is known of a map's pose.
    pub fn prior(&self, map: usize) -> Option<&Prior> {
        self.known.priors.get(map).and_then(Option::as_ref)
    }

    fn fold(&self, merged: &Overlay, map: usize, t_world_map: Se2, probability: f64) -> Overlay {
        let cells = self.config.perception.model == PerceptionModel::PsiGamma;
        merged.with(self.maps, map, t_world_map, probability, cells)
    }

    /// What is placed in a merged map.
    fn here<'m>(&self, merged: &'m Overlay) -> Here<'m> {
        let placed: Vec<(usize, Se2)> = merged.layers().map(|l| (l.map, l.t_world_map)).collect();
        let mut is_placed = vec![false; self.maps.len()];
        placed.iter().for_each(|(m, _)| is_placed[*m] = true);
        let members: Vec<&LocalMap> = placed.iter().flat_map(|(m, _)| self.members(*m)).collect();
        let member_count = members.len();
        let background = Background::new(members.into_iter(), self.model(), 0.0);
        Here { merged, placed, is_placed, background, member_count }
    }

    /// The degree of bending, its index and its model.
    fn model(&self) -> (usize, &PerceptionConfig) {
        (self.rung, &self.config.perception)
    }

    /// The local maps that a map is made of. Merged maps are judged by their size, as every map is.
    fn members(&self, map: usize) -> Vec<&LocalMap> {
        match &self.parts {
            Some(parts) => parts.overlays[map].layers().map(|l| &parts.maps[l.map]).collect(),
            None => vec![&self.maps[map]],
        }
    }

    /// Perception model (paper, section 4) of the poses at which a map may lie; none when the evidence does
    /// not carry a merge.
    fn perceive(&self, here: &Here, map: usize, motions: &[Motion]) -> Vec<NextPose> {
        let merged = here.merged;
        let center = self.maps[map].center.unwrap_or_default();
        let mut seen: Vec<(Se2, Matrix3<f64>, WallEvidence)> = Vec::new();
        // Motions of one map lie too far apart for one to be told what another one was.
        let looks = parallel::map(motions, |(_, x, _)| self.look(merged, map, *x));
        for ((_, _, covariance), look) in motions.iter().zip(looks) {
            let Some((x, evidence)) = look else { continue };
            if !self.is_refused(merged, map, &x) {
                seen.push((x, *covariance, evidence));
            }
        }
        seen.sort_by(|a, b| b.2.log_likelihood.total_cmp(&a.2.log_likelihood));
        // Motions that led to the same place are one, which the likeliest tells.
        let distance = registration::apart(&self.config.perception);
        let told = registration::stories(seen.iter().map(|(x, ..)| x), center, distance);
        let seen: Vec<_> = told.into_iter().map(|k| seen[k]).collect();
        let partners = self.pairs.partners(map).filter(|m| here.is_placed[*m]);
        let decoy = partners.map(|m| self.pairs.decoy(m, map)).fold(0.0, f64::max);
        let members = self.members(map);
        let pairs = self.parts.as_ref().map_or(1, |_| here.member_count * members.len());
        let own = Background::new(members.into_iter(), self.model(), decoy);
        let background = Background { pairs, ..own.with(&here.background) };
        let c = &self.config.evidence;
        let poses: Vec<&WallEvidence> = seen.iter().map(|(.., e)| e).collect();
        let mut verdict = verdict::weigh(&poses, &background, c);
        let prior_fit = self.prior_fit(&here.placed, map);
        // Of two maps alone all has been said: another climb may reach a little more, as it may with strangers.
        if let ([(other, _)], None, None) = (here.placed.as_slice(), &prior_fit, &self.parts) {
            verdict.is_carried &= self.pairs.is_carried(*other, map);
        }
        if let Some(fit) = prior_fit {
            // Walls that speak against a pose do not hold it, wherever the prior would have it.
            let odds = |(x, covariance, e): &(Se2, Matrix3<f64>, WallEvidence)| {
                let fit = fit(x, covariance).filter(|_| e.log_likelihood > 0.0);
                fit.map_or(f64::NEG_INFINITY, |f| f.log_odds)
            };
            let odds: Vec<f64> = seen.iter().map(odds).collect();
            verdict = prior::weighed(&verdict, &odds, c.min_probability);
        }
        // Somewhere it must lie for sure before it is asked where.
        if !verdict.is_carried {
            return Vec::new();
        }
        let followed = seen.into_iter().zip(verdict.probabilities);
        let followed: Vec<_> = followed.filter(|(_, p)| *p >= c.least_followed).collect();
        let any: f64 = followed.iter().map(|(_, p)| p).sum();
        let pose = |((x, covariance, e), p)| self.pose(merged, map, (x, covariance), e, (p, any));
        followed.into_iter().map(pose).collect()
    }

    fn pose(
        &self,
        merged: &Overlay,
        map: usize,
        (x, covariance): (Se2, Matrix3<f64>),
        evidence: WallEvidence,
        (probability, any): (f64, f64),
    ) -> NextPose {
        let p = &self.config.perception;
        let (psi, gamma) = match p.model {
            PerceptionModel::OrientedWalls => (0.0, 0.0),
            PerceptionModel::PsiGamma => {
                let c = Comparison::new(self.maps, merged, &self.maps[map], x, p.sigma_cells);
                (psi::psi(&c, p.classes), gamma::gamma(&c))
            }
        };
        NextPose { map, t_world_map: x, covariance, evidence, probability, any, psi, gamma }
    }
}

/// For whoever records a merge.
impl VirtualRobot<'_> {
    /// Psi and gamma of poses offered to a state, whatever model weighs them: the paper's perception.
    pub fn terms(&self, merged: &Overlay, modes: &[NextPose]) -> Vec<(f64, f64)> {
        let p = &self.config.perception;
        if p.model == PerceptionModel::PsiGamma {
            return modes.iter().map(|m| (m.psi, m.gamma)).collect();
        }
        // The walls' model keeps no cells of the merged map.
        let mut layers: Vec<_> = merged.layers().collect();
        layers.reverse();
        let with_cells = layers.into_iter().fold(Overlay::default(), |below, l| {
            below.with(self.maps, l.map, l.t_world_map, l.probability, true)
        });
        let of_mode = |m: &NextPose| {
            let local = &self.maps[m.map];
            let c = Comparison::new(self.maps, &with_cells, local, m.t_world_map, p.sigma_cells);
            (psi::psi(&c, p.classes), gamma::gamma(&c))
        };
        parallel::map(modes, of_mode)
    }
}

/// Odds of a pose against the map lying at none of those followed.
fn log_odds(pose: &NextPose) -> f64 {
    pose.probability.max(1e-12).ln() - (1.0 - pose.any).max(1e-12).ln()
}

impl Model for VirtualRobot<'_> {
    type State = Overlay;
    type Mode = NextPose;

    fn propose(&self, merged: &Overlay) -> Vec<NextPose> {
        let here = self.here(merged);
        if let Some(order) = self.order {
            // Known order: the next map that can be placed; those that cannot yet are deferred. Maps
            // that the order leaves out come after.
            let next = order.iter().filter(|m| self.open[**m] && !here.is_placed[**m]);
            let of_map = |m: &usize| self.perceive(&here, *m, &self.motions(&here.placed, *m));
            if let Some(modes) = next.map(of_map).find(|modes| !modes.is_empty()) {
                return modes;
            }
        }
        // Unknown order: every open map is a candidate, the best supported are weighed.
        let mut by_map = self.all_motions(&here);
        by_map.sort_by(|a, b| b.1[0].0.total_cmp(&a.1[0].0));
        // One order for all particles, that of the surest next: else hardly two of them would place the same maps before
        // the very end, and each would have to weigh all by itself. The paper's model has no say in whether a map is
        // placed at all: it weighs the poses of all maps against each other, as long as they are few.
        let is_one_order =
            self.is_large() || self.config.perception.model == PerceptionModel::OrientedWalls;
        let is_sure = |m: &NextPose| is_one_order && m.any >= SURE;
        let mut modes: Vec<NextPose> = Vec::new();
        let mut missing = self.config.filter.maps_per_step;
        let mut left = by_map.as_slice();
        while missing > 0 && !left.is_empty() && !modes.iter().any(is_sure) {
            // As many at a time as are missing, so that none is weighed for nothing; the first alone, as it is mostly
            // sure.
            let at_once = if is_one_order && left.len() == by_map.len() { 1 } else { missing };
            let (next, rest) = left.split_at(at_once.min(left.len()));
            for found in parallel::map(next, |(map, motions)| self.perceive(&here, *map, motions)) {
                missing -= usize::from(!found.is_empty());
                modes.extend(found);
            }
            left = rest;
        }
        if is_one_order {
            let surest = modes.iter().map(|m| (m.any.min(SURE), m.map));
            // Of those that are sure the one that its pairs support best, whatever the noise of draws.
            let surest = surest.reduce(|a, b| if b.0 > a.0 { b } else { a });
            modes.retain(|m| Some(m.map) == surest.map(|(_, map)| map));
        }
        modes
    }

    fn log_masses(&self, pool: &[&[NextPose]]) -> Vec<Vec<LogWeight>> {
        match self.config.perception.model {
            PerceptionModel::OrientedWalls => pool
                .iter()
                .map(|modes| modes.iter().map(|m| LogWeight(log_odds(m))).collect())
                .collect(),
            PerceptionModel::PsiGamma => {
                // p(z_t | m_t-1, x_j) proportional to Psi~_j gamma~_j over the pool of all particles.
                let all = || pool.iter().flat_map(|modes| modes.iter());
                let psi: Vec<f64> = all().map(|m| m.psi).collect();
                let gamma: Vec<f64> = all().map(|m| m.gamma).collect();
                let floor = self.config.perception.gamma_floor;
                let mut product = pool::normalise(&psi, &gamma, floor).product.into_iter();
                let mut take = |modes: &&[NextPose]| {
                    product.by_ref().take(modes.len()).map(|p| LogWeight(p.ln())).collect()
                };
                pool.iter().map(&mut take).collect()
            }
        }
    }

    fn log_mass_of_staying(&self, masses: &[Vec<LogWeight>]) -> LogWeight {
        match self.config.perception.model {
            // The null hypothesis, that the map lies elsewhere, is what the odds are taken against.
            PerceptionModel::OrientedWalls => LogWeight::ONE,
            // Relative weights know no null: staying is worth as little as the worst pose.
            PerceptionModel::PsiGamma => masses
                .iter()
                .flatten()
                .copied()
                .filter(|w| !w.is_zero())
                .min_by(|a, b| a.0.total_cmp(&b.0))
                .unwrap_or(LogWeight::ONE),
        }
    }

    fn advance(&self, merged: &Overlay, mode: &NextPose, rng: &mut Stream) -> Overlay {
        let noise = Vector3::from_fn(|_, _| StandardNormal.sample(rng));
        // The Gaussian is an approximation near its mode: it says nothing of places farther off than
        // the walls' own noise, which matters along a corridor that fixes one axis only.
        let sigma = self.config.perception.wall_sigma;
        let near = Matrix3::from_diagonal(&Vector3::new(sigma, sigma, 0.02).map(|s| 1.0 / (s * s)));
        let information = mode.covariance.try_inverse().unwrap_or_else(Matrix3::zeros) + near;
        let spread = information
            .try_inverse()
            .and_then(|c| c.cholesky())
            .map_or_else(Matrix3::zeros, |c| c.l());
        let t_world_map = mode.t_world_map.perturbed(&(spread * noise));
        self.fold(merged, mode.map, t_world_map, mode.any)
    }

    /// What [`Memory::similar`] answers hangs on who asked first.
    fn learns(&self) -> bool {
        self.is_large()
    }

    fn is_due(&self, merged: &Overlay) -> bool {
        self.is_due_to_settle(merged)
    }

    fn settled(&self, merged: &Overlay) -> Overlay {
        self.settle(merged)
    }

    fn is_same(&self, a: &Overlay, b: &Overlay) -> bool {
        self.is_same_story(a, b)
    }
}
