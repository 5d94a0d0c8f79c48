//! The occupancy grid, and the only code that turns cells into metres.

use crate::error::{Error, Result};
use crate::se2::{Rigid, Se2, Vec2};
use std::ops::Range;

/// Cell value of a cell that nobody has seen.
pub const UNKNOWN: i8 = -1;
/// Largest occupancy (percent) of a free cell; nav2's free_thresh rounds to this.
pub const FREE_AT_MOST: i8 = 25;
/// Smallest occupancy (percent) of an occupied cell; nav2's occupied_thresh.
pub const OCCUPIED_AT_LEAST: i8 = 65;

/// Farthest that a grid may lie from its map frame's origin, metres: beyond it cells of a few
/// centimetres drown in rounding.
const MAX_ORIGIN: f64 = 1e8;

/// Largest side of a cell, metres: a larger one is a mistake, and finer maps' tables of it would not fit
/// in memory.
const MAX_RESOLUTION: f64 = 10.0;

/// What a cell is (paper, section 4: the classes C).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Class {
    /// Seen to be empty.
    Free,
    /// Seen to hold something.
    Occupied,
    /// Not seen, or undecided. Evidence for nothing.
    Unknown,
}

/// The class of a cell value (percent, -1 unknown).
#[inline(always)]
pub fn class_of(value: i8) -> Class {
    match value {
        0..=FREE_AT_MOST => Class::Free,
        OCCUPIED_AT_LEAST..=i8::MAX => Class::Occupied,
        _ => Class::Unknown,
    }
}

/// A 2D occupancy grid, as nav_msgs/OccupancyGrid has it: `cells[row * width + col]`, row 0 at the
/// lowest y, values -1 (unknown) or 0..=100 (percent); `origin` is the pose of the lower left
/// corner of cell (0, 0) in the map frame.
#[derive(Debug, Clone, PartialEq)]
pub struct OccupancyGrid {
    name: String,
    width: usize,
    height: usize,
    resolution: f64,
    origin: Se2,
    cells: Vec<i8>,
}

impl OccupancyGrid {
    /// Checks and takes the cells. Errors name the field.
    pub fn new(
        name: impl Into<String>,
        width: usize,
        height: usize,
        resolution: f64,
        origin: Se2,
        cells: Vec<i8>,
    ) -> Result<Self> {
        let name = name.into();
        let fail = |field, problem: String| Err(Error::Grid { map: name.clone(), field, problem });
        if width == 0 || height == 0 {
            return fail("size", format!("{width} x {height} cells; a map needs at least one"));
        }
        if width.checked_mul(height) != Some(cells.len()) {
            return fail("cells", format!("{} values for {width} x {height} cells", cells.len()));
        }
        if !(resolution.is_finite() && resolution > 0.0) {
            return fail("resolution", format!("{resolution} m; must be finite and positive"));
        }
        if resolution > MAX_RESOLUTION {
            return fail(
                "resolution",
                format!("{resolution} m; at most {MAX_RESOLUTION} m a cell"),
            );
        }
        if !(origin.x.is_finite() && origin.y.is_finite() && origin.theta.is_finite()) {
            return fail("origin", "x, y and theta must be finite".into());
        }
        if origin.x.abs().max(origin.y.abs()) > MAX_ORIGIN {
            return fail("origin", format!("farther than {MAX_ORIGIN:e} m from the map frame"));
        }
        let (least, most) = cells.iter().fold((0, 0), |(l, m), v| (i8::min(l, *v), i8::max(m, *v)));
        if let Some(v) = [least, most].iter().find(|v| **v < UNKNOWN || **v > 100) {
            return fail("cells", format!("value {v}; must be -1 or 0..=100"));
        }
        Ok(Self { name, width, height, resolution, origin, cells })
    }

    /// The mirror image, in the same place: columns turned over.
    pub fn mirrored(&self) -> Self {
        self.with_cells(turned_over(&self.cells, self.width))
    }

