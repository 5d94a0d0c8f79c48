//! Evidence of bent maps: no rigid pose is exact then, yet the walls lie right once the map is unbent.
//!
//! The wall samples of a map are taken in patches, each with a small motion of its own. Walls pull the patches
//! into place; neighbouring patches hold on to each other, as stiff as drift allows (an embedded deformation
//! graph: Sumner, Schmid, Pauly, "Embedded deformation for shape manipulation", SIGGRAPH 2007). The bending is
//! paid for, as improbable as drift makes it, so that maps which agree by chance cannot be bent until they fit:
//! chance moves neighbouring patches different ways.

use crate::blocks::{self, Block};
use crate::config::PerceptionConfig;
use crate::local_map::{LocalMap, Patch};
use crate::perception::likelihood::{self, WallEvidence};
use crate::perception::placed::Placed;
use crate::perception::pull::{Matches, Pull};
use crate::se2::{Rigid, Se2, Vec2};
use nalgebra::{Matrix3, Vector3};

/// Most rounds in which every patch is moved once.
const ROUNDS: usize = 7;
/// Steps shorter than this, in cells, move nothing any more.
const STILL: f64 = 0.02;
/// How much the kernel narrows from round to round.
const NARROWING: f64 = 0.65;
/// Standard deviation of a patch's motion against the rigid pose, metres: holds loose patches.
const LEASH: f64 = 0.5;

/// The motion of one patch against the rigid pose: a turn about the patch's centre, then a shift.
#[derive(Debug, Clone, Copy)]
struct Motion {
    /// The centre in the world, as the rigid pose has it.
    center: Vec2,
    shift: Vec2,
    turn: f64,
    /// Sine and cosine of the turn: asked of more often than it changes.
    sin_cos: (f64, f64),
}

impl Motion {
    fn none(center: Vec2) -> Self {
        Self { center, shift: Vec2::zeros(), turn: 0.0, sin_cos: (0.0, 1.0) }
    }

    /// Goes on by a step.
    fn step(&mut self, step: &Vector3<f64>) {
        self.shift += step.xy();
        self.turn += step.z;
        self.sin_cos = self.turn.sin_cos();
    }

    /// Where the motion takes a point of the world.
    fn apply(&self, p: Vec2) -> Vec2 {
        let (r, (s, c)) = (p - self.center, self.sin_cos);
        self.center + self.shift + Vec2::new(c * r.x - s * r.y, s * r.x + c * r.y)
    }

    /// The patch's own pose.
    fn pose(&self, rigid: &Se2) -> Se2 {
        let moved = self.apply(rigid.translation());
        Se2::from_parts(moved, rigid.theta + self.turn)
    }
}

/// A map that patches are pulled by, at its place.
struct Puller<'a> {
    placed: Placed<'a>,
    t_axes_world: Se2,
    to_axes: Rigid,
    /// Turns (x, y, theta) from the grid's axes to the world's.
    turn: Matrix3<f64>,
}

impl<'a> Puller<'a> {
    fn new(placed: &Placed<'a>) -> Self {
        let t_world_axes = placed.t_world_map.compose(&placed.map.grid.origin());
        let (s, c) = t_world_axes.theta.sin_cos();
        let turn = Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0);
        let t_axes_world = t_world_axes.inverse();
        Self { placed: *placed, t_axes_world, to_axes: t_axes_world.to_rigid(), turn }
    }

    /// False when nothing within a circle, a point of the world and a radius in metres, can lie on the grid.
    fn sees(&self, center: Vec2, radius: f64) -> bool {
        self.placed.map.reaches(self.to_axes.apply(center), radius)
    }

    /// What the walls pull the probes of a patch towards, whose map's axes lie at `t_world_from`: information and
    /// gradient of (x, y, theta), turning about `at`, a point of the world.
    fn pull(
        &self,
        probes: &[Block],
        t_world_from: &Se2,
        at: Vec2,
        scale: f64,
    ) -> (Matrix3<f64>, Vector3<f64>) {
        // `t_axes_world * t_world_from`, whose sine and cosine are at hand.
        let shift = self.to_axes.apply(t_world_from.translation());
        let turn = self.t_axes_world.theta + t_world_from.theta;
        let view = self.placed.map.probe_view(&Se2::from_parts(shift, turn));
        let mut pull = Pull::new(self.to_axes.apply(at), scale);
        for block in probes {
            let s = view.see(block);
            let w = view.walls(&s, 0);
            let residual = w.residuals(&s);
            pull.add(&Matches { x: s.x, y: s.y, nx: w.nx, ny: w.ny, residual });
        }
        (self.turn * pull.information() * self.turn.transpose(), self.turn * pull.gradient())
    }
}

/// A map unbent against others: the pose of each of its patches.
pub struct Unbent {
    /// Poses in the world, one a patch.
    pub poses: Vec<Se2>,
    /// How improbable the bending is, nats.
    pub cost: f64,
}

