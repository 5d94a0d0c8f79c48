//! The nearest wall point of like orientation, looked up in one step.
//!
//! A likelihood field (Thrun, Burgard, Fox, Probabilistic Robotics, section 6.4) that knows the
//! direction of walls: for every cell and each of eight directions it holds the nearest wall point
//! whose normal agrees.

mod nearest;
mod probe_view;

pub use probe_view::{ProbeView, Seen, Walls};

use crate::boundary::{BoundaryPoint, CellIndex};
use crate::grid::OccupancyGrid;
use crate::se2::Vec2;
use nearest::{nearest_of, Nearest, NearestPoints};
use std::sync::Arc;

/// Number of directions that are told apart.
pub const DIRECTIONS: usize = 8;
/// Normals agree with a direction when within this angle of it, radians. Half a bin and a
/// tolerance of about 30 degrees.
const AGREE: f64 = 0.92;

const DIAGONAL: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// The eight directions.
const AXES: [(f64, f64); DIRECTIONS] = [
    (1.0, 0.0),
    (DIAGONAL, DIAGONAL),
    (0.0, 1.0),
    (-DIAGONAL, DIAGONAL),
    (-1.0, 0.0),
    (-DIAGONAL, -DIAGONAL),
    (0.0, -1.0),
    (DIAGONAL, -DIAGONAL),
];

/// A wall point in the axes of its grid, metres: what registration asks for, in one piece of memory.
#[derive(Debug, Clone, Copy)]
pub struct Wall {
    /// Distance from the corner of cell (0, 0).
    pub x: f32,
    /// The same.
    pub y: f32,
    /// Unit normal into free space.
    pub nx: f32,
    /// The same.
    pub ny: f32,
}

/// What stands for a wall where none is within reach: it has no normal.
const NO_WALL: Wall = Wall { x: 0.0, y: 0.0, nx: 0.0, ny: 0.0 };

/// See the module's text. Holds indices into the boundary it was made from, and one more for no wall.
#[derive(Debug, Clone)]
pub struct LikelihoodField {
    /// By their indices in `walls`. The mirror image has the same.
    nearest: Arc<NearestPoints>,
    columns: usize,
    /// Whether rows are told from their last column to the first, and directions accordingly.
    is_turned: bool,
    /// The last one is [`NO_WALL`].
    walls: Vec<Wall>,
}

/// What one of the eight directions is in the mirror image.
fn turned(direction: usize) -> usize {
    (DIRECTIONS + DIRECTIONS / 2 - direction) % DIRECTIONS
}

/// Which of the eight directions a vector points to.
#[inline(always)]
pub fn direction(v: Vec2) -> usize {
    // Octant by comparisons, not by atan2: this is the innermost loop. tan(22.5 deg) = 0.41421356.
    const T: f64 = 0.414_213_562_373_095;
    let (ax, ay) = (v.x.abs(), v.y.abs());
    if ay <= T * ax {
        if v.x >= 0.0 {
            0
        } else {
            4
        }
    } else if ax <= T * ay {
        if v.y >= 0.0 {
            2
        } else {
            6
        }
    } else {
        match (v.x >= 0.0, v.y >= 0.0) {
            (true, true) => 1,
            (false, true) => 3,
            (false, false) => 5,
            (true, false) => 7,
        }
    }
}

impl LikelihoodField {
    /// Makes the field with a reach of `reach` cells. At most 65534 points can be held; they come ordered by cell, as
    /// in `index`.
    pub fn new(
        grid: &OccupancyGrid,
        boundary: &[BoundaryPoint],
        index: &CellIndex,
        reach: usize,
    ) -> Self {
        assert!(boundary.len() < usize::from(u16::MAX), "boundary must be thinned first");
        let nearest = Arc::new(nearest_of(grid, boundary, index, reach));
        let to_axes = grid.origin().inverse().to_rigid();
        let wall = |b: &BoundaryPoint| {
            let (p, n) = (to_axes.apply(b.position), to_axes.rotate(b.normal));
            Wall { x: p.x as f32, y: p.y as f32, nx: n.x as f32, ny: n.y as f32 }
        };
        let walls = boundary.iter().map(wall).chain([NO_WALL]).collect();
        Self { nearest, columns: grid.width(), is_turned: false, walls }
    }

