//! The filter's model: odometry proposes, scan matching improves, the scan is folded in.

use super::grid::Grid;
use mapmeld_core::filter::{LogWeight, Model, Stream};
use mapmeld_core::se2::{Se2, Vec2};
use nalgebra::{Matrix3, Vector3};
use rand_distr::{Distribution, StandardNormal};
use std::sync::Arc;

/// Noise of a step's odometry as the filter believes it: metres, metres, radians.
const ODOMETRY: [f64; 3] = [0.06, 0.06, 0.03];
/// Turns off the odometry's guess that scan matching starts from as well, radians.
const STARTS: [f64; 3] = [0.0, -0.06, 0.06];
/// Distance of the samples around a maximum: metres, metres, radians.
const SAMPLES: [f64; 3] = [0.02, 0.02, 0.008];

/// A particle: where the robot is, where it was, and the map that follows from that.
#[derive(Clone)]
pub struct State {
    /// Where it is.
    pub pose: Se2,
    /// What it has seen.
    pub grid: Grid,
    past: Option<Arc<Past>>,
}

/// Former poses, shared by all that stem from them.
struct Past {
    pose: Se2,
    before: Option<Arc<Past>>,
}

impl State {
    /// At the first pose, with the first scan.
    pub fn start(pose: Se2, scan: &[f64]) -> Self {
        let mut grid = Grid::new();
        grid.fold(&pose, scan);
        Self { pose, grid, past: None }
    }

    /// All poses so far, the first one first.
    pub fn path(&self) -> Vec<Se2> {
        let past = std::iter::successors(self.past.as_ref(), |p| p.before.as_ref());
        let mut path: Vec<Se2> = std::iter::once(self.pose).chain(past.map(|p| p.pose)).collect();
        path.reverse();
        path
    }
}

/// A place that scan matching found.
pub struct Match {
    mean: Se2,
    covariance: Matrix3<f64>,
    log_mass: f64,
}

/// One step's readings.
pub struct Robot<'a> {
    /// u_t: the motion since the last step, as the wheels tell.
    pub odometry: &'a Se2,
    /// z_t: ranges, metres.
    pub scan: &'a [f64],
}

impl Robot<'_> {
    /// log p(z | m, x) p(x | x', u)
    fn log_target(&self, state: &State, guess: &Se2, x: &Se2) -> f64 {
        let d = x.minus(guess).component_div(&Vector3::from(ODOMETRY));
        state.grid.log_likelihood(x, self.scan) - 0.5 * d.norm_squared()
    }

    /// Scan matching: uphill along the axes, in steps that get smaller.
    fn climb(&self, state: &State, guess: &Se2, start: &Se2) -> Se2 {
        let (mut x, mut best) = (*start, self.log_target(state, guess, start));
        let mut step = Vector3::new(0.08, 0.08, 0.04);
        while step.x > 0.004 {
            let before = best;
            for (axis, sign) in [(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0), (2, 1.0), (2, -1.0)] {
                let mut d = Vector3::zeros();
                d[axis] = sign * step[axis];
                let next = x.perturbed(&d);
                let value = self.log_target(state, guess, &next);
                if value > best {
                    (x, best) = (next, value);
                }
            }
            if best == before {
                step *= 0.5;
            }
        }
        x
    }

    /// The Gaussian at a maximum and its mass, from the target's values around it.
    fn sample(&self, state: &State, guess: &Se2, top: &Se2) -> Match {
        let points: Vec<(Vector3<f64>, f64)> = (0..27)
            .map(|k| {
                let d = Vector3::new(k % 3, k / 3 % 3, k / 9).map(|v| f64::from(v) - 1.0);
                let d = d.component_mul(&Vector3::from(SAMPLES));
                (d, self.log_target(state, guess, &top.perturbed(&d)))
            })
            .collect();
        let highest = points.iter().map(|p| p.1).fold(f64::NEG_INFINITY, f64::max);
        let mass: f64 = points.iter().map(|p| (p.1 - highest).exp()).sum();
        let weighted = points.iter().map(|(d, v)| (d, (v - highest).exp() / mass));
        let mean: Vector3<f64> = weighted.clone().map(|(d, w)| d * w).sum();
        let covariance = weighted.map(|(d, w)| (d - mean) * (d - mean).transpose() * w).sum();
        Match { mean: top.perturbed(&mean), covariance, log_mass: highest + mass.ln() }
    }
}

impl Model for Robot<'_> {
    type State = State;
    type Mode = Match;

    fn propose(&self, state: &State) -> Vec<Match> {
        let guess = state.pose.compose(self.odometry);
        let mut tops: Vec<Se2> = Vec::new();
        for turn in STARTS {
            let start = guess.perturbed(&Vector3::new(0.0, 0.0, turn));
            let top = self.climb(state, &guess, &start);
            if !tops.iter().any(|t| t.is_close_at(&top, Vec2::zeros(), 0.06, 0.03)) {
                tops.push(top);
            }
        }
        tops.iter().map(|t| self.sample(state, &guess, t)).collect()
    }

    fn log_masses(&self, pool: &[&[Match]]) -> Vec<Vec<LogWeight>> {
        pool.iter().map(|m| m.iter().map(|m| LogWeight(m.log_mass)).collect()).collect()
    }

    fn log_mass_of_staying(&self, _: &[Vec<LogWeight>]) -> LogWeight {
        LogWeight::ZERO // Not asked for: scan matching always ends somewhere.
    }

    fn advance(&self, state: &State, mode: &Match, rng: &mut Stream) -> State {
        let noise = Vector3::from_fn(|_, _| StandardNormal.sample(rng));
        let covariance = mode.covariance + Matrix3::identity() * 1e-8;
        let spread = covariance.cholesky().expect("the floor makes it positive").l();
        let pose = mode.mean.perturbed(&(spread * noise));
        let mut grid = state.grid.clone();
        grid.fold(&pose, self.scan);
        let past = Some(Arc::new(Past { pose: state.pose, before: state.past.clone() }));
        State { pose, grid, past }
    }
}
