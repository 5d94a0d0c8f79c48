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
    /// Upper triangle of the information, row by row, lane by lane.
    h: [[f32; LANES]; 6],
    g: [[f32; LANES]; 3],
    n: u32,
}

impl Pull {
    /// Of no walls yet, under a Geman-McClure kernel of some scale, metres.
    pub fn new(pivot: Vec2, scale: f64) -> Self {
        let pivot = (pivot.x as f32, pivot.y as f32);
        let scale = (scale * scale) as f32;
        Self { pivot, scale, h: [[0.0; LANES]; 6], g: [[0.0; LANES]; 3], n: 0 }
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

    /// Number of walls.
    pub fn walls(&self) -> u32 {
        self.n
    }

    /// The information.
    pub fn information(&self) -> Matrix3<f64> {
        let [xx, xy, xt, yy, yt, tt] = self.h.map(sum);
        Matrix3::new(xx, xy, xt, xy, yy, yt, xt, yt, tt)
    }

    /// The gradient.
    pub fn gradient(&self) -> Vector3<f64> {
        Vector3::from(self.g.map(sum))
    }
}

fn sum(lanes: [f32; LANES]) -> f64 {
    lanes.into_iter().map(f64::from).sum()
}
