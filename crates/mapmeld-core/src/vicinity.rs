//! Which placed maps lie near each other: the others have nothing to say to each other.

use crate::grid::OccupancyGrid;
use crate::local_map::LocalMap;
use crate::se2::{Se2, Vec2};

/// How far walls may be moved while maps are compared, metres: more than climbing and bending ever do.
const SLACK: f64 = 3.0;

/// A circle around a placed map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Circle {
    /// In the frame in which the map is placed, metres.
    pub center: Vec2,
    /// Metres.
    pub radius: f64,
}

impl Circle {
    /// Around the grid of a map that lies at `t_frame_map`.
    pub fn around(grid: &OccupancyGrid, t_frame_map: &Se2) -> Self {
        let (w, h) = (grid.width() as f64, grid.height() as f64);
        let center = t_frame_map.apply(grid.grid_to_map(0.5 * w, 0.5 * h));
        Self { center, radius: 0.5 * w.hypot(h) * grid.resolution() }
    }

    /// Whether maps in these circles may have something in common once walls have moved a little.
    pub fn is_near(&self, other: &Circle) -> bool {
        let reach = self.radius + other.radius + SLACK;
        (self.center - other.center).norm_squared() <= reach * reach
    }
}

/// Pairs of places, i before j, of maps that lie near each other; in the order of i, then of j.
pub fn pairs(maps: &[LocalMap], members: &[usize], poses: &[Se2]) -> Vec<(usize, usize)> {
    let placed = members.iter().zip(poses);
    let circles: Vec<Circle> = placed.map(|(m, t)| Circle::around(&maps[*m].grid, t)).collect();
    let n = circles.len();
    let all = (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j)));
    all.filter(|(i, j)| circles[*i].is_near(&circles[*j])).collect()
}
