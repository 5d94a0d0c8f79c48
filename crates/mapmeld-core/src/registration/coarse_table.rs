//! What a wall sample of another map scores in each coarse cell of a map, by its direction: like-oriented walls
//! nearby for it, clear free space against it.

use crate::blocks::{whole, Block, LANES};
use crate::boundary::BoundaryPoint;
use crate::catchment::MAX_REACH;
use crate::grid::OccupancyGrid;
use crate::ground::Ground;
use crate::likelihood_field::{LikelihoodField, DIRECTIONS};
use crate::probe::Axes;

/// Side of a coarse cell, metres, where the table stays small enough.
const CELL: f64 = 0.2;
/// Most coarse cells of a map; larger maps are correlated more coarsely.
const MAX_CELLS: f64 = 100_000.0;
/// Distance at which a wall is half as good as in place, metres beyond half a coarse cell.
const BLUR: f64 = 0.15;
/// Depth in free space from which a wall contradicts, metres beyond half a coarse cell.
const DEPTH: f64 = 0.3;
/// Score of a wall in place, where none is, and in clear free space.
pub const SCORES: (f64, i8, i8) = (8.0, -3, -16);
/// Cells without a score that a run bridges, since one longer run is faster than two short ones.
const BRIDGED: usize = 24;

/// Runs are as long as a multiple of this: so many cells are added at once.
pub const RUN: usize = 16;

/// Cells of one row that follow each other, some of which score.
#[derive(Debug, Clone, Copy)]
pub struct Run {
    /// Row of the first cell.
    pub row: u32,
    /// Column of the first cell.
    pub col: u32,
    /// Where its score is in [`Wide::values`].
    pub at: u32,
    /// Number of cells, a multiple of [`RUN`]: the last of them score nothing, and may lie beyond the row.
    pub len: u32,
}

/// The table in cells twice as wide, as runs: most cells of a direction score nothing.
#[derive(Debug, Clone)]
pub struct Wide {
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Scores of all runs.
    pub values: Vec<i16>,
    /// Runs of each direction's agreement, and last those of the contradiction.
    pub runs: [Vec<Run>; DIRECTIONS + 1],
}

/// Agreement of each direction, and last the contradiction, whatever the direction: a wall that is no agreement.
type CoarseCell = [i8; DIRECTIONS + 1];

/// See the module's text. Rows and columns are those of the grid's axes.
#[derive(Debug, Clone)]
pub struct CoarseTable {
    /// Side of a cell, metres.
    pub cell: f64,
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Row by row; beyond the last a cell that says nothing.
    cells: Vec<CoarseCell>,
    /// In cells twice as wide.
    pub wide: Wide,
}

impl CoarseTable {
    /// From a map's other tables.
    pub fn new(
        g: &OccupancyGrid,
        boundary: &[BoundaryPoint],
        field: &LikelihoodField,
        ground: &Ground,
    ) -> Self {
        let (w, h) = (g.width() as f64 * g.resolution(), g.height() as f64 * g.resolution());
        let cell = CELL.max((w * h / MAX_CELLS).sqrt()).max(g.resolution());
        let (width, height) = ((w / cell).ceil() as usize, (h / cell).ceil() as usize);
        let half = 0.5 * cell;
        let deep = ((DEPTH + half) / g.resolution()).powi(2).clamp(1.0, 250.0) as u8;
        // Walls lie in the middle of their cells: their distances are known beforehand.
        let value = |d2: usize| {
            let r = ((d2 as f64).sqrt() * g.resolution() - half).max(0.0);
            (SCORES.0 * (-(r / BLUR).powi(2)).exp2()).round() as i8
        };
        let values: Vec<i8> = (0..=MAX_REACH * MAX_REACH).map(value).collect();
        let places: Vec<(i32, i32)> = boundary
            .iter()
            .map(|b| ((b.cell as usize / g.width()) as i32, (b.cell as usize % g.width()) as i32))
            .collect();
        let fine = |k: usize| ((k as f64 + 0.5) * cell / g.resolution()) as usize;
        let mut cells = vec![[0; DIRECTIONS + 1]; width * height + 1];
        for (row, line) in cells.chunks_exact_mut(width).take(height).enumerate() {
            let fine_row = fine(row);
            if fine_row >= g.height() {
                break;
            }
            for (col, cell) in line.iter_mut().enumerate() {
                let fine_col = fine(col);
                if fine_col >= g.width() {
                    break;
                }
                let at = fine_row * g.width() + fine_col;
                let [agree @ .., contradict] = cell;
                *contradict = match ground.depth_squared(at) >= deep {
                    true => SCORES.2,
                    false if ground.is_unknown(at) => 0,
                    false => SCORES.1,
                };
                // Agreement takes the place of what the cell says of strangers.
                let otherwise = (*contradict).max(SCORES.1);
                let nearest = field.nearest(fine_row, fine_col);
                for (agree, k) in agree.iter_mut().zip(nearest) {
                    let Some((row, col)) = places.get(usize::from(k)) else { continue };
                    let (rows, cols) = (row - fine_row as i32, col - fine_col as i32);
                    *agree = (values[(rows * rows + cols * cols) as usize] - otherwise).max(0);
                }
            }
        }
        let wide = Wide::new(width, height, &cells);
        Self { cell, width, height, cells, wide }
    }

