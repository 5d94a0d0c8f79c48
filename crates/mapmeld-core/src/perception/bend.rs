//! Evidence of bent maps: no rigid pose is exact then, yet the walls lie right once the map is unbent.
//!
//! The wall samples of a map are taken in patches, each with a small motion of its own. Walls pull the patches
//! into place; neighbouring patches hold on to each other, as stiff as drift allows (an embedded deformation
//! graph: Sumner, Schmid, Pauly, "Embedded deformation for shape manipulation", SIGGRAPH 2007). The bending is
//! paid for, as improbable as drift makes it, so that maps which agree by chance cannot be bent until they fit:
//! chance moves neighbouring patches different ways.

use crate::config::PerceptionConfig;
use crate::local_map::{LocalMap, WallSample};
use crate::perception::likelihood::{self, WallEvidence};
use crate::perception::placed::Placed;
use crate::registration::climb::robust_weight;
use crate::se2::{Se2, Vec2};
use nalgebra::{Matrix3, Vector3};

/// Rounds in which every patch is moved once.
const ROUNDS: usize = 10;
/// How much the kernel narrows from round to round.
const NARROWING: f64 = 0.75;
/// Standard deviation of a patch's motion against the rigid pose, metres: holds loose patches.
const LEASH: f64 = 0.5;

/// The motion of one patch against the rigid pose: a turn about the patch's centre, then a shift.
#[derive(Debug, Clone, Copy)]
struct Motion {
    /// The centre in the world, as the rigid pose has it.
    center: Vec2,
    shift: Vec2,
    turn: f64,
}

impl Motion {
    /// Where the motion takes a point of the world.
    fn apply(&self, p: Vec2) -> Vec2 {
        self.center + self.shift + Se2::new(0.0, 0.0, self.turn).rotate(p - self.center)
    }

    /// The patch's own pose.
    fn pose(&self, rigid: &Se2) -> Se2 {
        let moved = self.apply(rigid.translation());
        Se2::from_parts(moved, rigid.theta + self.turn)
    }
}

/// A map unbent against others: the pose of each of its patches.
pub struct Unbent {
    /// Poses in the world, one a patch.
    pub poses: Vec<Se2>,
    /// How improbable the bending is, nats.
    pub cost: f64,
}

/// Moves the patches of a placed map to where they fit the others; `samples` tells the samples of a patch that
/// are asked, each of which stands for `step`.
pub fn unbend<'s, I: Iterator<Item = &'s WallSample>>(
    from: &LocalMap,
    rigid: &Se2,
    others: &[Placed],
    (samples, step): (impl Fn(usize) -> I, usize),
    config: &PerceptionConfig,
) -> Unbent {
    let maps = || others.iter().map(|o| o.map).chain([from]);
    let resolution = maps().map(|m| m.grid.resolution()).fold(0.0, f64::max);
    let reach = maps().map(LocalMap::reach).fold(f64::INFINITY, f64::min);
    let finest = config.wall_sigma.max(resolution);
    // Neighbouring samples are correlated.
    let discount = step as f64 * from.spacing / config.correlation_length / (finest * finest);
    let to_world: Vec<_> = others.iter().map(|o| o.t_world_map.to_rigid()).collect();
    let motion = |c: Vec2| Motion { center: rigid.apply(c), shift: Vec2::zeros(), turn: 0.0 };
    let mut motions: Vec<Motion> = from.patches.iter().map(|p| motion(p.center)).collect();
    let mut scale = 0.5 * reach;
    for _ in 0..ROUNDS {
        for (k, patch) in from.patches.iter().enumerate() {
            let here = motions[k];
            let at = here.center + here.shift;
            let pose = here.pose(rigid);
            let moved = pose.to_rigid();
            let leash = 1.0 / (LEASH * LEASH);
            let mut h = Matrix3::from_diagonal(&Vector3::new(leash, leash, 0.0));
            let mut g = Vector3::new(here.shift.x * leash, here.shift.y * leash, 0.0);
            for (other, to_world) in others.iter().zip(&to_world) {
                let view = other.map.field_view(&other.t_world_map.between(&pose));
                for s in samples(k) {
                    let Some(i) = view.cell(s.position).and_then(|c| view.nearest(c, s.normal))
                    else {
                        continue;
                    };
                    let wall = &other.map.boundary[i];
                    let (p, n) = (moved.apply(s.position), to_world.rotate(wall.normal));
                    let residual = (p - to_world.apply(wall.position)).dot(&n);
                    let r = p - at;
                    let j = Vector3::new(n.x, n.y, n.y * r.x - n.x * r.y);
                    let w = discount * robust_weight(residual, scale);
                    h += w * j * j.transpose();
                    g += w * residual * j;
                }
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
            motions[k].shift -= step.xy();
            motions[k].turn -= step.z;
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
    patch: &'p crate::local_map::Patch,
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
    let samples = |patch: usize| {
        let own = from.map.patches[patch].samples.iter().filter(|k| asked[**k as usize]);
        own.step_by(step).map(|k| &from.map.samples[*k as usize])
    };
    let unbent = unbend(from.map, &from.t_world_map, others, (samples, step), config);
    let mut sum = WallEvidence::default();
    for (k, pose) in unbent.poses.iter().enumerate() {
        let all = from.map.patches[k].samples.iter().filter(|s| asked[**s as usize]).count();
        let taken = all.div_ceil(step).max(1);
        let said = likelihood::one_way(samples(k), from.map, pose, others, config);
        sum.add(&said, all as f64 / taken as f64);
    }
    sum.bending = unbent.cost;
    sum.log_likelihood -= unbent.cost;
    sum
}
