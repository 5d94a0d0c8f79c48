//! The nearest wall point of like orientation, looked up in one step.
//!
//! A likelihood field (Thrun, Burgard, Fox, Probabilistic Robotics, section 6.4) that knows the
//! direction of walls: for every cell and each of eight directions it holds the nearest wall point
//! whose normal agrees.

use crate::blocks::{self, Block, LANES};
use crate::boundary::BoundaryPoint;
use crate::grid::{Locator, OccupancyGrid};
use crate::probe::Axes;
use crate::se2::{Se2, Vec2};
use std::f64::consts::TAU;

/// Number of directions that are told apart.
pub const DIRECTIONS: usize = 8;
/// Normals agree with a direction when within this angle of it, radians. Half a bin and a
/// tolerance of about 30 degrees.
const AGREE: f64 = 0.92;

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
    /// wall.
    nearest: Vec<[u16; DIRECTIONS]>,
    /// The last one is [`NO_WALL`].
    walls: Vec<Wall>,
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
    /// Makes the field with a reach of `reach` cells. At most 65534 points can be held.
    pub fn new(grid: &OccupancyGrid, boundary: &[BoundaryPoint], reach: usize) -> Self {
        assert!(boundary.len() < usize::from(u16::MAX), "boundary must be thinned first");
        let (w, h) = (grid.width(), grid.height());
        let mut nearest = vec![[boundary.len() as u16; DIRECTIONS]; w * h + 1];
        let mut squared = vec![[u8::MAX; DIRECTIONS]; w * h];
        let r = reach as isize;
        let to_grid = grid.locator();
        for (k, p) in boundary.iter().enumerate() {
            let n = to_grid.rotate(p.normal);
            let angle = n.y.atan2(n.x);
            // A direction that does not agree is farther than any byte.
            let far: [u8; DIRECTIONS] = std::array::from_fn(|b| {
                let off = crate::se2::wrap(angle - TAU * b as f64 / DIRECTIONS as f64).abs();
                if off <= AGREE {
                    0
                } else {
                    u8::MAX
                }
            });
            let (row, col) = ((p.cell as usize / w) as isize, (p.cell as usize % w) as isize);
            for dr in -r..=r {
                if !(0..h as isize).contains(&(row + dr)) {
                    continue;
                }
                let half = ((r * r - dr * dr) as f64).sqrt() as isize;
                let line = (row + dr) as usize * w;
                for cc in (col - half).max(0)..=(col + half).min(w as isize - 1) {
                    let (dc, at) = (cc - col, line + cc as usize);
                    let d2 = (dr * dr + dc * dc).min(254) as u8;
                    let (squared, nearest) = (&mut squared[at], &mut nearest[at]);
                    for b in 0..DIRECTIONS {
                        let d = d2 | far[b];
                        let is_nearer = d < squared[b];
                        squared[b] = if is_nearer { d } else { squared[b] };
                        nearest[b] = if is_nearer { k as u16 } else { nearest[b] };
                    }
                }
            }
        }
        let to_axes = grid.origin().inverse().to_rigid();
        let wall = |b: &BoundaryPoint| {
            let (p, n) = (to_axes.apply(b.position), to_axes.rotate(b.normal));
            Wall { x: p.x as f32, y: p.y as f32, nx: n.x as f32, ny: n.y as f32 }
        };
        Self { nearest, walls: boundary.iter().map(wall).chain([NO_WALL]).collect() }
    }

    /// The field of the mirror image of a grid so many columns and metres wide, whose boundary has the mirrored
    /// points in the same order.
    pub fn mirrored(&self, columns: usize, width: f64) -> Self {
        let cell = |at: &[u16; DIRECTIONS]| -> [u16; DIRECTIONS] {
            std::array::from_fn(|b| at[(DIRECTIONS + DIRECTIONS / 2 - b) % DIRECTIONS])
        };
        let mut nearest = Vec::with_capacity(self.nearest.len());
        let (outside, cells) = self.nearest.split_last().expect("what lies outside");
        let rows = cells.chunks_exact(columns);
        rows.for_each(|row| nearest.extend(row.iter().rev().map(cell)));
        nearest.push(*outside);
        let wall = |w: &Wall| Wall { x: (width - f64::from(w.x)) as f32, nx: -w.nx, ..*w };
        Self { nearest, walls: self.walls.iter().map(wall).collect() }
    }

    /// Index of the nearest wall point whose normal agrees with `direction` (in the grid's axes), at
    /// a cell; none within reach.
    #[inline(always)]
    pub fn nearest(&self, cell: usize, direction: usize) -> Option<usize> {
        let k = usize::from(self.nearest[cell][direction]);
        (k + 1 < self.walls.len()).then_some(k)
    }
}

