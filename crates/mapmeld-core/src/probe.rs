//! Wall samples and poses in the form in which registration asks thousands of poses about them.
//!
//! Both maps are taken in their grids' own axes, so that single precision is enough wherever a map's frame has its
//! origin, and directions are fractions of a turn, which add by wrapping.

use crate::grid::OccupancyGrid;
use crate::local_map::WallSample;
use crate::se2::{Se2, Vec2};
use std::f64::consts::TAU;

/// A wall sample in the axes of its grid.
#[derive(Debug, Clone, Copy, Default)]
pub struct Probe {
    /// Metres from the corner of cell (0, 0).
    pub x: f32,
    /// The same.
    pub y: f32,
    /// Unit normal into free space.
    pub nx: f32,
    /// The same.
    pub ny: f32,
    /// See [`WallSample::weight`].
    pub weight: f32,
    /// See [`WallSample::conflict_weight`].
    pub conflict_weight: f32,
    /// Direction of the normal, 65536 a turn.
    pub direction: u16,
    /// See [`WallSample::straight`].
    pub straight: bool,
}

/// An angle in 65536ths of a turn.
#[inline(always)]
fn turn(angle: f64) -> u16 {
    (angle / TAU * 65536.0).round() as i64 as u16
}

/// Which of the eight directions a fraction of a turn is nearest to.
#[inline(always)]
pub fn octant(direction: u16) -> usize {
    usize::from(direction.wrapping_add(4096) >> 13)
}

/// The samples of a map as probes, in their order.
pub fn probes(grid: &OccupancyGrid, samples: &[WallSample]) -> Vec<Probe> {
    let to_axes = grid.origin().inverse().to_rigid();
    let probe = |s: &WallSample| {
        let (p, n) = (to_axes.apply(s.position), to_axes.rotate(s.normal));
        Probe {
            x: p.x as f32,
            y: p.y as f32,
            nx: n.x as f32,
            ny: n.y as f32,
            weight: s.weight as f32,
            conflict_weight: s.conflict_weight as f32,
            direction: turn(n.y.atan2(n.x)),
            straight: s.straight,
        }
    };
    samples.iter().map(probe).collect()
}

/// A pose of one grid's axes in another's.
#[derive(Debug, Clone, Copy)]
pub struct Axes {
    c: f32,
    s: f32,
    x: f32,
    y: f32,
    turn: u16,
}

impl Axes {
    /// From `T_axes_axes`.
    pub fn new(t: &Se2) -> Self {
        Self::from_parts(t.translation(), t.theta, t.theta.sin_cos())
    }

    /// Of the grids of `T_a_b`.
    pub fn between(a: &OccupancyGrid, b: &OccupancyGrid, t_a_b: &Se2) -> Self {
        Self::new(&axes_of(a, b, t_a_b))
    }

    /// From the corner's position and the angle, whose sine and cosine are known.
    pub fn from_parts(corner: Vec2, theta: f64, (s, c): (f64, f64)) -> Self {
        let (x, y) = (corner.x as f32, corner.y as f32);
        Self { c: c as f32, s: s as f32, x, y, turn: turn(theta) }
    }

    /// The pose of the other grid's axes in this one's.
    pub fn inverse(&self) -> Self {
        let (x, y) = (self.c * self.x + self.s * self.y, self.c * self.y - self.s * self.x);
        Self { c: self.c, s: -self.s, x: -x, y: -y, turn: self.turn.wrapping_neg() }
    }

    /// A point.
    #[inline(always)]
    pub fn apply(&self, x: f32, y: f32) -> (f32, f32) {
        (self.c * x - self.s * y + self.x, self.s * x + self.c * y + self.y)
    }

    /// A direction.
    #[inline(always)]
    pub fn rotate(&self, x: f32, y: f32) -> (f32, f32) {
        (self.c * x - self.s * y, self.s * x + self.c * y)
    }

    /// Which of the eight directions the normal of a probe has.
    #[inline(always)]
    pub fn octant(&self, direction: u16) -> usize {
        octant(direction.wrapping_add(self.turn))
    }
}

/// `T_axes_axes` of the grids of `T_a_b`.
pub fn axes_of(a: &OccupancyGrid, b: &OccupancyGrid, t_a_b: &Se2) -> Se2 {
    a.origin().between(&t_a_b.compose(&b.origin()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::likelihood_field::direction;

    #[test]
    fn octants_are_those_of_the_field() {
        for k in 0..720 {
            let angle = (f64::from(k) + 0.25) * TAU / 720.0;
            for theta in [-3.0, -0.4, 0.0, 1.0, 3.1] {
                let axes = Axes::new(&Se2::new(0.0, 0.0, theta));
                let turned = Vec2::new((angle + theta).cos(), (angle + theta).sin());
                let got = axes.octant(turn(angle));
                // On the edge between two, either will do.
                let edge = ((angle + theta) / TAU * 8.0 + 0.5).fract();
                if edge > 1e-3 && edge < 1.0 - 1e-3 {
                    assert_eq!(got, direction(turned), "{angle} {theta}");
                }
            }
        }
    }

    #[test]
    fn axes_agree_with_the_maps_frames() {
        let grid = |origin| OccupancyGrid::new("g", 4, 3, 0.1, origin, vec![0; 12]).unwrap();
        let (a, b) = (grid(Se2::new(900.0, 4.0, 0.7)), grid(Se2::new(-3.0, 2.0, -1.2)));
        let t_a_b = Se2::new(902.0, 5.0, 2.0);
        let axes = Axes::between(&a, &b, &t_a_b);
        let point = b.origin().inverse().apply(Vec2::new(1.0, 2.0));
        let expected = a.origin().inverse().apply(t_a_b.apply(Vec2::new(1.0, 2.0)));
        let got = axes.apply(point.x as f32, point.y as f32);
        assert!((f64::from(got.0) - expected.x).abs() < 1e-5);
        assert!((f64::from(got.1) - expected.y).abs() < 1e-5);
        let back = axes.inverse().apply(got.0, got.1);
        assert!((back.0 - point.x as f32).abs() < 1e-4 && (back.1 - point.y as f32).abs() < 1e-4);
        for k in 0..8u16 {
            // Away from the edges between octants.
            let direction = k * 8192 + 700;
            let there = direction.wrapping_add(axes.turn);
            assert_eq!(axes.inverse().octant(there), octant(direction));
        }
    }
}