    /// The same map with so many unknown cells about all that is free or occupied, neither more nor less. A map of nothing
    /// else stays as it is.
    pub fn trimmed(self, rim: usize) -> Self {
        let mut is_known = vec![false; self.width];
        let (mut bottom, mut top) = (self.height, 0);
        for (k, row) in self.cells.chunks_exact(self.width).enumerate() {
            // Of most rows beside a building every cell is the same: those are passed over at once.
            if row.iter().fold(UNKNOWN, |most, v| most.max(*v)) == UNKNOWN {
                continue;
            }
            let mut is_any = false;
            for (known, v) in is_known.iter_mut().zip(row) {
                let here = class_of(*v) != Class::Unknown;
                *known |= here;
                is_any |= here;
            }
            if is_any {
                (bottom, top) = (bottom.min(k), k + 1);
            }
        }
        let known = (is_known.iter().position(|k| *k), is_known.iter().rposition(|k| *k));
        let (Some(left), Some(last)) = known else { return self };
        self.part(bottom..top, left..last + 1, rim)
    }

    /// Some rows and columns of the map, and so many unknown cells about them.
    pub(crate) fn part(&self, rows: Range<usize>, columns: Range<usize>, rim: usize) -> Self {
        let (width, height) = (columns.len() + 2 * rim, rows.len() + 2 * rim);
        let mut cells = vec![UNKNOWN; width * height];
        let kept = self.cells.chunks_exact(self.width).take(rows.end).skip(rows.start);
        for (out, row) in cells.chunks_exact_mut(width).skip(rim).zip(kept) {
            out[rim..rim + columns.len()].copy_from_slice(&row[columns.clone()]);
        }
        let at = |first: usize| first as f64 - rim as f64;
        let corner = self.grid_to_map(at(columns.start), at(rows.start));
        let origin = Se2::from_parts(corner, self.origin.theta);
        Self { name: self.name.clone(), width, height, origin, cells, ..*self }
    }

    /// The same map with other values, as many and each a valid one.
    pub(crate) fn with_cells(&self, cells: Vec<i8>) -> Self {
        debug_assert_eq!(cells.len(), self.cells.len());
        Self { name: self.name.clone(), cells, ..*self }
    }

