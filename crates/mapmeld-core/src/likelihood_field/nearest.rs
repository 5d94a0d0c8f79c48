//! The nearest wall points of every cell. Most cells have none, and neighbours mostly the same ones: a cell points to an
//! entry, which it mostly shares with the cell before or above, so that the tables of a map fit in a processor's cache.

use super::{AGREE, AXES, DIRECTIONS};
use crate::boundary::{BoundaryPoint, CellIndex};
use crate::catchment::{self, Catchments, MAX_REACH};
use crate::grid::OccupancyGrid;
use crate::se2::Vec2;

/// For each direction the index of a wall point, or the number of points where there is none.
pub(super) type Nearest = [u16; DIRECTIONS];

/// See the module's text.
#[derive(Debug)]
pub(super) struct NearestPoints {
    /// The entry of each cell, row by row, and last of what lies outside the grid.
    entry_of: Vec<u32>,
    /// First that nothing is near.
    entries: Vec<Nearest>,
}

impl NearestPoints {
    /// Of a cell by its index, or of what lies outside by the number of cells.
    #[inline(always)]
    pub(super) fn at(&self, cell: usize) -> &Nearest {
        &self.entries[self.entry_of[cell] as usize]
    }

    /// Takes in what a few cells of a row have near them, mostly the same as the cell before or above.
    #[inline(always)]
    fn take_in(&mut self, first: usize, width: usize, ranks: &[Ranks]) {
        let (mut last, mut before) = (0, self.entries[0]);
        // Where it is new no branch tells, which a processor could not foresee.
        let (mut new, mut found) = ([before; AT_ONCE], 0);
        for (cell, ranks) in (first..).zip(ranks) {
            let nearest = ranks.map(|r| r as u16);
            let above = if cell < width { 0 } else { self.entry_of[cell - width] };
            let is_above = self.entries[above as usize] == nearest;
            let is_last = before == nearest;
            new[found] = nearest;
            let fresh = (self.entries.len() + found) as u32;
            last = if is_last {
                last
            } else if is_above {
                above
            } else {
                fresh
            };
            found += usize::from(!is_last & !is_above);
            self.entry_of[cell] = last;
            before = nearest;
        }
        self.entries.extend_from_slice(&new[..found]);
    }
}

/// Of a grid's boundary, whose points come ordered by cell as in `index`: for every cell the points within so many cells
/// that agree with each direction, the first of those equally near.
#[multiversion::multiversion(targets("x86_64+avx2"))]
pub(super) fn nearest_of(
    grid: &OccupancyGrid,
    boundary: &[BoundaryPoint],
    index: &CellIndex,
    reach: usize,
) -> NearestPoints {
    let (w, h) = (grid.width(), grid.height());
    let to_grid = grid.locator();
    let disagree: Vec<Ranks> =
        boundary.iter().map(|p| disagreeing(to_grid.rotate(p.normal))).collect();
    let place = |p: &BoundaryPoint| (p.cell as isize / w as isize, p.cell as isize % w as isize);
    let places: Vec<(isize, isize)> = boundary.iter().map(place).collect();
    let catchments = Catchments::new(reach);
    let mut open = OpenRows::new((w, h), reach, boundary.len());
    for (k, p) in boundary.iter().enumerate() {
        let (row, col) = places[k];
        open.close_before((row as usize).saturating_sub(reach));
        // Who agrees wherever this one does takes all cells that lie nearer to it.
        let mut mine = catchments.alone();
        index.for_window(p.cell, catchment::AROUND, |q| {
            if disagree[q].iter().zip(&disagree[k]).all(|(q, own)| q & !own == 0) {
                catchments.cede(&mut mine, places[q].0 - row, places[q].1 - col);
            }
        });
        for (dr, from, to) in mine.rows() {
            let at = row + dr;
            let (from, to) = (from.max(-col), to.min(w as isize - 1 - col));
            if !(0..h as isize).contains(&at) || from > to {
                continue;
            }
            let cells = open.cells(at as usize, (col + from) as usize, (col + to) as usize);
            let disagree = disagree[k];
            for (dc, ranks) in (from..).zip(cells) {
                let own = rank((dr * dr + dc * dc) as u8, k);
                *ranks = std::array::from_fn(|b| ranks[b].min(own | disagree[b]));
            }
        }
    }
    open.close_before(h);
    open.closed
}

// A squared distance within reach fits a byte, below that of where nothing is.
const _: () = assert!(MAX_REACH * MAX_REACH < u8::MAX as usize);

/// A rank for each direction.
type Ranks = [u32; DIRECTIONS];

/// The nearer point ranks lower, and of those equally near the one that comes first; its index is in the lower half.
fn rank(squared: u8, point: usize) -> u32 {
    u32::from(squared) << 16 | point as u32
}

/// No bit in the directions that a normal, in the grid's axes, agrees with; all of them in the others, which makes any
/// rank the last.
fn disagreeing(n: Vec2) -> Ranks {
    let least = AGREE.cos();
    AXES.map(|(x, y)| if n.x * x + n.y * y >= least { 0 } else { u32::MAX })
}

/// Points come row by row: only the rows within reach of the last one are open.
struct OpenRows {
    width: usize,
    rows: usize,
    /// Rows that no further point reaches.
    done: usize,
    closed: NearestPoints,
    ranks: Vec<Ranks>,
    none: Ranks,
    /// Whether any of some columns of an open row has a point near it.
    is_near: Vec<bool>,
}

/// Columns that are asked at once whether anything is near them.
const AT_ONCE: usize = 16;

impl OpenRows {
    fn new((width, height): (usize, usize), reach: usize, points: usize) -> Self {
        let (rows, none) = (2 * reach + 1, [rank(u8::MAX, points); DIRECTIONS]);
        Self {
            width,
            rows,
            done: 0,
            closed: NearestPoints {
                entry_of: vec![0; width * height + 1],
                entries: vec![[points as u16; DIRECTIONS]],
            },
            ranks: vec![none; rows * width],
            none,
            is_near: vec![false; rows * width.div_ceil(AT_ONCE)],
        }
    }

    /// The cells of an open row from one column to another, which a point is near.
    #[inline(always)]
    fn cells(&mut self, row: usize, from: usize, to: usize) -> &mut [Ranks] {
        let row = row % self.rows;
        let near = &mut self.is_near[row * self.width.div_ceil(AT_ONCE)..];
        near[from / AT_ONCE..=to / AT_ONCE].fill(true);
        &mut self.ranks[row * self.width..][from..=to]
    }

    /// Closes the rows before one: their cells are what they will be.
    #[inline(always)]
    fn close_before(&mut self, row: usize) {
        while self.done < row {
            let (width, first) = (self.width, self.done * self.width);
            let open = self.done % self.rows;
            let near = &mut self.is_near[open * width.div_ceil(AT_ONCE)..];
            let line = &mut self.ranks[open * width..][..width];
            for (k, (ranks, is_near)) in line.chunks_mut(AT_ONCE).zip(near).enumerate() {
                if std::mem::take(is_near) {
                    self.closed.take_in(first + k * AT_ONCE, width, ranks);
                    ranks.fill(self.none);
                }
            }
            self.done += 1;
        }
    }
}