    /// Agreement and contradiction of a sample in a cell, by its index.
    #[inline(always)]
    pub fn at(&self, octant: usize, cell: usize) -> (f32, f32) {
        let cell = &self.cells[cell];
        (f32::from(cell[octant]), f32::from(cell[DIRECTIONS]))
    }
}

/// Score of some of another map's samples at a pose of its axes in this grid's.
#[multiversion::multiversion(targets("x86_64+avx2"))]
pub fn score(table: &CoarseTable, samples: &[Block], axes: &Axes) -> f32 {
    let per_metre = (1.0 / table.cell) as f32;
    let (width, height) = (table.width as f32, table.height as f32);
    let (columns, outside) = (table.width as i32, (table.cells.len() - 1) as i32);
    let mut score = [0.0; LANES];
    for s in samples {
        // Where they lie first, all at once; then what the cells there say.
        let mut cells = [0i32; LANES];
        for (k, at) in cells.iter_mut().enumerate() {
            let (x, y) = axes.apply(s.x[k], s.y[k]);
            let (u, v) = (x * per_metre, y * per_metre);
            let is_inside = (u >= 0.0) & (v >= 0.0) & (u < width) & (v < height);
            let cell = whole(v).wrapping_mul(columns).wrapping_add(whole(u));
            *at = if is_inside { cell } else { outside };
        }
        let (mut agree, mut contradict) = ([0.0; LANES], [0.0; LANES]);
        for (k, cell) in cells.into_iter().enumerate() {
            (agree[k], contradict[k]) = table.at(axes.octant(s.direction[k]), cell as usize);
        }
        for k in 0..LANES {
            score[k] += s.weight[k] * agree[k] + s.conflict_weight[k] * contradict[k];
        }
    }
    score.iter().sum()
}

impl Wide {
    /// The best that any of the four cells says.
    fn new(fine_width: usize, fine_height: usize, fine: &[CoarseCell]) -> Self {
        let (width, height) = (fine_width.div_ceil(2), fine_height.div_ceil(2));
        let best = |row: usize, col: usize| {
            let rows = [2 * row, (2 * row + 1).min(fine_height - 1)];
            let cols = [2 * col, (2 * col + 1).min(fine_width - 1)];
            let mut best = fine[rows[0] * fine_width + cols[0]];
            for (row, col) in [(0, 1), (1, 0), (1, 1)] {
                let cell = &fine[rows[row] * fine_width + cols[col]];
                best.iter_mut().zip(cell).for_each(|(best, v)| *best = (*best).max(*v));
            }
            best
        };
        let all: Vec<CoarseCell> =
            (0..height).flat_map(|row| (0..width).map(move |col| best(row, col))).collect();
        let mut values = Vec::new();
        let mut runs: [Vec<Run>; DIRECTIONS + 1] = Default::default();
        let mut line = vec![0i16; width];
        for (table, runs) in runs.iter_mut().enumerate() {
            for (row, cells) in all.chunks_exact(width).enumerate() {
                line.iter_mut().zip(cells).for_each(|(v, cell)| *v = i16::from(cell[table]));
                runs_of(&line, row, &mut values, runs);
            }
        }
        Self { width, height, values, runs }
    }
}

/// Appends the runs of a row.
fn runs_of(line: &[i16], row: usize, values: &mut Vec<i16>, runs: &mut Vec<Run>) {
    let mut col = 0;
    while let Some(start) = line[col..].iter().position(|v| *v != 0).map(|k| col + k) {
        let mut end = start + 1;
        while let Some(gap) = line[end..].iter().take(BRIDGED).position(|v| *v != 0) {
            end += gap + 1;
        }
        let at = values.len() as u32;
        values.extend(&line[start..end]);
        let len = (end - start).next_multiple_of(RUN);
        values.resize(at as usize + len, 0);
        runs.push(Run { row: row as u32, col: start as u32, at, len: len as u32 });
        col = end;
    }
}
