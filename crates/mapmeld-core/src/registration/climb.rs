//! From a candidate to the local maximum of the likelihood, and the Gaussian there (paper, section 3;
//! the improved proposal of Stachniss, Grisetti, Burgard, Roy, IROS 2007).

use crate::config::PerceptionConfig;
use crate::local_map::LocalMap;
use crate::perception::placed::Placed;
use crate::perception::pull::{Matches, Pull};
use crate::probe::{axes_of, Axes};
use crate::se2::{self, Se2, Vec2};
use nalgebra::{Matrix3, Vector3};

/// Walls of b that fall on like-oriented walls of a, and the other way round, in the axes of grid a; of each map so
/// many samples at most. `f` is told whose walls they are: 0 of a, 1 of b.
#[inline(always)]
fn matches(
    a: &LocalMap,
    b: &LocalMap,
    t_axes_axes: &Se2,
    (of_a, of_b): (usize, usize),
    mut f: impl FnMut(usize, Matches),
) {
    let axes = Axes::new(t_axes_axes);
    let view = a.probe_view(axes);
    for block in b.blocks.first(of_b) {
        let s = view.see(block);
        let w = view.walls(&s, 0);
        f(1, Matches { x: s.x, y: s.y, nx: w.nx, ny: w.ny, residual: w.residuals(&s) });
    }
    let view = b.probe_view(axes.inverse());
    for block in a.blocks.first(of_a) {
        let s = view.see(block);
        let w = view.walls(&s, 0);
        let mut residual = w.residuals(&s);
        residual.iter_mut().for_each(|r| *r = -*r);
        let mut m = Matches { x: w.x, y: w.y, nx: w.nx, ny: w.ny, residual };
        m.place(&axes);
        f(0, m);
    }
}

/// What the walls of two maps pull at.
#[multiversion::multiversion(targets("x86_64+avx2"))]
fn pull_of(a: &LocalMap, b: &LocalMap, t_axes_axes: &Se2, samples: usize, pull: &mut Pull) {
    matches(a, b, t_axes_axes, (samples, samples), |_, m| pull.add(&m));
}

/// The same, precisely, of the walls of a and of those of b.
#[multiversion::multiversion(targets("x86_64+avx2"))]
fn pulls_of(a: &LocalMap, b: &LocalMap, t_axes_axes: &Se2, samples: usize, pulls: &mut [Pull; 2]) {
    matches(a, b, t_axes_axes, (samples, samples), |k, m| pulls[k].add_precisely(&m));
}

/// Geman-McClure weight of a residual.
#[inline(always)]
pub fn robust_weight(residual: f64, scale: f64) -> f64 {
    let s = scale * scale / (scale * scale + residual * residual);
    s * s
}

/// The step to go back; directions that the walls leave free stay where they are.
fn step_back(pull: &Pull) -> Vector3<f64> {
    let (mut h, gradient) = pull.equations();
    // About one match in a hundred's worth of holding still, so that a bare corridor does not slide.
    let d = 0.01 * h[(0, 0)].max(h[(1, 1)]).max(1e-9);
    h += Matrix3::from_diagonal(&Vector3::new(d, d, 1e-6 * h[(2, 2)].max(1e-9)));
    h.cholesky().map_or_else(Vector3::zeros, |c| c.solve(&gradient))
}

/// How far walls may lie from each other when a climb begins, metres.
pub fn wide(a: &LocalMap, b: &LocalMap) -> f64 {
    0.5 * a.reach().min(b.reach())
}

/// Least cosine between two steps that go the same way.
const SAME_WAY: f64 = 0.8;
/// A step is taken so many times as far at most: further on the walls that it was worked out from are no more those nearby.
const LONGEST: f64 = 2.0;
/// So many steps, in all, that go back on the one before end a climb: it goes to and fro between cells.
const MOST_TO_AND_FRO: usize = 3;
/// Metres that a turn of one radian moves walls by, about.
pub const LEVER: f64 = 5.0;

/// Steps shorter than this, in cells, lead nowhere any more.
pub const STILL: f64 = 0.06;

/// How a climb from a candidate is done: point-to-line steps under a robust kernel that narrows to the walls' own
/// noise.
#[derive(Debug, Clone, Copy)]
pub struct Climb {
    /// Samples of each map that are followed, at most.
    pub samples: usize,
    /// Most steps.
    pub steps: usize,
    /// Scale of the kernel in the beginning, metres.
    pub scale: f64,
    /// Steps shorter than this, in cells, end it.
    pub still: f64,
}