    /// What results call this map.
    pub fn name(&self) -> &str {
        &self.name
    }
    /// Number of columns.
    pub fn width(&self) -> usize {
        self.width
    }
    /// Number of rows.
    pub fn height(&self) -> usize {
        self.height
    }
    /// Side of a cell, metres.
    pub fn resolution(&self) -> f64 {
        self.resolution
    }
    /// Pose of the lower left corner of cell (0, 0) in the map frame.
    pub fn origin(&self) -> Se2 {
        self.origin
    }
    /// The values, row by row from the lowest y.
    pub fn cells(&self) -> &[i8] {
        &self.cells
    }
    /// Class of the cell.
    #[inline(always)]
    pub fn class(&self, row: usize, col: usize) -> Class {
        class_of(self.cells[row * self.width + col])
    }
    /// Class of the cell, Unknown outside the grid.
    #[inline(always)]
    pub fn class_or_unknown(&self, row: isize, col: isize) -> Class {
        if row < 0 || col < 0 || row >= self.height as isize || col >= self.width as isize {
            Class::Unknown
        } else {
            self.class(row as usize, col as usize)
        }
    }
    /// Centre of the cell in map coordinates, metres.
    pub fn cell_center(&self, row: usize, col: usize) -> Vec2 {
        self.grid_to_map(col as f64 + 0.5, row as f64 + 0.5)
    }
    /// Map coordinates of a point in cells (columns, rows from the corner of cell (0, 0)).
    pub fn grid_to_map(&self, col: f64, row: f64) -> Vec2 {
        self.origin.apply(Vec2::new(col * self.resolution, row * self.resolution))
    }
    /// The look-up from map coordinates to cells.
    pub fn locator(&self) -> Locator {
        self.locator_from(&Se2::IDENTITY)
    }
    /// The look-up from another frame's coordinates to cells, `T_map_frame` given.
    pub fn locator_from(&self, t_map_frame: &Se2) -> Locator {
        Locator {
            t_grid_map: self.origin.inverse().compose(t_map_frame).to_rigid(),
            inv_resolution: 1.0 / self.resolution,
            width: self.width,
            height: self.height,
        }
    }
    /// Number of cells that are of another class in a map of the same size.
    pub fn count_differing(&self, other: &OccupancyGrid) -> usize {
        const AT_ONCE: usize = 1024;
        let differs = |(a, b): &(&i8, &i8)| class_of(**a) != class_of(**b);
        // Mostly few values differ at all: whether any of many does is told at once.
        let some = self.cells.chunks(AT_ONCE).zip(other.cells.chunks(AT_ONCE));
        some.filter(|(a, b)| a != b).map(|(a, b)| a.iter().zip(b).filter(differs).count()).sum()
    }
    /// Number of cells of a class.
    pub fn count(&self, class: Class) -> usize {
        self.cells.iter().filter(|v| class_of(**v) == class).count()
    }
    /// Mean of the centres of the known cells in map coordinates; none for a blank map.
    pub fn known_center(&self) -> Option<Vec2> {
        const AT_ONCE: usize = 1024;
        let (mut n, mut sr, mut sc) = (0usize, 0usize, 0usize);
        for (row, line) in self.cells.chunks_exact(self.width).enumerate() {
            // Few columns at a time: their sums fit in narrow numbers, many of which are added at once.
            for (chunk, cells) in line.chunks(AT_ONCE).enumerate() {
                let (mut known, mut cols) = (0u32, 0u32);
                for (col, v) in (0u32..).zip(cells) {
                    let is_known = u32::from(class_of(*v) != Class::Unknown);
                    known += is_known;
                    cols += is_known * col;
                }
                let known = known as usize;
                n += known;
                sr += known * row;
                sc += known * chunk * AT_ONCE + cols as usize;
            }
        }
        (n > 0).then(|| self.grid_to_map(sc as f64 / n as f64 + 0.5, sr as f64 / n as f64 + 0.5))
    }
}

/// Rows of so many values, each from its last to its first.
pub(crate) fn turned_over<T: Copy>(values: &[T], columns: usize) -> Vec<T> {
    let mut out = Vec::with_capacity(values.len());
    values.chunks_exact(columns).for_each(|row| out.extend(row.iter().rev()));
    out
}

/// Turns coordinates of a frame into cells of one grid; see [`OccupancyGrid::locator_from`].
#[derive(Debug, Clone, Copy)]
pub struct Locator {
    t_grid_map: Rigid,
    inv_resolution: f64,
    width: usize,
    height: usize,
}

