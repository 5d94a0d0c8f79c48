//! What walls pull at: the normal equations of a step that lays walls on walls, point to line, under a robust kernel.

use crate::blocks::LANES;
use crate::probe::Axes;
use crate::se2::Vec2;
use nalgebra::{Matrix3, Vector3};

/// Walls of one map that lie on walls of another, in one frame. Lanes without a normal hold none.
pub struct Matches {
    /// Points of the map that is moved, metres.
    pub x: [f32; LANES],
    /// The same.
    pub y: [f32; LANES],
    /// Unit normals.
    pub nx: [f32; LANES],
    /// The same.
    pub ny: [f32; LANES],
    /// Signed distances that the points have to go back along the normals, metres.
    pub residual: [f32; LANES],
}

impl Matches {
    /// From one frame into another.
    #[inline(always)]
    pub fn place(&mut self, axes: &Axes) {
        for k in 0..LANES {
            (self.x[k], self.y[k]) = axes.apply(self.x[k], self.y[k]);
            (self.nx[k], self.ny[k]) = axes.rotate(self.nx[k], self.ny[k]);
        }
    }

    /// Whether a lane holds one.
    #[inline(always)]
    pub fn is_there(&self, lane: usize) -> bool {
        self.nx[lane] * self.nx[lane] + self.ny[lane] * self.ny[lane] > 0.5
    }
}

/// Normal equations of a step (x, y, theta), turning about a pivot.
pub struct Pull {
    pivot: (f32, f32),
    /// Square of the kernel's scale.
    scale: f32,
    /// Upper triangle of the information, row by row, lane by lane, and the gradient: of the latest blocks.
    h: [[f32; LANES]; 6],
    g: [[f32; LANES]; 3],
    /// Those of all blocks before.
    before: ([f64; 6], [f64; 3]),
    latest: u32,
    n: u32,
}

/// Blocks that are summed up in single precision where precision counts.
const AT_ONCE: u32 = 16;

impl Pull {
    /// Of no walls yet, under a Geman-McClure kernel of some scale, metres.
    pub fn new(pivot: Vec2, scale: f64) -> Self {
        let pivot = (pivot.x as f32, pivot.y as f32);
        let scale = (scale * scale) as f32;
        let (h, g) = ([[0.0; LANES]; 6], [[0.0; LANES]; 3]);
        Self { pivot, scale, h, g, before: ([0.0; 6], [0.0; 3]), latest: 0, n: 0 }
    }

    /// Some more walls. Those without a normal pull at nothing.
    #[inline(always)]
    pub fn add(&mut self, m: &Matches) {
        for k in 0..LANES {
            let (nx, ny, residual) = (m.nx[k], m.ny[k], m.residual[k]);
            let turn = ny * (m.x[k] - self.pivot.0) - nx * (m.y[k] - self.pivot.1);
            let w = self.scale / (self.scale + residual * residual);
            let w = w * w;
            let (wx, wy, wt) = (w * nx, w * ny, w * turn);
            self.h[0][k] += wx * nx;
            self.h[1][k] += wx * ny;
            self.h[2][k] += wx * turn;
            self.h[3][k] += wy * ny;
            self.h[4][k] += wy * turn;
            self.h[5][k] += wt * turn;
            self.g[0][k] += wx * residual;
            self.g[1][k] += wy * residual;
            self.g[2][k] += wt * residual;
        }
        self.n += (0..LANES).map(|k| u32::from(m.is_there(k))).sum::<u32>();
    }

    /// The same, for sums that are inverted: single precision would tell of an axis that a long bare corridor leaves free.
    #[inline(always)]
    pub fn add_precisely(&mut self, m: &Matches) {
        self.add(m);
        self.latest += 1;
        if self.latest == AT_ONCE {
            (self.before, self.latest) = (summed(self), 0);
            (self.h, self.g) = ([[0.0; LANES]; 6], [[0.0; LANES]; 3]);
        }
    }

    /// Number of walls.
    pub fn walls(&self) -> u32 {
        self.n
    }

    /// The information and the gradient.
    pub fn equations(&self) -> (Matrix3<f64>, Vector3<f64>) {
        let ([xx, xy, xt, yy, yt, tt], gradient) = summed(self);
        (Matrix3::new(xx, xy, xt, xy, yy, yt, xt, yt, tt), Vector3::from(gradient))
    }
}

/// Information and gradient of all blocks so far.
#[multiversion::multiversion(targets("x86_64+avx2"))]
fn summed(pull: &Pull) -> ([f64; 6], [f64; 3]) {
    let (mut h, mut g) = pull.before;
    h.iter_mut().zip(&pull.h).for_each(|(all, lanes)| *all += sum(*lanes));
    g.iter_mut().zip(&pull.g).for_each(|(all, lanes)| *all += sum(*lanes));
    (h, g)
}

/// In lanes: one sum would wait for each of its terms.
#[inline(always)]
fn sum(lanes: [f32; LANES]) -> f64 {
    const { assert!(LANES % 4 == 0) };
    let mut sums = [0.0f64; 4];
    for four in lanes.chunks_exact(4) {
        (0..4).for_each(|k| sums[k] += f64::from(four[k]));
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of thousands of samples of one straight wall, askew: no more is told along it than is summed up in double precision.
    #[test]
    fn a_long_bare_wall_tells_nothing_along_it() {
        let mut pull = Pull::new(Vec2::zeros(), 1e3);
        let (s, c) = 0.6f32.sin_cos();
        for block in 0..400 {
            let at = |k: usize| (16 * block + k) as f32 * 0.05;
            pull.add_precisely(&Matches {
                x: std::array::from_fn(|k| -s * at(k)),
                y: std::array::from_fn(|k| c * at(k)),
                nx: [c; LANES],
                ny: [s; LANES],
                residual: [0.1; LANES],
            });
        }
        assert_eq!(pull.walls(), 6400);
        let (information, g) = pull.equations();
        let shift = information.fixed_view::<2, 2>(0, 0).into_owned();
        let [along, across] = {
            let e = shift.symmetric_eigenvalues();
            [e.min(), e.max()]
        };
        assert!((across - 6400.0).abs() < 1.0 && along.abs() < 2e-3, "{across} {along}");
        assert!((g.xy() - 640.0 * Vec2::new(c.into(), s.into())).norm() < 0.1, "{g}");
    }
}
