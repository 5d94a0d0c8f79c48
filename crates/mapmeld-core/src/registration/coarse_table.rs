//! What a wall sample of another map scores in each coarse cell of a map, by its direction: like-oriented walls
//! nearby for it, clear free space against it.

use crate::blocks::{whole, Block, LANES};
use crate::boundary::BoundaryPoint;
use crate::catchment::MAX_REACH;
use crate::grid::OccupancyGrid;
use crate::ground::Ground;
use crate::likelihood_field::{LikelihoodField, DIRECTIONS};
use crate::probe::Axes;
use crate::registration::wide_table::WideTable;

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

/// See the module's text. Rows and columns are those of the grid's axes.
#[derive(Debug, Clone)]
pub struct CoarseTable {
    /// Side of a cell, metres.
    pub cell: f64,
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Agreement of each direction, and last the contradiction, whatever the direction: a wall that is no agreement.
    /// Each row by row; beyond the last a cell that says nothing.
    scores: Vec<i8>,
    /// In cells twice as wide.
    pub wide: WideTable,
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
        let size = width * height + 1;
        let mut scores = vec![0; (DIRECTIONS + 1) * size];
        let (agreements, contradictions) = scores.split_at_mut(DIRECTIONS * size);
        for row in 0..height {
            let fine_row = fine(row);
            if fine_row >= g.height() {
                break;
            }
            for col in 0..width {
                let fine_col = fine(col);
                if fine_col >= g.width() {
                    break;
                }
                let at = fine_row * g.width() + fine_col;
                let contradict = match ground.depth_squared(at) >= deep {
                    true => SCORES.2,
                    false if ground.is_unknown(at) => 0,
                    false => SCORES.1,
                };
                // Agreement takes the place of what the cell says of strangers.
                let otherwise = contradict.max(SCORES.1);
                let cell = row * width + col;
                contradictions[cell] = contradict;
                for (k, nearest) in field.nearest(fine_row, fine_col).into_iter().enumerate() {
                    let Some((row, col)) = places.get(usize::from(nearest)) else { continue };
                    let (rows, cols) = (row - fine_row as i32, col - fine_col as i32);
                    let value = values[(rows * rows + cols * cols) as usize];
                    agreements[k * size + cell] = (value - otherwise).max(0);
                }
            }
        }
        let of_each = std::array::from_fn(|k| &scores[k * size..(k + 1) * size - 1]);
        let wide = WideTable::new(width, height, of_each);
        Self { cell, width, height, scores, wide }
    }

    /// What samples of a direction agree with: of each cell, and last of what lies outside.
    #[inline(always)]
    pub fn agreement(&self, octant: usize) -> &[i8] {
        let size = self.width * self.height + 1;
        &self.scores[octant * size..][..size]
    }

    /// What they contradict, likewise.
    #[inline(always)]
    pub fn contradiction(&self) -> &[i8] {
        self.agreement(DIRECTIONS)
    }
}

/// Score of some of another map's samples at a pose of its axes in this grid's.
#[multiversion::multiversion(targets("x86_64+avx2"))]
pub fn score(table: &CoarseTable, samples: &[Block], axes: &Axes) -> f32 {
    let per_metre = (1.0 / table.cell) as f32;
    let (width, height) = (table.width as f32, table.height as f32);
    let outside = (table.width * table.height) as i32;
    let size = outside + 1;
    let (columns, contradiction) = (table.width as i32, table.contradiction());
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
            let octant = axes.octant(s.direction[k]) as i32;
            agree[k] = f32::from(table.scores[(octant * size + cell) as usize]);
            contradict[k] = f32::from(contradiction[cell as usize]);
        }
        for k in 0..LANES {
            score[k] += s.weight[k] * agree[k] + s.conflict_weight[k] * contradict[k];
        }
    }
    score.iter().sum()
}