impl Climb {
    /// Where it ends. The result is finite whatever the walls fix; none when no walls match.
    pub fn top(
        &self,
        a: &LocalMap,
        b: &LocalMap,
        start: &Se2,
        perception: &PerceptionConfig,
    ) -> Option<Se2> {
        let resolution = a.grid.resolution().max(b.grid.resolution());
        let (to_a, from_b) = (a.grid.origin(), b.grid.origin().inverse());
        let center = from_b.apply(b.center?);
        let start = axes_of(&a.grid, &b.grid, start);
        let ends = Ends { steps: self.steps, shorter: self.still * resolution };
        let finest = perception.climb_sigma.max(resolution);
        let top = ascend(start, center, (self.scale, finest), ends, |t, pull| {
            pull_of(a, b, t, self.samples, pull);
        });
        Some(to_a.compose(&top?).compose(&from_b))
    }
}

/// Samples of each map that the climb of a group follows, at most.
const GROUP_SAMPLES: usize = 512;

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
    let centers: Vec<Vec2> =
        b.iter().filter_map(|q| Some(q.t_world_map.apply(q.map.center?))).collect();
    let center = centers.iter().sum::<Vec2>() / centers.len().max(1) as f64;
    let of_each = (GROUP_SAMPLES, GROUP_SAMPLES);
    let ends = Ends { steps: max_iterations, shorter: STILL * resolution };
    let finest = perception.climb_sigma.max(resolution);
    ascend(*start, center, (0.5 * reach, finest), ends, |t, pull| {
        for p in a {
            let to_world = Axes::new(&p.t_world_map.compose(&p.map.grid.origin()));
            for q in b {
                let moved = Placed { t_world_map: t.compose(&q.t_world_map), ..*q };
                if !p.may_touch(&moved) {
                    continue;
                }
                let t_p_q = p.t_world_map.between(&moved.t_world_map);
                matches(
                    p.map,
                    q.map,
                    &axes_of(&p.map.grid, &q.map.grid, &t_p_q),
                    of_each,
                    |_, mut m| {
                        m.place(&to_world);
                        pull.add(&m);
                    },
                );
            }
        }
    })
}

/// When a climb ends: after so many steps, or once a step is shorter, metres.
struct Ends {
    steps: usize,
    shorter: f64,
}

/// Gauss-Newton under a kernel that narrows from `wide` to `finest`, turning about `center`, a point of the moving
/// frame; `each` tells the matches at a pose.
fn ascend(
    start: Se2,
    center: Vec2,
    (wide, finest): (f64, f64),
    ends: Ends,
    each: impl Fn(&Se2, &mut Pull),
) -> Option<Se2> {
    let mut scale = wide.max(finest);
    let mut t = start;
    let (mut stride, mut last, mut to_and_fro) = (1.0, Vector3::zeros(), 0);
    for _ in 0..ends.steps {
        let pivot = t.apply(center);
        let mut pull = Pull::new(pivot, scale);
        each(&t, &mut pull);
        if pull.walls() < 3 {
            return None;
        }
        let step = -step_back(&pull);
        stride = longer(stride, &last, &step);
        let taken = stride * step;
        let turned = Se2::new(0.0, 0.0, taken.z).rotate(t.translation() - pivot);
        t = Se2::from_parts(pivot + turned + taken.xy(), t.theta + taken.z);
        if scale > finest {
            scale = (0.7 * scale).max(finest);
            continue;
        }
        let moved = step.xy().norm() + LEVER * step.z.abs();
        to_and_fro += usize::from(dot(&step, &last) < 0.0);
        if moved < ends.shorter || to_and_fro == MOST_TO_AND_FRO {
            break;
        }
        last = step;
    }
    Some(t)
}

/// How many times as far as a step goes it is taken, where the one before was taken so many times: walls that are found
/// anew after each step let most of them fall short, one after the other the same way. How much shorter a step is than the
/// one before tells where they would end (Aitken's process; Besl and McKay, "A method for registration of 3-D shapes", PAMI
/// 1992, lengthen steps that agree likewise).
fn longer(stride: f64, last: &Vector3<f64>, step: &Vector3<f64>) -> f64 {
    let (both, square) = (dot(step, last), dot(last, last));
    if both <= SAME_WAY * (square * dot(step, step)).sqrt() {
        return 1.0;
    }
    let made_good = 1.0 - both / square;
    if made_good * LONGEST > stride {
        (stride / made_good).max(1.0)
    } else {
        LONGEST
    }
}

/// Of two steps, turns as far as they move walls.
fn dot(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    a.x * b.x + a.y * b.y + LEVER * LEVER * a.z * b.z
}

/// Samples of each map that tell the covariance of a pose, at most.
const COVARIANCE_SAMPLES: usize = 512;

