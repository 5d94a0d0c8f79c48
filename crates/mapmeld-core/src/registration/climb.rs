//! From a candidate to the local maximum of the likelihood, and the Gaussian there (paper, section 3;
//! the improved proposal of Stachniss, Grisetti, Burgard, Roy, IROS 2007).

use crate::config::PerceptionConfig;
use crate::local_map::{LocalMap, WallSample};
use crate::perception::placed::Placed;
use crate::se2::{Se2, Vec2};
use nalgebra::{Matrix3, Vector3};

/// A wall of one map that lies on a wall of the other at the current pose.
#[derive(Debug, Clone, Copy)]
pub struct Match {
    /// Point of map b, in frame a.
    pub moving: Vec2,
    /// Unit normal, in frame a.
    pub normal: Vec2,
    /// Signed distance that the moving point has to go back along the normal, metres.
    pub residual: f64,
}

impl Match {
    /// Derivative of the residual by a perturbation of the pose whose origin is `t`.
    #[inline(always)]
    pub fn jacobian(&self, t: Vec2) -> Vector3<f64> {
        let r = self.moving - t;
        Vector3::new(self.normal.x, self.normal.y, self.normal.y * r.x - self.normal.x * r.y)
    }
}

/// Walls of b that fall on like-oriented walls of a, and the other way round; every `stride`-th
/// sample.
pub fn matches(a: &LocalMap, b: &LocalMap, t_a_b: &Se2, stride: usize, mut f: impl FnMut(Match)) {
    let t = t_a_b.to_rigid();
    let view = a.field_view(t_a_b);
    let found = |view: &crate::likelihood_field::FieldView, s: &WallSample| {
        view.cell(s.position).and_then(|c| view.nearest(c, s.normal))
    };
    for s in b.samples.iter().step_by(stride) {
        if let Some(k) = found(&view, s) {
            let wall = &a.boundary[k];
            let moving = t.apply(s.position);
            let residual = (moving - wall.position).dot(&wall.normal);
            f(Match { moving, normal: wall.normal, residual });
        }
    }
    let view = b.field_view(&t_a_b.inverse());
    for s in a.samples.iter().step_by(stride) {
        if let Some(k) = found(&view, s) {
            let wall = &b.boundary[k];
            let (moving, normal) = (t.apply(wall.position), t.rotate(wall.normal));
            f(Match { moving, normal, residual: (moving - s.position).dot(&normal) });
        }
    }
}

/// Geman-McClure weight of a residual.
#[inline(always)]
pub fn robust_weight(residual: f64, scale: f64) -> f64 {
    let s = scale * scale / (scale * scale + residual * residual);
    s * s
}

/// Climbs from a candidate: point-to-line steps under a robust kernel that narrows from the field's
/// reach to the walls' own noise. The result is finite whatever the walls fix; none when no walls
/// match.
pub fn climb(
    a: &LocalMap,
    b: &LocalMap,
    start: &Se2,
    stride: usize,
    max_iterations: usize,
    perception: &PerceptionConfig,
) -> Option<Se2> {
    let resolution = a.grid.resolution().max(b.grid.resolution());
    let wide = 0.5 * a.reach().min(b.reach());
    ascend(*start, wide, resolution, max_iterations, perception, |t, f| {
        matches(a, b, t, stride, f);
    })
}

/// Climbs with whole groups of placed maps: b's maps lie in a frame of their own, and `start` is that
/// frame's pose in the world of a's. None when no walls match.
pub fn climb_group(
    a: &[Placed],
    b: &[Placed],
    start: &Se2,
    max_iterations: usize,
    perception: &PerceptionConfig,
) -> Option<Se2> {
    let grids = || a.iter().chain(b).map(|p| &p.map.grid);
    let resolution = grids().map(|g| g.resolution()).fold(0.0, f64::max);
    let reach = a.iter().chain(b).map(|p| p.map.reach()).fold(f64::INFINITY, f64::min);
    ascend(*start, 0.5 * reach, resolution, max_iterations, perception, |t, f| {
        for p in a {
            let to_world = p.t_world_map.to_rigid();
            for q in b {
                let t_p_q = p.t_world_map.between(&t.compose(&q.t_world_map));
                if !may_touch(p.map, q.map, &t_p_q) {
                    continue;
                }
                // Every second sample: groups have plenty.
                matches(p.map, q.map, &t_p_q, 2, |m| {
                    f(Match {
                        moving: to_world.apply(m.moving),
                        normal: to_world.rotate(m.normal),
                        residual: m.residual,
                    });
                });
            }
        }
    })
}