impl Locator {
    /// Position in cells, (column, row), not rounded.
    #[inline(always)]
    pub fn to_cells(&self, p: Vec2) -> Vec2 {
        self.t_grid_map.apply(p) * self.inv_resolution
    }
    /// A direction of the frame in the grid's own axes.
    #[inline(always)]
    pub fn rotate(&self, v: Vec2) -> Vec2 {
        self.t_grid_map.rotate(v)
    }
    /// Index of the cell that holds the point, none outside the grid.
    #[inline(always)]
    pub fn index(&self, p: Vec2) -> Option<usize> {
        self.cell(p).map(|(row, col)| row * self.width + col)
    }
    /// Row and column of the cell that holds the point, none outside the grid.
    #[inline(always)]
    pub fn cell(&self, p: Vec2) -> Option<(usize, usize)> {
        let q = self.to_cells(p);
        // A negative float turns into 0 by `as`, so the sign is asked first.
        if q.x < 0.0 || q.y < 0.0 {
            return None;
        }
        let (col, row) = (q.x as usize, q.y as usize);
        (col < self.width && row < self.height).then_some((row, col))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_and_metres_agree_under_rotation() {
        let g = OccupancyGrid::new("g", 7, 4, 0.25, Se2::new(3.0, -2.0, 0.7), vec![0; 28]).unwrap();
        let t = Se2::new(-1.0, 5.0, 2.0);
        let here = g.locator();
        let there = g.locator_from(&t);
        for row in 0..4 {
            for col in 0..7 {
                let p = g.cell_center(row, col);
                assert_eq!(here.index(p), Some(row * 7 + col));
                assert_eq!(there.index(t.inverse().apply(p)), Some(row * 7 + col));
            }
        }
        assert_eq!(here.index(g.grid_to_map(-0.01, 1.0)), None);
        assert_eq!(here.index(g.grid_to_map(7.01, 1.0)), None);
    }

    #[test]
    fn a_trimmed_map_has_the_same_cells_in_the_same_places() {
        let values = [((2, 3), 100), ((4, 6), 0), ((3, 4), 40)];
        // With room about them, and with none.
        for (w, h, rows, cols) in [(12, 9, 1, 2), (4, 3, -2, -3)] {
            let mut cells = vec![UNKNOWN; w * h];
            for ((row, col), v) in values {
                cells[(row + rows) as usize * w + (col + cols) as usize] = v;
            }
            // Undecided cells are unknown ones.
            if h > 3 {
                cells[w - 1] = 50;
            }
            let g = OccupancyGrid::new("g", w, h, 0.25, Se2::new(3.0, -2.0, 0.7), cells).unwrap();
            let trimmed = g.clone().trimmed(1);
            assert_eq!((trimmed.width(), trimmed.height()), (6, 5));
            for row in 0..5 {
                for col in 0..6 {
                    let p = trimmed.cell_center(row, col);
                    let at = g.locator().index(p);
                    let expected = at.map_or(UNKNOWN, |k| g.cells()[k]);
                    assert_eq!(trimmed.cells()[row * 6 + col], expected);
                    assert!(at.is_none_or(|k| (p - g.cell_center(k / w, k % w)).norm() < 1e-12));
                }
            }
            assert_eq!(trimmed.clone().trimmed(1).cells(), trimmed.cells());
            let wider = trimmed.clone().trimmed(3);
            assert_eq!((wider.width(), wider.height()), (10, 9));
            assert!((wider.cell_center(2, 2) - trimmed.cell_center(0, 0)).norm() < 1e-12);
        }
        let blank = OccupancyGrid::new("g", 2, 2, 0.25, Se2::IDENTITY, vec![UNKNOWN; 4]).unwrap();
        assert_eq!(blank.clone().trimmed(1), blank);
    }

    #[test]
    fn cells_of_another_class_are_counted_wherever_they_lie() {
        let cells: Vec<i8> = (0..50 * 61).map(|k| [0, 100, UNKNOWN][k % 3]).collect();
        let g = OccupancyGrid::new("g", 50, 61, 0.1, Se2::IDENTITY, cells.clone()).unwrap();
        assert_eq!(g.count_differing(&g), 0);
        let mut others = cells;
        // Other values of the same class, and two of other ones, the last cell among them.
        (others[3], others[4], others[5]) = (20, 70, 50);
        (others[1500], others[3049]) = (100, UNKNOWN);
        assert_eq!(g.count_differing(&g.with_cells(others)), 2);
    }

    #[test]
    fn bad_grids_name_the_field() {
        let bad = |w, h, r, o: Se2, c: Vec<i8>| OccupancyGrid::new("m", w, h, r, o, c).unwrap_err();
        assert!(bad(0, 1, 0.1, Se2::IDENTITY, vec![]).to_string().contains("size"));
        assert!(bad(2, 1, 0.1, Se2::IDENTITY, vec![0]).to_string().contains("cells"));
        assert!(bad(1, 1, -0.1, Se2::IDENTITY, vec![0]).to_string().contains("resolution"));
        assert!(bad(1, 1, 0.1, Se2::IDENTITY, vec![101]).to_string().contains("101"));
        let nan = Se2 { x: f64::NAN, y: 0.0, theta: 0.0 };
        assert!(bad(1, 1, 0.1, nan, vec![0]).to_string().contains("origin"));
    }
}