/// Covariance of the pose at a local maximum: the inverse of the information of the matched walls, from some samples,
/// neighbouring samples discounted, on top of a wide prior that keeps free directions finite (10 m,
/// 1 radian), of the middle of b's walls; told of b's origin, in a's frame.
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
    // About the middle of b's walls: single precision must suffice.
    let center = t_a_b.apply(b.center.unwrap_or_default());
    let to_a = a.grid.origin();
    let pull = || Pull::new(to_a.inverse().apply(center), sigma);
    let mut pulls = [pull(), pull()];
    pulls_of(a, b, &axes_of(&a.grid, &b.grid, t_a_b), COVARIANCE_SAMPLES, &mut pulls);
    let [of_a, of_b] = pulls.map(|p| p.equations().0);
    let [share_a, share_b] = [a, b].map(|m| m.blocks.share(COVARIANCE_SAMPLES));
    let prior = Matrix3::from_diagonal(&Vector3::new(0.01, 0.01, 1.0));
    let h = discount / (sigma * sigma) * (share_a * of_a + share_b * of_b) + prior;
    let of_center = h.try_inverse().expect("information holds a positive prior");
    se2::swung(&to_a.transport_covariance(&of_center), t_a_b.translation() - center)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::blocks::LANES;
    use crate::config::Config;
    use crate::grid::OccupancyGrid;

    /// How many times a climb from x = 0.1 m asks for walls that pull back so many times as far as x, 50 times at most.
    fn asked(back: f64) -> usize {
        let asked = std::cell::Cell::new(0);
        let ends = Ends { steps: 50, shorter: 1e-9 };
        ascend(Se2::new(0.1, 0.0, 0.0), Vec2::zeros(), (0.0, 10.0), ends, |t, pull| {
            asked.set(asked.get() + 1);
            let mut m = Matches {
                x: [0.0; LANES],
                y: std::array::from_fn(|k| k as f32),
                nx: [0.0; LANES],
                ny: [0.0; LANES],
                residual: [0.0; LANES],
            };
            for k in 0..LANES {
                // Walls across x, and some across y that hold still.
                (m.nx[k], m.ny[k]) = if k % 4 > 0 { (1.0, 0.0) } else { (0.0, 1.0) };
                m.residual[k] = if k % 4 > 0 { (back * t.x) as f32 } else { 0.0 };
            }
            pull.add(&m);
        });
        asked.get()
    }

    /// Of the same walls, wherever the maps' frames have their origins.
    #[test]
    fn covariances_are_no_matter_of_frames() {
        let config = Config::default();
        let at_corner = |a: Se2, b: Se2| {
            let [map_a, map_b] = [a, b].map(|origin| {
                let is_wall = |row: usize, col: usize| row == 20 || col == 30 && row > 20;
                let cell = |k: usize| if is_wall(k / 70, k % 70) { 100 } else { 0 };
                let cells = (0..60 * 70).map(cell).collect();
                let grid = OccupancyGrid::new("g", 70, 60, 0.1, origin, cells).unwrap();
                LocalMap::new(grid, &config)
            });
            let t_a_b = a.compose(&b.inverse());
            let of_origin = covariance(&map_a, &map_b, &t_a_b, &config.perception);
            let of_corner = se2::swung(&of_origin, a.translation() - t_a_b.translation());
            a.inverse().transport_covariance(&of_corner)
        };
        let near = at_corner(Se2::IDENTITY, Se2::IDENTITY);
        let far = at_corner(Se2::new(5000.0, 200.0, 2.0), Se2::new(-300.0, 4000.0, -1.0));
        assert!(near.symmetric_eigenvalues().min() > 0.0 && near[(0, 0)].sqrt() < 0.05, "{near}");
        assert!((far - near).norm() < 1e-3 * near.norm(), "{near} {far}");
    }

    #[test]
    fn climbs_end_where_steps_go_to_and_fro_and_go_on_where_they_grow() {
        assert_eq!(asked(2.0), 2 + MOST_TO_AND_FRO - 1);
        assert_eq!(asked(-0.02), 50);
        assert!(asked(0.5) < 50);
    }

    /// A quarter of the way each: fifty such steps would leave a millionth.
    #[test]
    fn steps_that_fall_short_one_after_the_other_are_lengthened() {
        assert!(asked(0.25) < 35, "{}", asked(0.25));
        // No further than where they would end.
        assert!(asked(0.8) < 7, "{}", asked(0.8));
        let (short, long) = (Vector3::new(0.1, 0.0, 0.0), Vector3::new(0.2, 0.0, 0.0));
        assert_eq!(longer(1.0, &Vector3::zeros(), &long), 1.0);
        assert_eq!(longer(1.0, &long, &short), 2.0);
        assert_eq!(longer(1.2, &long, &long), LONGEST);
        for other in [-short, Vector3::new(0.0, 0.1, 0.0), Vector3::new(0.05, 0.0, 0.02)] {
            assert_eq!(longer(2.0, &long, &other), 1.0, "{other}");
        }
    }
}