    /// The field of the mirror image of a grid so many metres wide, whose boundary has the mirrored points in the same
    /// order.
    pub fn mirrored(&self, width: f64) -> Self {
        let wall = |w: &Wall| Wall { x: (width - f64::from(w.x)) as f32, nx: -w.nx, ..*w };
        Self {
            nearest: Arc::clone(&self.nearest),
            is_turned: !self.is_turned,
            walls: self.walls.iter().map(wall).collect(),
            ..*self
        }
    }

    /// Of each direction, in the grid's axes, the index of the nearest wall point whose normal agrees with it, at a cell
    /// of the grid; beyond the last point where none is within reach.
    #[inline(always)]
    pub fn nearest(&self, row: usize, col: usize) -> Nearest {
        match self.is_turned {
            true => {
                let there = self.nearest.at((row + 1) * self.columns - 1 - col);
                std::array::from_fn(|d| there[turned(d)])
            }
            false => *self.nearest.at(row * self.columns + col),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::se2::Se2;
    use rand::{Rng, SeedableRng};
    use std::f64::consts::TAU;

    #[test]
    fn direction_is_the_nearest_octant() {
        for k in 0..720 {
            let a = (k as f64 + 0.25) * TAU / 720.0;
            let expected = ((a / TAU * 8.0).round() as usize) % 8;
            assert_eq!(direction(Vec2::new(a.cos(), a.sin())), expected, "{}", a.to_degrees());
        }
    }

    /// A slanted wall seen from both sides, an upright one, and points here and there with normals of their own; in
    /// the middle of a large grid there is nothing.
    #[test]
    fn holds_the_nearest_agreeing_point() {
        for (w, h, reach) in [(30, 25, 6), (40, 110, 3), (40, 110, 15), (1, 40, 15), (40, 1, 7)] {
            holds_the_nearest(w, h, reach);
        }
    }

    fn holds_the_nearest(w: usize, h: usize, reach: usize) {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(3);
        let grid =
            OccupancyGrid::new("g", w, h, 0.1, Se2::new(1.0, 2.0, 0.3), vec![0; w * h]).unwrap();
        let slanted =
            (0..w).flat_map(|x| [(x + w * (x / 3 + 4), -1.2), (x + w * (x / 3 + 4), 1.94)]);
        let upright = (3..h).map(|y| (w / 2 + w * y, 0.0));
        let strays = (0..25).map(|_| (rng.random_range(0..w * h), rng.random_range(0.0..TAU)));
        let is_known = |cell: usize| cell < w * h && (h < 100 || !(40..80).contains(&(cell / w)));
        let mut places: Vec<(usize, f64)> =
            slanted.chain(upright).chain(strays).filter(|(cell, _)| is_known(*cell)).collect();
        places.sort_by_key(|(cell, _)| *cell);
        let point = |(cell, a): (usize, f64)| BoundaryPoint {
            position: grid.cell_center(cell / w, cell % w),
            normal: grid.origin().rotate(Vec2::new(a.cos(), a.sin())),
            cell: cell as u32,
            straightness: 1.0,
        };
        let points: Vec<BoundaryPoint> = places.into_iter().map(point).collect();
        let index = CellIndex::new(&grid, points.iter().map(|p| p.cell));
        let field = LikelihoodField::new(&grid, &points, &index, reach);
        for cell in 0..w * h {
            let at = grid.cell_center(cell / w, cell % w);
            let nearest = field.nearest(cell / w, cell % w);
            for (d, nearest) in nearest.iter().enumerate() {
                let a = TAU * d as f64 / 8.0;
                let axis = grid.origin().rotate(Vec2::new(a.cos(), a.sin()));
                let best = points
                    .iter()
                    .filter(|p| p.normal.dot(&axis) >= AGREE.cos())
                    .map(|p| (p.position - at).norm())
                    .filter(|r| *r <= 0.1 * reach as f64 + 1e-9)
                    .min_by(f64::total_cmp);
                let got = points.get(usize::from(*nearest)).map(|k| (k.position - at).norm());
                match (best, got) {
                    (Some(b), Some(g)) => assert!((b - g).abs() < 1e-9),
                    (None, None) => {}
                    other => panic!("{w} x {h}, cell {cell}, direction {d}: {other:?}"),
                }
            }
        }
    }
}
