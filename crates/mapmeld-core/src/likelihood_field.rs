//! The nearest wall point of like orientation, looked up in one step.
//!
//! A likelihood field (Thrun, Burgard, Fox, Probabilistic Robotics, section 6.4) that knows the
//! direction of walls: for every cell and each of eight directions it holds the nearest wall point
//! whose normal agrees.

mod probe_view;

pub use probe_view::{ProbeView, Seen, Walls};

use crate::boundary::{BoundaryPoint, CellIndex};
use crate::catchment::{self, Catchments, MAX_REACH};
use crate::grid::OccupancyGrid;
use crate::se2::Vec2;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Number of directions that are told apart.
pub const DIRECTIONS: usize = 8;
/// Normals agree with a direction when within this angle of it, radians. Half a bin and a
/// tolerance of about 30 degrees.
const AGREE: f64 = 0.92;

/// Rows that points of one row reach.
const OPEN_ROWS: usize = 2 * MAX_REACH + 2;

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
    /// Of each cell, row by row, and last of what lies outside the grid. Where nothing is near, the index of the last
    /// wall. The mirror image has the same.
    nearest: Arc<Vec<[u16; DIRECTIONS]>>,
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

/// The directions that a normal, in the grid's axes, agrees with: one bit each.
fn agreeing(n: Vec2) -> u8 {
    let angle = n.y.atan2(n.x);
    let off = |b: usize| crate::se2::wrap(angle - TAU * b as f64 / DIRECTIONS as f64).abs();
    (0..DIRECTIONS).filter(|b| off(*b) <= AGREE).fold(0, |bits, b| bits | 1 << b)
}

impl LikelihoodField {
    /// Makes the field with a reach of `reach` cells. At most 65534 points can be held; they come ordered by cell.
    pub fn new(grid: &OccupancyGrid, boundary: &[BoundaryPoint], reach: usize) -> Self {
        assert!(boundary.len() < usize::from(u16::MAX), "boundary must be thinned first");
        let (w, h) = (grid.width(), grid.height());
        let mut nearest = vec![[boundary.len() as u16; DIRECTIONS]; w * h + 1];
        // Points come row by row, so that few rows are open at a time, which stay in the near cache.
        let open_rows = OPEN_ROWS.min(h);
        let mut squared = vec![[u8::MAX; DIRECTIONS]; open_rows * w];
        let mut opened = 0;
        let to_grid = grid.locator();
        let agreeing: Vec<u8> =
            boundary.iter().map(|p| agreeing(to_grid.rotate(p.normal))).collect();
        let place =
            |p: &BoundaryPoint| (p.cell as isize / w as isize, p.cell as isize % w as isize);
        let places: Vec<(isize, isize)> = boundary.iter().map(place).collect();
        let catchments = Catchments::new(reach);
        let index = CellIndex::new(grid, boundary.iter().map(|p| p.cell));
        for (k, p) in boundary.iter().enumerate() {
            let (row, col) = places[k];
            while opened <= (row as usize + MAX_REACH).min(h - 1) {
                squared[opened % open_rows * w..][..w].fill([u8::MAX; DIRECTIONS]);
                opened += 1;
            }
            // Who agrees wherever this one does takes all cells that lie nearer to it.
            let mut mine = catchments.alone();
            index.for_window(p.cell, catchment::AROUND, |q| {
                if agreeing[k] & !agreeing[q] == 0 {
                    catchments.cede(&mut mine, places[q].0 - row, places[q].1 - col);
                }
            });
            for (dr, from, to) in mine.rows() {
                let at = row + dr;
                if !(0..h as isize).contains(&at) {
                    continue;
                }
                let squared = &mut squared[at as usize % open_rows * w..][..w];
                let nearest = &mut nearest[at as usize * w..][..w];
                for at in (col + from).max(0)..=(col + to).min(w as isize - 1) {
                    let d2 = (dr * dr + (at - col) * (at - col)) as u8;
                    let (squared, nearest) = (&mut squared[at as usize], &mut nearest[at as usize]);
                    let mut directions = agreeing[k];
                    while directions != 0 {
                        let b = directions.trailing_zeros() as usize;
                        directions &= directions - 1;
                        if d2 < squared[b] {
                            squared[b] = d2;
                            nearest[b] = k as u16;
                        }
                    }
                }
            }
        }
        let to_axes = grid.origin().inverse().to_rigid();
        let wall = |b: &BoundaryPoint| {
            let (p, n) = (to_axes.apply(b.position), to_axes.rotate(b.normal));
            Wall { x: p.x as f32, y: p.y as f32, nx: n.x as f32, ny: n.y as f32 }
        };
        let walls = boundary.iter().map(wall).chain([NO_WALL]).collect();
        Self { nearest: Arc::new(nearest), columns: w, is_turned: false, walls }
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

    /// Index of the nearest wall point whose normal agrees with `direction` (in the grid's axes), at
    /// a cell of the grid; none within reach.
    #[inline(always)]
    pub fn nearest(&self, cell: usize, direction: usize) -> Option<usize> {
        let (cell, direction) = match self.is_turned {
            true => {
                let (row, col) = (cell / self.columns, cell % self.columns);
                ((row + 1) * self.columns - 1 - col, turned(direction))
            }
            false => (cell, direction),
        };
        let k = usize::from(self.nearest[cell][direction]);
        (k + 1 < self.walls.len()).then_some(k)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::se2::Se2;
    use rand::{Rng, SeedableRng};

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
        let field = LikelihoodField::new(&grid, &points, reach);
        for cell in 0..w * h {
            let at = grid.cell_center(cell / w, cell % w);
            for d in 0..DIRECTIONS {
                let a = TAU * d as f64 / 8.0;
                let axis = grid.origin().rotate(Vec2::new(a.cos(), a.sin()));
                let best = points
                    .iter()
                    .filter(|p| p.normal.dot(&axis) >= AGREE.cos())
                    .map(|p| (p.position - at).norm())
                    .filter(|r| *r <= 0.1 * reach as f64 + 1e-9)
                    .min_by(f64::total_cmp);
                let got = field.nearest(cell, d).map(|k| (points[k].position - at).norm());
                match (best, got) {
                    (Some(b), Some(g)) => assert!((b - g).abs() < 1e-9),
                    (None, None) => {}
                    other => panic!("{w} x {h}, cell {cell}, direction {d}: {other:?}"),
                }
            }
        }
    }
}
