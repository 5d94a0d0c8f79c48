//! A coarse table in cells twice as wide, as strips that are added to the scores of many shifts at once.
//!
//! Most cells of a direction score nothing. Those that do are cut into strips of few lengths: a processor that cannot
//! foresee where a loop ends waits there longer than it takes to add a strip.

use crate::likelihood_field::DIRECTIONS;

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

/// A bin: the shift at which it meets a table's first cell, by its index, and how many times the table counts.
pub type Bin = (u32, i16);

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

    /// See [`add`]; strip by strip of one bin: those of the next bin meet the same cells, which would have to wait.
    #[inline(always)]
    fn add(&self, to: &mut [i16], width: usize, bins: &[Bin], places: &mut Vec<u32>) {
        places.clear();
        places.extend(self.first.iter().map(|(row, col)| row * width as u32 + col));
        for (bin, times) in bins {
            let to = &mut to[*bin as usize..];
            for (at, scores) in places.iter().zip(&self.scores) {
                let to = to[*at as usize..].first_chunk_mut::<N>().expect("strips are padded");
                for (sum, score) in to.iter_mut().zip(scores) {
                    *sum = sum.saturating_add(times * score);
                }
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
    /// From the tables of a coarse one of so many columns and rows.
    pub fn new(fine_width: usize, fine_height: usize, fine: [&[i8]; DIRECTIONS + 1]) -> Self {
        let (width, height) = (fine_width.div_ceil(2), fine_height.div_ceil(2));
        let mut best = vec![0; fine_width];
        let mut line = vec![0i16; width + SHORTEST];
        let tables = fine.map(|fine| {
            let mut table = ScoredCells::default();
            for (row, rows) in fine.chunks(2 * fine_width).enumerate() {
                let (first, second) = rows.split_at(fine_width);
                best.copy_from_slice(first);
                best.iter_mut().zip(second).for_each(|(best, v)| *best = (*best).max(*v));
                for (v, pair) in line.iter_mut().zip(best.chunks(2)) {
                    *v = i16::from(pair[0].max(pair[pair.len() - 1]));
                }
                table.take_in(row, &line);
            }
            table
        });
        Self { width, height, tables }
    }
}

/// Adds the scores of a table to those of the shifts at which bins meet its cells. `to` is rows of so many columns, and goes
/// on for [`SHORTEST`] cells; `places` is memory.
#[multiversion::multiversion(targets("x86_64+avx2"))]
pub fn add(table: &ScoredCells, to: &mut [i16], width: usize, bins: &[Bin], places: &mut Vec<u32>) {
    table.long.add(to, width, bins, places);
    table.middle.add(to, width, bins, places);
    table.short.add(to, width, bins, places);
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};

    /// Whatever lies in the rows, every cell of every direction is added once, where it belongs.
    #[test]
    fn strips_add_up_to_the_table() {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(7);
        let mut places = Vec::new();
        for (width, rare) in [(1, 2), (33, 9), (240, 3), (241, 40), (500, 2)] {
            let height = 3;
            let mut cell = || match rng.random_range(0..rare) {
                0 => rng.random_range(-16..9),
                _ => 0,
            };
            let fine: [Vec<i8>; DIRECTIONS + 1] =
                std::array::from_fn(|_| (0..width * height).map(|_| cell()).collect());
            let table = WideTable::new(width, height, fine.each_ref().map(Vec::as_slice));
            assert_eq!((table.width, table.height), (width.div_ceil(2), 2));
            for (k, beyond) in (0..table.tables.len()).flat_map(|k| [(k, 0), (k, 7)]) {
                // Beyond the last cell of the table there is what pads a strip and nothing else.
                let stride = table.width + beyond;
                let size = stride * (table.height - 1) + table.width + SHORTEST - 1;
                let mut sums = vec![5i16; beyond + size];
                // Bins count one by one, wherever else the table has been added before.
                let bins = [(beyond as u32, 1), (beyond as u32, 2)];
                add(&table.tables[k], &mut sums, stride, &bins, &mut places);
                assert!(sums[..beyond].iter().all(|sum| *sum == 5));
                for (at, sum) in sums[beyond..].iter().copied().enumerate() {
                    let (row, col) = (at / stride, at % stride);
                    let covered = (2 * row..(2 * row + 2).min(height)).flat_map(|r| {
                        (2 * col..(2 * col + 2).min(width)).map(move |c| r * width + c)
                    });
                    let best = covered.map(|at| fine[k][at]).max().unwrap_or(0);
                    assert_eq!(sum, 5 + 3 * i16::from(best), "{width} {k} {row} {col}");
                }
            }
        }
    }
}