/// Looks points of another frame up in a field.
#[derive(Clone, Copy)]
pub struct FieldView<'a> {
    field: &'a LikelihoodField,
    locator: Locator,
}

impl<'a> FieldView<'a> {
    /// A view of the field from a frame, `t_map_frame` given.
    pub fn new(grid: &OccupancyGrid, field: &'a LikelihoodField, t_map_frame: &Se2) -> Self {
        Self { field, locator: grid.locator_from(t_map_frame) }
    }

    /// Cell of a point of the frame, none outside the grid.
    #[inline(always)]
    pub fn cell(&self, p: Vec2) -> Option<usize> {
        self.locator.index(p)
    }

    /// Nearest wall point like-oriented with `normal` (a vector of the frame) at a cell.
    #[inline(always)]
    pub fn nearest(&self, cell: usize, normal: Vec2) -> Option<usize> {
        self.field.nearest(cell, direction(self.locator.rotate(normal)))
    }
}

/// Looks another map's probes up in a field.
#[derive(Clone, Copy)]
pub struct ProbeView<'a> {
    field: &'a LikelihoodField,
    axes: Axes,
    per_metre: f32,
    width: f32,
    height: f32,
    columns: i32,
    /// Index of the cell beyond the last.
    outside: u32,
}

/// Where the probes of a block came to lie.
pub struct Seen {
    /// In the grid's axes, metres.
    pub x: [f32; LANES],
    /// The same.
    pub y: [f32; LANES],
    /// Indices of the grid's cells, row by row; one beyond the last for what lies outside the grid.
    pub cell: [u32; LANES],
    /// Directions of their normals.
    octant: [u8; LANES],
}

/// The walls that are near the probes of a block; without a normal where there is none.
pub struct Walls {
    /// In the grid's axes, metres.
    pub x: [f32; LANES],
    /// The same.
    pub y: [f32; LANES],
    /// Unit normals into free space.
    pub nx: [f32; LANES],
    /// The same.
    pub ny: [f32; LANES],
}

impl<'a> ProbeView<'a> {
    /// A view of the field of a grid from the axes of another one.
    pub fn new(grid: &OccupancyGrid, field: &'a LikelihoodField, t_axes_axes: &Se2) -> Self {
        Self {
            field,
            axes: Axes::new(t_axes_axes),
            per_metre: (1.0 / grid.resolution()) as f32,
            width: grid.width() as f32,
            height: grid.height() as f32,
            columns: grid.width() as i32,
            outside: grid.cells().len() as u32,
        }
    }

    /// Where probes lie.
    #[inline(always)]
    pub fn see(&self, block: &Block) -> Seen {
        let mut seen =
            Seen { x: [0.0; LANES], y: [0.0; LANES], cell: [0; LANES], octant: [0; LANES] };
        for k in 0..LANES {
            let (x, y) = self.axes.apply(block.x[k], block.y[k]);
            (seen.x[k], seen.y[k]) = (x, y);
            let (u, v) = (x * self.per_metre, y * self.per_metre);
            let is_inside = (u >= 0.0) & (v >= 0.0) & (u < self.width) & (v < self.height);
            let (row, col) = (blocks::whole(v), blocks::whole(u));
            let cell = row.wrapping_mul(self.columns).wrapping_add(col);
            seen.cell[k] = if is_inside { cell as u32 } else { self.outside };
        }
        for (octant, direction) in seen.octant.iter_mut().zip(block.direction) {
            *octant = self.axes.octant(direction) as u8;
        }
        seen
    }