/// False when the grids are too far apart for any wall of one to lie on the other.
fn may_touch(a: &LocalMap, b: &LocalMap, t_a_b: &Se2) -> bool {
    let disc = |m: &LocalMap| {
        let (w, h) = m.extent();
        let middle = m.grid.grid_to_map(0.5 * m.grid.width() as f64, 0.5 * m.grid.height() as f64);
        (middle, 0.5 * w.hypot(h))
    };
    let ((ma, ra), (mb, rb)) = (disc(a), disc(b));
    (ma - t_a_b.apply(mb)).norm() <= ra + rb
}

/// Gauss-Newton under a kernel that narrows from `wide`; `each` tells the matches at a pose.
fn ascend(
    start: Se2,
    wide: f64,
    resolution: f64,
    max_iterations: usize,
    perception: &PerceptionConfig,
    each: impl Fn(&Se2, &mut dyn FnMut(Match)),
) -> Option<Se2> {
    let finest = perception.climb_sigma.max(resolution);
    let mut scale = wide;
    let mut t = start;
    for _ in 0..max_iterations {
        let (mut h, mut g, mut n) = (Matrix3::zeros(), Vector3::zeros(), 0);
        each(&t, &mut |m| {
            let j = m.jacobian(t.translation());
            let w = robust_weight(m.residual, scale);
            h += w * j * j.transpose();
            g += w * m.residual * j;
            n += 1;
        });
        if n < 3 {
            return None;
        }
        let step = damped_solve(&h, &g);
        t = t.perturbed(&-step);
        let moved = step.xy().norm() + 5.0 * step.z.abs();
        if scale > finest {
            scale = (0.7 * scale).max(finest);
        } else if moved < 0.02 * resolution {
            break;
        }
    }
    Some(t)
}

/// Solves `h x = g`; directions that the walls leave free stay where they are.
fn damped_solve(h: &Matrix3<f64>, g: &Vector3<f64>) -> Vector3<f64> {
    // About one match in a hundred's worth of holding still, so that a bare corridor does not slide.
    let d = 0.01 * h[(0, 0)].max(h[(1, 1)]).max(1e-9);
    let damped = h + Matrix3::from_diagonal(&Vector3::new(d, d, 1e-6 * h[(2, 2)].max(1e-9)));
    damped.cholesky().map_or_else(Vector3::zeros, |c| c.solve(g))
}

/// Covariance of the pose at a local maximum: the inverse of the information of the matched walls,
/// neighbouring samples discounted, on top of a wide prior that keeps free directions finite (10 m,
/// 1 radian).
pub fn covariance(
    a: &LocalMap,
    b: &LocalMap,
    t_a_b: &Se2,
    perception: &PerceptionConfig,
) -> Matrix3<f64> {
    let resolution = a.grid.resolution().max(b.grid.resolution());
    let sigma = perception.climb_sigma.max(resolution);
    // Both directions tell of the same walls: half each.
    let discount = 0.5 * a.spacing.max(b.spacing) / perception.correlation_length;
    let mut h = Matrix3::from_diagonal(&Vector3::new(0.01, 0.01, 1.0));
    matches(a, b, t_a_b, 1, |m| {
        let j = m.jacobian(t_a_b.translation());
        let w = discount * robust_weight(m.residual, sigma) / (sigma * sigma);
        h += w * j * j.transpose();
    });
    h.try_inverse().expect("information holds a positive prior")
}
