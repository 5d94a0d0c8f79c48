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
use crate::perception::held::{self, AxesPose, Held, Puller};
use crate::perception::likelihood::{self, WallEvidence};
use crate::perception::placed::Placed;
use crate::perception::pull::Pull;
use crate::registration::climb::LEVER;
use crate::se2::{Rigid, Se2, Vec2};
use nalgebra::{Matrix3, Vector3};

/// Most rounds in which every patch is moved once: those in which walls are found anew, and those in which walls that
/// were found before are held, for much less.
const FINDING: [bool; 7] = [true, false, true, false, true, false, false];
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

    /// Where it takes its map's axes.
    fn moved(&self, (theta, t): &AxesPose) -> AxesPose {
        let motion = Rigid::from_parts(self.apply(Vec2::zeros()), self.sin_cos);
        (theta + self.turn, motion.compose(t))
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
    (samples, step): (&[&[Block]], usize),
    config: &PerceptionConfig,
) -> Unbent {
    let maps = || others.iter().map(|o| o.map).chain([from]);
    let resolution = maps().map(|m| m.grid.resolution()).fold(0.0, f64::max);
    let reach = maps().map(LocalMap::reach).fold(f64::INFINITY, f64::min);
    let finest = config.wall_sigma.max(resolution);
    // Neighbouring samples are correlated.
    let discount = step as f64 * from.spacing / config.correlation_length / (finest * finest);
    let pullers: Vec<Puller> = others.iter().map(Puller::new).collect();
    let edges: Vec<Vec<Edge>> = from.patches.iter().map(|p| edges(p, config)).collect();
    let motion = |p: &Patch| Motion::none(rigid.apply(p.center));
    let mut motions: Vec<Motion> = from.patches.iter().map(motion).collect();
    let of_map = rigid.compose(&from.grid.origin());
    let of_map = (of_map.theta, of_map.to_rigid());
    let held = samples.iter().zip(&motions).map(|(s, m)| Held::new(s, &of_map, m.center));
    let mut held: Vec<Held> = held.collect();
    let leash = 1.0 / (LEASH * LEASH);
    let mut scale = 0.5 * reach;
    for is_finding in FINDING {
        let mut moved = 0.0f64;
        for (k, patch) in from.patches.iter().enumerate() {
            let here = motions[k];
            if is_finding {
                let at = here.center + here.shift;
                let near = pullers.iter().filter(|p| p.sees(at, patch.radius));
                held[k].find(samples[k], &here.moved(&of_map), near);
            }
            let (mut h, mut g) = (Matrix3::zeros(), Vector3::zeros());
            // Half of the patches lie where the others show nothing.
            if held[k].is_pulled() {
                let mut pull = Pull::new(Vec2::zeros(), scale);
                held::pull_of(&held[k], here.sin_cos, here.shift, &mut pull);
                let (of_walls, back) = pull.equations();
                (h, g) = (discount * of_walls, discount * back);
            }
            let mut stiffness = Vector3::new(leash, leash, 0.0);
            g += stiffness.component_mul(&here.shift.push(here.turn));
            for edge in &edges[k] {
                let other = &motions[edge.to];
                let off = here.center + here.shift - other.apply(here.center);
                stiffness += edge.stiffness;
                g += edge.stiffness.component_mul(&off.push(here.turn - other.turn));
            }
            h += Matrix3::from_diagonal(&stiffness);
            let step = solved(&h, &g);
            motions[k].step(&-step);
            moved = moved.max(step.xy().norm() + LEVER * step.z.abs());
        }
        if scale <= finest && moved < STILL * resolution {
            break;
        }
        scale = (NARROWING * scale).max(finest);
    }
    let cost = edges.iter().zip(&motions).map(|(edges, m)| {
        let of_edge = edges.iter().map(|edge| {
            let other = &motions[edge.to];
            let off = (m.shift + m.center - other.apply(m.center)).push(m.turn - other.turn);
            edge.stiffness.dot(&off.component_mul(&off))
        });
        // Half the square, and every edge is told of from both its ends.
        0.25 * of_edge.sum::<f64>()
    });
    Unbent { cost: cost.sum(), poses: motions.iter().map(|m| m.pose(rigid)).collect() }
}

/// What a symmetric matrix takes to `g`, by its cofactors: a factorisation waits for three divisions and three roots. Where
/// it is singular, as nothing holds a lone patch's turn, nothing moves.
fn solved(h: &Matrix3<f64>, g: &Vector3<f64>) -> Vector3<f64> {
    let (x, y, z) = (h.column(0), h.column(1), h.column(2));
    let (yz, zx, xy) = (y.cross(&z), z.cross(&x), x.cross(&y));
    let determinant = x.dot(&yz);
    if !(determinant > 0.0 && determinant.is_finite()) {
        return Vector3::zeros();
    }
    Vector3::new(yz.dot(g), zx.dot(g), xy.dot(g)) / determinant
}

/// A neighbour of a patch, and the inverse variances of (x, y, theta) between the two.
struct Edge {
    to: usize,
    stiffness: Vector3<f64>,
}

fn edges(patch: &Patch, config: &PerceptionConfig) -> Vec<Edge> {
    // Drift is a random walk: its variance grows with the way.
    let (shift, turn) = (config.bend_shift.powi(-2), config.bend_turn.powi(-2));
    let at_one = Vector3::new(shift, shift, turn);
    let edge =
        |(to, distance): &(u32, f64)| Edge { to: *to as usize, stiffness: at_one / *distance };
    patch.neighbours.iter().map(edge).collect()
}

/// What the patches of one placed map say of others; every `step`-th wall sample is asked.
pub fn of_patches(
    from: &Placed,
    others: &[Placed],
    step: usize,
    config: &PerceptionConfig,
) -> WallEvidence {
    let asked = from.samples.map(|samples| {
        let mut asked = vec![false; from.map.samples.len()];
        samples.iter().for_each(|k| asked[*k as usize] = true);
        asked
    });
    // Of each patch the samples that are asked, and how many all of them are that speak for the map.
    let of_patch = |patch: &Patch| {
        let is_asked = |k: &&u32| asked.as_ref().is_none_or(|asked| asked[**k as usize]);
        let own = || patch.samples.iter().filter(is_asked);
        let all = own().count();
        if step == 1 && all == patch.samples.len() {
            return (None, all);
        }
        (Some(blocks::of(own().step_by(step).map(|k| &from.map.probes[*k as usize]))), all)
    };
    let of_patches: Vec<(Option<Vec<Block>>, usize)> =
        from.map.patches.iter().map(of_patch).collect();
    let samples = from.map.patches.iter().zip(&of_patches);
    let samples: Vec<&[Block]> =
        samples.map(|(p, (some, _))| some.as_ref().unwrap_or(&p.blocks).as_slice()).collect();
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
        let all = of_patches[k].1;
        let taken = all.div_ceil(step).max(1);
        let said = likelihood::one_way(samples[k], from.map, pose, &near, config);
        sum.add(&said, all as f64 / taken as f64);
    }
    sum.bending = unbent.cost;
    sum.log_likelihood -= unbent.cost;
    sum
}
