//! Two maps whose walls pull at each other's poses.

use crate::blocks::LANES;
use crate::likelihood_field::ProbeView;
use crate::local_map::{LocalMap, Patch};
use crate::perception::pull::{Matches, Pull};
use crate::probe::Axes;
use crate::registration::climb::robust_weight;
use crate::se2::{Se2, Vec2};
use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

/// Residuals up to about this count as pulling on the poses, metres, even where the kernel lets go of them.
const WIDE: f64 = 0.2;

/// Walls of one map on those of another, in the axes of the other's grid.
struct Facing<'a> {
    view: ProbeView<'a>,
    /// Patches of the one map that may lie on the other.
    patches: Vec<&'a Patch>,
    /// What is turned about, amid the walls: single precision must suffice.
    pivot: Vec2,
    /// Turns (x, y, theta) from the axes to the world.
    turn: Matrix3<f64>,
}

impl<'a> Facing<'a> {
    fn new(
        (from, t_w_from): (&'a LocalMap, &Se2),
        (to, t_w_to): (&'a LocalMap, &Se2),
        pivot: Vec2,
    ) -> Self {
        let t_w_axes = t_w_to.compose(&to.grid.origin());
        let t_axes_from = t_w_axes.between(t_w_from).to_rigid();
        let may_lie = |p: &&Patch| to.reaches(t_axes_from.apply(p.center), p.radius);
        let t_to_from = t_w_to.between(t_w_from);
        let (s, c) = t_w_axes.theta.sin_cos();
        Self {
            view: to.probe_view(Axes::between(&to.grid, &from.grid, &t_to_from)),
            patches: from.patches.iter().filter(may_lie).collect(),
            pivot: t_w_axes.inverse().apply(pivot),
            turn: Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0),
        }
    }

    /// Those of a patch, block by block.
    #[inline(always)]
    fn matches<'p>(&'p self, patch: &'p Patch) -> impl Iterator<Item = Matches> + 'p {
        patch.blocks.iter().map(|block| {
            let s = self.view.see(block);
            let w = self.view.walls(&s, 0);
            Matches { x: s.x, y: s.y, nx: w.nx, ny: w.ny, residual: w.residuals(&s) }
        })
    }
}

/// What all of them pull at.
#[multiversion::multiversion(targets("x86_64+avx2"))]
fn pull_of(facing: &Facing, pull: &mut Pull) {
    for patch in &facing.patches {
        facing.matches(patch).for_each(|m| pull.add(&m));
    }
}

/// What a map at its place turns about: the middle of what is known, since its frame's origin may lie anywhere, and far
/// from all walls.
pub(super) fn center(map: &LocalMap, t_w_map: &Se2) -> Vec2 {
    t_w_map.apply(map.center.unwrap_or_default())
}

/// Two maps at their places. Sums are of (x, y, theta) of the first one, turning about its centre, then of the second.
pub(super) struct Edge<'a> {
    /// Walls of the second on those of the first, and the other way round.
    sides: [Facing<'a>; 2],
    /// A wall turns with its own map, so both Jacobians are taken at the other map's point. That of the first map is
    /// `-(nx, ny, c)`, c the turn of the point about the first centre; that of the second is the same as seen from its
    /// own centre, which this makes of it. So the sums are made of the former alone.
    to_second: Matrix3<f64>,
}

impl<'a> Edge<'a> {
    pub fn new([a, b]: [(&'a LocalMap, &Se2); 2]) -> Self {
        let [pivot, second] = [a, b].map(|(map, t_w_map)| center(map, t_w_map));
        let d = second - pivot;
        let to_second = Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, d.y, -d.x, 1.0);
        Self { sides: [Facing::new(b, a, pivot), Facing::new(a, b, pivot)], to_second }
    }

    /// Information and gradient under a kernel of some scale, metres.
    pub fn normal_equations(&self, scale: f64) -> (Matrix6<f64>, Vector6<f64>) {
        let (mut h, mut g) = (Matrix3::zeros(), Vector3::zeros());
        for (side, sign) in self.sides.iter().zip([1.0, -1.0]) {
            let mut pull = Pull::new(side.pivot, scale);
            pull_of(side, &mut pull);
            let (information, gradient) = pull.equations();
            h += side.turn * information * side.turn.transpose();
            g += sign * (side.turn * gradient);
        }
        let mut of_poses = Vector6::zeros();
        of_poses.fixed_rows_mut::<3>(0).copy_from(&-g);
        of_poses.fixed_rows_mut::<3>(3).copy_from(&(self.to_second * g));
        (self.of_both(&h), of_poses)
    }

    /// Sum of `g g^T` over the patches, and of the squared residuals and their weights.
    pub fn tension(&self, scale: f64) -> (Matrix6<f64>, f64, f64) {
        let (mut pulls, mut squares, mut weight) = (Matrix3::zeros(), 0.0, 0.0);
        for side in &self.sides {
            for patch in &side.patches {
                let mut pull = Pull::new(side.pivot, scale.max(WIDE));
                for m in side.matches(patch) {
                    pull.add(&m);
                    for k in (0..LANES).filter(|k| m.is_there(*k)) {
                        let residual = f64::from(m.residual[k]);
                        let w = robust_weight(residual, scale);
                        squares += w * residual * residual;
                        weight += w;
                    }
                }
                let pull = side.turn * pull.equations().1;
                pulls += pull * pull.transpose();
            }
        }
        (self.of_both(&pulls), squares, weight)
    }

    fn of_both(&self, own: &Matrix3<f64>) -> Matrix6<f64> {
        let mut both = Matrix6::zeros();
        let across = -own * self.to_second.transpose();
        both.fixed_view_mut::<3, 3>(0, 0).copy_from(own);
        both.fixed_view_mut::<3, 3>(0, 3).copy_from(&across);
        both.fixed_view_mut::<3, 3>(3, 0).copy_from(&across.transpose());
        both.fixed_view_mut::<3, 3>(3, 3)
            .copy_from(&(self.to_second * own * self.to_second.transpose()));
        both
    }
}
