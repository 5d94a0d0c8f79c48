//! A coarse table in cells twice as wide, as strips that are added to the scores of many shifts at once.
//!
//! Most cells of a direction score nothing. Those that do are cut into strips of few lengths: a processor that cannot
//! foresee where a loop ends waits there longer than it takes to add a strip.

use crate::likelihood_field::DIRECTIONS;
use crate::registration::coarse_table::CoarseCell;

/// Cells of the shortest strips: so many are added at once.
pub const SHORTEST: usize = 16;
/// So many cells without a score end a strip.
const BRIDGED: usize = 24;
const _: () = assert!(BRIDGED >= SHORTEST, "what pads a strip is no part of the next");

/// The best that any of the four coarse cells says that a cell covers.
#[derive(Debug, Clone)]
pub struct WideTable {
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Each direction's agreement, and last the contradiction.
    pub tables: [ScoredCells; DIRECTIONS + 1],
}

/// The cells of a table that score.
#[derive(Debug, Clone, Default)]
pub struct ScoredCells {
    long: Strips<{ 4 * SHORTEST }>,
    middle: Strips<{ 2 * SHORTEST }>,
    short: Strips<SHORTEST>,
}

/// Cells that follow each other in a row, the last of which may score nothing and lie beyond it.
#[derive(Debug, Clone)]
struct Strips<const N: usize> {
    /// Row and column of the first cell of each.
    first: Vec<(u32, u32)>,
    scores: Vec<[i16; N]>,
}

impl<const N: usize> Default for Strips<N> {
    fn default() -> Self {
        Self { first: Vec::new(), scores: Vec::new() }
    }
}

impl<const N: usize> Strips<N> {
    /// Takes a strip off some cells of a row, from a column on, if they are enough.
    fn take_off<'c>(
        &mut self,
        cells: &'c [i16],
        (row, col): (usize, &mut usize),
    ) -> Option<&'c [i16]> {
        let (scores, rest) = cells.split_first_chunk()?;
        self.first.push((row as u32, *col as u32));
        self.scores.push(*scores);
        *col += N;
        Some(rest)
    }

    #[inline(always)]
    fn add(&self, to: &mut [i16], width: usize, weight: i16) {
        for ((row, col), scores) in self.first.iter().zip(&self.scores) {
            let at = *row as usize * width + *col as usize;
            let to: &mut [i16; N] = to[at..].first_chunk_mut().expect("strips are padded");
            for (sum, score) in to.iter_mut().zip(scores) {
                *sum = sum.saturating_add(weight * score);
            }
        }
    }
}

impl ScoredCells {
    /// Takes in what scores in a row, which goes on with zeros for [`SHORTEST`] cells.
    fn take_in(&mut self, row: usize, line: &[i16]) {
        let mut col = 0;
        while let Some(start) = line[col..].iter().position(|v| *v != 0).map(|k| col + k) {
            let mut end = start + 1;
            while let Some(gap) = line[end..].iter().take(BRIDGED).position(|v| *v != 0) {
                end += gap + 1;
            }
            // What follows scores nothing for so long, or is the row's end.
            let padded = (end - start).next_multiple_of(SHORTEST);
            let (mut rest, mut at) = (&line[start..start + padded], start);
            while let Some(shorter) = self.long.take_off(rest, (row, &mut at)) {
                rest = shorter;
            }
            rest = self.middle.take_off(rest, (row, &mut at)).unwrap_or(rest);
            self.short.take_off(rest, (row, &mut at));
            col = end;
        }
    }
}

impl WideTable {
    /// From a coarse table of so many columns and rows.
    pub fn new(fine_width: usize, fine_height: usize, fine: &[CoarseCell]) -> Self {
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
        let mut tables: [ScoredCells; DIRECTIONS + 1] = Default::default();
        let mut cells: Vec<CoarseCell> = Vec::with_capacity(width);
        let mut line = vec![0i16; width + SHORTEST];
        for row in 0..height {
            cells.clear();
            cells.extend((0..width).map(|col| best(row, col)));
            for (k, table) in tables.iter_mut().enumerate() {
                line.iter_mut().zip(&cells).for_each(|(v, cell)| *v = i16::from(cell[k]));
                table.take_in(row, &line);
            }
        }
        Self { width, height, tables }
    }
}

/// Adds the scores of a table, each so many times, to those of the shifts at which a bin meets its cells. `to` is rows of
/// so many columns from where the bin meets the table's first cell, and goes on for [`SHORTEST`] cells.
#[multiversion::multiversion(targets("x86_64+avx2"))]
pub fn add(table: &ScoredCells, to: &mut [i16], width: usize, weight: i16) {
    table.long.add(to, width, weight);
    table.middle.add(to, width, weight);
    table.short.add(to, width, weight);
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};

    /// Whatever lies in the rows, every cell of every direction is added once, where it belongs.
    #[test]
    fn strips_add_up_to_the_table() {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(7);
        for (width, rare) in [(1, 2), (33, 9), (240, 3), (241, 40), (500, 2)] {
            let height = 3;
            let mut cell = || {
                std::array::from_fn(|_| {
                    if rng.random_range(0..rare) == 0 {
                        rng.random_range(-16..9)
                    } else {
                        0
                    }
                })
            };
            let fine: Vec<CoarseCell> = (0..width * height).map(|_| cell()).collect();
            let table = WideTable::new(width, height, &fine);
            assert_eq!((table.width, table.height), (width.div_ceil(2), 2));
            for (k, beyond) in (0..table.tables.len()).flat_map(|k| [(k, 0), (k, 7)]) {
                // Beyond the last cell of the table there is what pads a strip and nothing else.
                let stride = table.width + beyond;
                let size = stride * (table.height - 1) + table.width + SHORTEST - 1;
                let mut sums = vec![5i16; beyond + size];
                add(&table.tables[k], &mut sums[beyond..], stride, 3);
                assert!(sums[..beyond].iter().all(|sum| *sum == 5));
                for (at, sum) in sums[beyond..].iter().copied().enumerate() {
                    let (row, col) = (at / stride, at % stride);
                    let covered = (2 * row..(2 * row + 2).min(height)).flat_map(|r| {
                        (2 * col..(2 * col + 2).min(width)).map(move |c| r * width + c)
                    });
                    let best = covered.map(|at| fine[at][k]).max().unwrap_or(0);
                    assert_eq!(sum, 5 + 3 * i16::from(best), "{width} {k} {row} {col}");
                }
            }
        }
    }
}
