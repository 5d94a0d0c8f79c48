//! A first look at poses of two maps: cheap, and fair to both.

use crate::local_map::LocalMap;
use crate::probe::Axes;
use crate::se2::{Rigid, Se2};

/// Two maps whose poses are looked at, thousands of them.
pub struct Glance<'a> {
    a: &'a LocalMap,
    b: &'a LocalMap,
    to_axes_a: Rigid,
    /// Angle of b's axes in b's frame less that of a's axes in a's.
    turn: f64,
    sin_cos: (f64, f64),
}

impl<'a> Glance<'a> {
    /// At poses of b in a.
    pub fn new(a: &'a LocalMap, b: &'a LocalMap) -> Self {
        let to_axes_a = a.grid.origin().inverse().to_rigid();
        let turn = b.grid.origin().theta - a.grid.origin().theta;
        Self { a, b, to_axes_a, turn, sin_cos: turn.sin_cos() }
    }

    /// How well the walls of each map fit the other's coarse table at `T_a_b`, from about so many samples of both
    /// together. Either map alone may mistake much: where people crossed it, or where it shows little.
    pub fn score(&self, t_a_b: &Se2, samples: usize) -> f32 {
        let axes = self.axes(t_a_b);
        let one_way = |to: &LocalMap, from: &LocalMap, axes: &Axes| {
            let stride = from.stride(samples / 2);
            stride as f32 * to.coarse.score(from.probes.iter().step_by(stride), axes)
        };
        one_way(self.a, self.b, &axes) + one_way(self.b, self.a, &axes.inverse())
    }

    /// What `probe::axes_of` tells, with the sine and cosine of the pose alone.
    fn axes(&self, t_a_b: &Se2) -> Axes {
        let t = t_a_b.to_rigid();
        let corner = self.to_axes_a.apply(t.apply(self.b.grid.origin().translation()));
        let ((s, c), (s_turn, c_turn)) = (t.sin_cos(), self.sin_cos);
        let sin_cos = (s * c_turn + c * s_turn, c * c_turn - s * s_turn);
        Axes::from_parts(corner, t_a_b.theta + self.turn, sin_cos)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use crate::grid::OccupancyGrid;
    use crate::probe::axes_of;

    #[test]
    fn poses_of_axes_are_those_of_the_grids() {
        let config = Config::default();
        let map = |origin: Se2| {
            let cells = (0..900).map(|k| if k % 30 == 4 { 100 } else { 0 }).collect();
            LocalMap::new(OccupancyGrid::new("g", 30, 30, 0.1, origin, cells).unwrap(), &config)
        };
        let (a, b) = (map(Se2::new(40.0, 4.0, 0.7)), map(Se2::new(-3.0, 2.0, -1.2)));
        let t_a_b = Se2::new(44.0, 5.0, 2.0);
        let (got, expected) =
            (Glance::new(&a, &b).axes(&t_a_b), Axes::new(&axes_of(&a.grid, &b.grid, &t_a_b)));
        for (x, y) in [(0.0, 0.0), (3.0, 0.0), (0.0, 2.0)] {
            let ((gx, gy), (ex, ey)) = (got.apply(x, y), expected.apply(x, y));
            assert!((gx - ex).abs() < 1e-4 && (gy - ey).abs() < 1e-4, "{got:?} {expected:?}");
        }
        assert_eq!(got.octant(700), expected.octant(700));
    }
}
