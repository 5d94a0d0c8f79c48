//! The virtual robot (paper, section 2): map merging as the particle filter's model.
//!
//! At step t the robot stands at the origin of local map phi_t: its pose x_t is `T_world_map` of that
//! map, the local map is its sensor reading z_t, and its odometry u_t comes from registering similar
//! structures. The state is the trajectory, which holds the merge order, and the merged map.

use crate::config::{Config, PerceptionModel};
use crate::filter::{LogWeight, Model, Stream};
use crate::forbidden;
use crate::local_map::LocalMap;
use crate::pair_table::PairTable;
use crate::parallel;
use crate::perception::placed::{self, Placed};
use crate::perception::psi::Comparison;
use crate::perception::{gamma, pool, psi, Overlay, WallEvidence};
use crate::prior::{self, Fit, Prior};
use crate::registration::pair::log_search_volume;
use crate::registration::{climb, SAME_WORLD};
use crate::relation::Relation;
use crate::result::Known;
use crate::se2::Se2;
use crate::verdict::{self, Background};
use nalgebra::{Matrix3, Vector3};
use rand_distr::{Distribution, StandardNormal};

/// Particles that lie closer than this (metres, radians) differ by the noise of their draws alone.
const NOISE: (f64, f64) = (0.2, 0.04);

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
    /// Registration of all pairs: the odometry.
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

    /// What is known of a map's pose.
    pub fn prior(&self, map: usize) -> Option<&Prior> {
        self.known.priors.get(map).and_then(Option::as_ref)
    }

    /// How what is known of a map takes its poses in the frame of some placed maps; none where nothing is. Of
    /// several that tell of it the strongest counts, since they may tell the same; none may be contradicted.
    fn prior_fit<'s>(
        &'s self,
        placed: &[(usize, Se2)],
        map: usize,
    ) -> Option<impl Fn(&Se2, &Matrix3<f64>) -> Option<Fit> + 's> {
        let known = placed.iter().filter_map(|(m, t)| Some((*t, self.prior(*m)?)));
        let of_prior = self
            .prior(map)
            .and_then(|prior| Some((prior, Prior::of_frame(&known.collect::<Vec<_>>())?)));
        let relations = &self.known.relations;
        let to_map = |(m, t): &(usize, Se2)| {
            let (m, t) = (*m, *t);
            relations.iter().filter_map(move |r| Some((t, r.between(m, map)?)))
        };
        let of_relations: Vec<(Se2, Relation)> = placed.iter().flat_map(to_map).collect();
        if of_prior.is_none() && of_relations.is_empty() {
            return None;
        }
        let volume = |(m, _): &(usize, Se2)| log_search_volume(&self.maps[*m], &self.maps[map]);
        let volume = placed.iter().map(volume).fold(0.0, f64::max);
        Some(move |t: &Se2, covariance: &Matrix3<f64>| {
            let mut best = Fit { log_odds: f64::NEG_INFINITY, pose: *t };
            if let Some((prior, frame)) = &of_prior {
                best = prior.fit(frame, t, covariance, volume)?;
            }
            for (x_i, relation) in &of_relations {
                let own = x_i.inverse().transport_covariance(covariance);
                let fit = relation.fit(&x_i.between(&best.pose), &own, volume)?;
                let log_odds = fit.log_odds.max(best.log_odds);
                best = Fit { log_odds, pose: x_i.compose(&fit.pose) };
            }
            Some(best)
        })
    }

    fn fold(&self, merged: &Overlay, map: usize, t_world_map: Se2, probability: f64) -> Overlay {
        let cells = self.config.perception.model == PerceptionModel::PsiGamma;
        merged.with(self.maps, map, t_world_map, probability, cells)
    }

    /// Motion model (paper, section 3): where the placed maps say that `map` lies. Modes of several
    /// placed maps that agree are one, and support each other.
    fn motions(&self, placed: &[(usize, Se2)], map: usize) -> Vec<(f64, Se2, Matrix3<f64>)> {
        let center = self.maps[map].center.unwrap_or_default();
        let mut found: Vec<(f64, Se2, Matrix3<f64>)> = Vec::new();
        for (i, x_i) in placed {
            for (t, covariance, log_likelihood) in self.pairs.modes(*i, map) {
                found.push((
                    log_likelihood,
                    x_i.compose(&t),
                    x_i.transport_covariance(&covariance),
                ));
            }
        }
        if let Some(fit) = self.prior_fit(placed, map) {
            let near = |(support, x, covariance): (f64, Se2, Matrix3<f64>)| {
                fit(&x, &covariance).map(|f| (support + f.log_odds, f.pose, covariance))
            };
            found = found.into_iter().filter_map(near).collect();
        }
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut kept: Vec<(f64, Se2, Matrix3<f64>)> = Vec::new();
        for (support, x, covariance) in found {
            let same = |k: &&mut (f64, Se2, Matrix3<f64>)| {
                k.1.is_close_at(&x, center, SAME_WORLD.0, SAME_WORLD.1)
            };
            match kept.iter_mut().find(same) {
                Some(k) => k.0 += support.max(0.0),
                None => kept.push((support, x, covariance)),
            }
        }
        // What no pair speaks for no group of placed maps speaks for either.
        kept.retain(|k| k.0 > 0.0);
        kept.sort_by(|a, b| b.0.total_cmp(&a.0));
        kept.truncate(self.config.filter.candidates_per_map);
        kept
    }

    /// What the walls say of a map against the merged map. The walls of merged maps are those of the
    /// maps they are merged of, which no raster has blurred: the pose is led to their maximum first.
    fn look(&self, merged: &Overlay, map: usize, x: Se2) -> (Se2, WallEvidence) {
        let p = &self.config.perception;
        let Some(parts) = &self.parts else {
            return (x, forbidden::against(self.maps, merged, map, &x, self.known, p));
        };
        let of = |map: usize, x: &Se2| forbidden::members(&parts.overlays[map], parts.maps, x);
        let placed = merged.layers().flat_map(|l| of(l.map, &l.t_world_map)).collect();
        let (placed, own) = forbidden::evidence(placed, of(map, &Se2::IDENTITY), parts.known);
        let most = self.config.registration.max_iterations;
        let x = climb::climb_group(&placed, &own, &x, most, p).unwrap_or(x);
        let moved = own.iter().map(|m| Placed { t_world_map: x.compose(&m.t_world_map), ..*m });
        let moved: Vec<Placed> = moved.collect();
        (x, placed::between(&placed, &moved, p))
    }

    /// Whether a pose puts two maps where their walls match best although that match is wrong.
    fn is_refused(&self, merged: &Overlay, map: usize, x: &Se2) -> bool {
        let placed = || merged.layers().map(|l| (l.map, l.t_world_map));
        match &self.parts {
            None if self.known.forbidden.is_empty() => false,
            Some(parts) if parts.known.forbidden.is_empty() => false,
            None => {
                let below: Vec<_> = placed().collect();
                forbidden::is_refused(&below, &[(map, *x)], self.pairs, self.maps)
            }
            Some(parts) => {
                let of = |(map, x): (usize, Se2)| {
                    let layers = parts.overlays[map].layers();
                    layers.map(move |l| (l.map, x.compose(&l.t_world_map)))
                };
                let (below, own): (Vec<_>, Vec<_>) =
                    (placed().flat_map(of).collect(), of((map, *x)).collect());
                forbidden::is_refused(&below, &own, parts.pairs, parts.maps)
            }
        }
    }

    /// Perception model (paper, section 4) of the poses at which a map may lie; none when the evidence does
    /// not carry a merge.
    fn perceive(
        &self,
        merged: &Overlay,
        map: usize,
        motions: Vec<(f64, Se2, Matrix3<f64>)>,
    ) -> Vec<NextPose> {
        let center = self.maps[map].center.unwrap_or_default();
        let mut seen: Vec<(Se2, Matrix3<f64>, WallEvidence)> = Vec::new();
        for (_, x, covariance) in motions {
            let (x, evidence) = self.look(merged, map, x);
            if self.is_refused(merged, map, &x) {
                continue;
            }
            // Motions that led to the same place are one.
            let (distance, angle) = SAME_WORLD;
            if !seen.iter().any(|(y, ..)| x.is_close_at(y, center, distance, angle)) {
                seen.push((x, covariance, evidence));
            }
        }
        seen.sort_by(|a, b| b.2.log_likelihood.total_cmp(&a.2.log_likelihood));
        let decoy = merged.layers().map(|l| self.pairs.decoy(l.map, map)).fold(0.0, f64::max);
        // Merged maps are judged by the size of the maps they are merged of, as every map is.
        let members = |m: usize| -> Vec<&LocalMap> {
            match &self.parts {
                Some(parts) => parts.overlays[m].layers().map(|l| &parts.maps[l.map]).collect(),
                None => vec![&self.maps[m]],
            }
        };
        let involved = merged.layers().map(|l| l.map).chain([map]).flat_map(members);
        let background = Background::new(involved, self.rung, decoy);
        let c = &self.config.evidence;
        let poses: Vec<&WallEvidence> = seen.iter().map(|(.., e)| e).collect();
        let mut verdict = verdict::weigh(&poses, &background, c);
        let placed: Vec<(usize, Se2)> = merged.layers().map(|l| (l.map, l.t_world_map)).collect();
        if let Some(fit) = self.prior_fit(&placed, map) {
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
        let placed: Vec<(usize, Se2)> = merged.layers().map(|l| (l.map, l.t_world_map)).collect();
        let is_open = |m: &usize| self.open[*m] && !placed.iter().any(|(i, _)| i == m);
        let of_map = |map: usize, motions: Vec<(f64, Se2, Matrix3<f64>)>| -> Vec<NextPose> {
            self.perceive(merged, map, motions)
        };
        if let Some(order) = self.order {
            // Known order: the next map that can be placed; those that cannot yet are deferred. Maps
            // that the order leaves out come after.
            let next = order.iter().filter(|m| is_open(m));
            let modes =
                next.map(|m| of_map(*m, self.motions(&placed, *m))).find(|modes| !modes.is_empty());
            if let Some(modes) = modes {
                return modes;
            }
        }
        // Unknown order: every open map is a candidate, the best supported are weighed.
        let mut by_map: Vec<(usize, Vec<_>)> = (0..self.maps.len())
            .filter(is_open)
            .map(|m| (m, self.motions(&placed, m)))
            .filter(|(_, motions)| !motions.is_empty())
            .collect();
        by_map.sort_by(|a, b| b.1[0].0.total_cmp(&a.1[0].0));
        let mut modes = Vec::new();
        let mut maps_found = 0;
        for (map, motions) in by_map {
            let found = of_map(map, motions);
            maps_found += usize::from(!found.is_empty());
            modes.extend(found);
            if maps_found == self.config.filter.maps_per_step {
                break;
            }
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

    /// Particles that tell the same story, in whatever order, differ by the noise of their draws alone. The
    /// joint refinement settles that; it is not worth weighing every map anew for each of them.
    fn is_same(&self, a: &Overlay, b: &Overlay) -> bool {
        a.is_same(b)
            || a.layers().count() == b.layers().count()
                && a.layers().all(|x| {
                    let center = self.maps[x.map].center.unwrap_or_default();
                    b.layers().any(|y| {
                        let (distance, angle) = NOISE;
                        x.map == y.map
                            && x.t_world_map.is_close_at(&y.t_world_map, center, distance, angle)
                    })
                })
    }
}