/// Moves the patches of a placed map to where they fit the others. `samples` are those of each patch that are asked,
/// each of which stands for `step`.
pub fn unbend(
    from: &LocalMap,
    rigid: &Se2,
    others: &[Placed],
    (samples, step): (&[Vec<Block>], usize),
    config: &PerceptionConfig,
) -> Unbent {
    let maps = || others.iter().map(|o| o.map).chain([from]);
    let resolution = maps().map(|m| m.grid.resolution()).fold(0.0, f64::max);
    let reach = maps().map(LocalMap::reach).fold(f64::INFINITY, f64::min);
    let finest = config.wall_sigma.max(resolution);
    // Neighbouring samples are correlated.
    let discount = step as f64 * from.spacing / config.correlation_length / (finest * finest);
    let pullers: Vec<Puller> = others.iter().map(Puller::new).collect();
    let motion = |p: &Patch| Motion::none(rigid.apply(p.center));
    let mut motions: Vec<Motion> = from.patches.iter().map(motion).collect();
    let mut scale = 0.5 * reach;
    for _ in 0..ROUNDS {
        let mut moved = 0.0f64;
        for (k, patch) in from.patches.iter().enumerate() {
            let here = motions[k];
            let pose = here.pose(rigid).compose(&from.grid.origin());
            let leash = 1.0 / (LEASH * LEASH);
            let mut h = Matrix3::from_diagonal(&Vector3::new(leash, leash, 0.0));
            let mut g = Vector3::new(here.shift.x * leash, here.shift.y * leash, 0.0);
            let at = here.center + here.shift;
            let near = pullers.iter().filter(|p| p.sees(at, patch.radius));
            for puller in near {
                let of_walls = puller.pull(&samples[k], &pose, at, scale);
                h += discount * of_walls.0;
                g += discount * of_walls.1;
            }
            for (q, stiffness) in stiffnesses(patch, config) {
                let told = motions[q].apply(here.center) - here.center;
                let off = here.shift - told;
                h += Matrix3::from_diagonal(&stiffness);
                g += stiffness.component_mul(&Vector3::new(
                    off.x,
                    off.y,
                    here.turn - motions[q].turn,
                ));
            }
            let step = h.cholesky().map_or_else(Vector3::zeros, |c| c.solve(&g));
            motions[k].step(&-step);
            moved = moved.max(step.xy().norm() + 5.0 * step.z.abs());
        }
        if scale <= finest && moved < STILL * resolution {
            break;
        }
        scale = (NARROWING * scale).max(finest);
    }
    let cost = from.patches.iter().zip(&motions).map(|(patch, m)| {
        let of_edge = stiffnesses(patch, config).map(|(q, stiffness)| {
            let off = m.shift + m.center - motions[q].apply(m.center);
            let off = Vector3::new(off.x, off.y, m.turn - motions[q].turn);
            stiffness.dot(&off.component_mul(&off))
        });
        // Half the square, and every edge is told of from both its ends.
        0.25 * of_edge.sum::<f64>()
    });
    Unbent { cost: cost.sum(), poses: motions.iter().map(|m| m.pose(rigid)).collect() }
}

/// The neighbours of a patch, with the inverse variances of (x, y, theta) between the two.
fn stiffnesses<'p>(
    patch: &'p Patch,
    config: &'p PerceptionConfig,
) -> impl Iterator<Item = (usize, Vector3<f64>)> + 'p {
    patch.neighbours.iter().map(|(q, distance)| {
        // Drift is a random walk: its variance grows with the way.
        let shift = 1.0 / (config.bend_shift.powi(2) * distance);
        let turn = 1.0 / (config.bend_turn.powi(2) * distance);
        (*q as usize, Vector3::new(shift, shift, turn))
    })
}

/// What the patches of one placed map say of others; every `step`-th wall sample is asked.
pub fn of_patches(
    from: &Placed,
    others: &[Placed],
    step: usize,
    config: &PerceptionConfig,
) -> WallEvidence {
    let mut asked = vec![from.samples.is_none(); from.map.samples.len()];
    from.samples.unwrap_or_default().iter().for_each(|k| asked[*k as usize] = true);
    let samples = |patch: &Patch| {
        let own = patch.samples.iter().filter(|k| asked[**k as usize]);
        blocks::of(own.step_by(step).map(|k| &from.map.probes[*k as usize]))
    };
    let samples: Vec<Vec<Block>> = from.map.patches.iter().map(samples).collect();
    let unbent = unbend(from.map, &from.t_world_map, others, (&samples, step), config);
    let pullers: Vec<Puller> = others.iter().map(Puller::new).collect();
    let mut sum = WallEvidence::default();
    for (k, pose) in unbent.poses.iter().enumerate() {
        let patch = &from.map.patches[k];
        let (at, radius) = (pose.apply(patch.center), patch.radius);
        let near: Vec<Placed> =
            pullers.iter().filter(|p| p.sees(at, radius)).map(|p| p.placed).collect();
        if near.is_empty() {
            continue;
        }
        let all = patch.samples.iter().filter(|s| asked[**s as usize]).count();
        let taken = all.div_ceil(step).max(1);
        let said = likelihood::one_way(&samples[k], from.map, pose, &near, config);
        sum.add(&said, all as f64 / taken as f64);
    }
    sum.bending = unbent.cost;
    sum.log_likelihood -= unbent.cost;
    sum
}