    /// The nearest walls that are oriented like what lies there, or, turned by half a turn, against it.
    #[inline(always)]
    pub fn walls(&self, seen: &Seen, half_turns: usize) -> Walls {
        // All indices first: none of these loads waits for another.
        let mut nearest = [0u16; LANES];
        for (k, nearest) in nearest.iter_mut().enumerate() {
            let octant = (usize::from(seen.octant[k]) + half_turns * DIRECTIONS / 2) % DIRECTIONS;
            *nearest = self.field.nearest[seen.cell[k] as usize][octant];
        }
        let mut walls = Walls::none();
        for (k, nearest) in nearest.into_iter().enumerate() {
            let wall = &self.field.walls[usize::from(nearest)];
            (walls.x[k], walls.y[k]) = (wall.x, wall.y);
            (walls.nx[k], walls.ny[k]) = (wall.nx, wall.ny);
        }
        walls
    }
}

impl Walls {
    /// Squared distances of what was seen, square metres, infinite where there is no wall; so much along a wall costs nothing.
    #[inline(always)]
    pub fn squared(&self, seen: &Seen, slack: f32) -> [f32; LANES] {
        let mut found = [f32::INFINITY; LANES];
        for (k, found) in found.iter_mut().enumerate() {
            let (dx, dy) = (seen.x[k] - self.x[k], seen.y[k] - self.y[k]);
            let across = dx * self.nx[k] + dy * self.ny[k];
            let along = (dx * self.ny[k] - dy * self.nx[k]).abs() - slack;
            let along = if along > 0.0 { along } else { 0.0 };
            let squared = across * across + along * along;
            *found = if self.is_there(k) { squared } else { *found };
        }
        found
    }

    /// How far what was seen lies from the walls along their normals, metres; zero where there is no wall.
    #[inline(always)]
    pub fn residuals(&self, seen: &Seen) -> [f32; LANES] {
        let mut found = [0.0; LANES];
        for (k, found) in found.iter_mut().enumerate() {
            let (dx, dy) = (seen.x[k] - self.x[k], seen.y[k] - self.y[k]);
            *found = dx * self.nx[k] + dy * self.ny[k];
        }
        found
    }

    fn none() -> Self {
        let zero = [0.0; LANES];
        Self { x: zero, y: zero, nx: zero, ny: zero }
    }

    /// Whether there is one.
    #[inline(always)]
    pub fn is_there(&self, lane: usize) -> bool {
        self.nx[lane] * self.nx[lane] + self.ny[lane] * self.ny[lane] > 0.5
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};

    #[test]
    fn direction_is_the_nearest_octant() {
        for k in 0..720 {
            let a = (k as f64 + 0.25) * TAU / 720.0;
            let expected = ((a / TAU * 8.0).round() as usize) % 8;
            assert_eq!(direction(Vec2::new(a.cos(), a.sin())), expected, "{}", a.to_degrees());
        }
    }

    #[test]
    fn holds_the_nearest_agreeing_point() {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(3);
        let (w, h) = (30, 25);
        let grid =
            OccupancyGrid::new("g", w, h, 0.1, Se2::new(1.0, 2.0, 0.3), vec![0; w * h]).unwrap();
        let points: Vec<BoundaryPoint> = (0..25)
            .map(|_| {
                let cell = rng.random_range(0..w * h);
                let a: f64 = rng.random_range(0.0..TAU);
                BoundaryPoint {
                    position: grid.cell_center(cell / w, cell % w),
                    normal: grid.origin().rotate(Vec2::new(a.cos(), a.sin())),
                    cell: cell as u32,
                    straightness: 1.0,
                }
            })
            .collect();
        let field = LikelihoodField::new(&grid, &points, 6);
        for cell in 0..w * h {
            let at = grid.cell_center(cell / w, cell % w);
            for d in 0..DIRECTIONS {
                let a = TAU * d as f64 / 8.0;
                let axis = grid.origin().rotate(Vec2::new(a.cos(), a.sin()));
                let best = points
                    .iter()
                    .filter(|p| p.normal.dot(&axis) >= AGREE.cos())
                    .map(|p| (p.position - at).norm())
                    .filter(|r| *r <= 0.6 + 1e-9)
                    .min_by(f64::total_cmp);
                let got = field.nearest(cell, d).map(|k| (points[k].position - at).norm());
                match (best, got) {
                    (Some(b), Some(g)) => assert!((b - g).abs() < 1e-9),
                    (None, None) => {}
                    other => panic!("cell {cell} direction {d}: {other:?}"),
                }
            }
        }
    }
}
