//! Maps in bands of rows, so few that most stay in the near caches, and what surrounds each of their cells.

use crate::grid::OccupancyGrid;
use std::ops::Range;

/// Cells of a band, about, and its rows at most: of a few hundred rows several bands are asked.
const CELLS: usize = 6144;
const ROWS: usize = 32;
/// Rows of a map from which every second band tells of all, and from which every third does.
const TALL: [usize; 2] = [200, 300];
/// Zeros that follow each row, at least: the widest window does not reach from one row into the next.
const GAP: usize = 4;
/// What the length of a row with its zeros is a multiple of, so that whole vectors of bytes make it up.
const ALIGNED: usize = 32;

/// Some rows of a map, and as many more on either side as have a say in them. What is told of their cells is a byte a
/// cell, row by row, and zeros after each row.
pub struct Band {
    /// The rows, and the rows with those on either side.
    own: Range<usize>,
    seen: Range<usize>,
    width: usize,
    stride: usize,
}

/// All rows of a map in bands, so many more rows on either side having a say.
pub fn all(grid: &OccupancyGrid, margin: usize) -> impl Iterator<Item = Band> {
    let (width, height) = (grid.width(), grid.height());
    let stride = (width + GAP).next_multiple_of(ALIGNED);
    let rows = (CELLS / stride).clamp(2 * margin, ROWS);
    (0..height).step_by(rows).map(move |first| {
        let own = first..(first + rows).min(height);
        let seen = first.saturating_sub(margin)..(own.end + margin).min(height);
        Band { own, seen, width, stride }
    })
}

/// Those of them that are asked about all, spread evenly.
pub fn some(grid: &OccupancyGrid, margin: usize) -> impl Iterator<Item = Band> {
    let tall = TALL.iter().filter(|rows| grid.height() >= **rows);
    all(grid, margin).step_by(1 + tall.count())
}

impl Band {
    /// Tells something of each cell of a map.
    #[inline(always)]
    pub fn tell(&self, layer: &mut Vec<u8>, cells: &[i8], of: impl Fn(i8) -> u8) {
        layer.clear();
        layer.resize(self.seen.len() * self.stride, 0);
        let rows = cells[self.seen.start * self.width..].chunks_exact(self.width);
        for (out, row) in layer.chunks_exact_mut(self.stride).zip(rows) {
            out.iter_mut().zip(row).for_each(|(o, v)| *o = of(*v));
        }
    }

    /// What is told of the cells of the band's own rows.
    pub fn own<'l>(&self, layer: &'l [u8]) -> &'l [u8] {
        let first = self.own.start - self.seen.start;
        &layer[first * self.stride..(first + self.own.len()) * self.stride]
    }

    /// Makes those cells of a map free that a layer holds a one for, in the band's own rows.
    pub fn free(&self, cells: &mut [i8], layer: &[u8]) {
        let rows = cells[self.own.start * self.width..].chunks_exact_mut(self.width);
        for (row, ones) in rows.zip(self.own(layer).chunks_exact(self.stride)) {
            row.iter_mut().zip(ones).filter(|(_, one)| **one == 1).for_each(|(v, _)| *v = 0);
        }
    }

    /// Gives each cell the sum, or whatever else `of` two values makes, over a square window about it, so many cells in
    /// each direction. Outside the rows all are zero.
    #[inline(always)]
    pub fn take_of_window<const RADIUS: usize>(
        &self,
        values: &mut [u8],
        scratch: &mut Vec<u8>,
        of: impl Fn(u8, u8) -> u8 + Copy,
    ) {
        for step in [1, self.stride] {
            scratch.clear();
            scratch.extend_from_slice(values);
            let all = values.len();
            for d in (1..=RADIUS).map(|k| (k * step).min(all)) {
                values[d..].iter_mut().zip(&*scratch).for_each(|(o, v)| *o = of(*o, *v));
                values.iter_mut().zip(&scratch[d..]).for_each(|(o, v)| *o = of(*o, *v));
                values[..d].iter_mut().for_each(|o| *o = of(*o, 0));
                values[all - d..].iter_mut().for_each(|o| *o = of(*o, 0));
            }
            // What lies behind a row stays zero.
            values.chunks_exact_mut(self.stride).for_each(|row| row[self.width..].fill(0));
        }
    }
}

/// Puts values into a layer, in the place of what it holds.
#[inline(always)]
pub fn put(layer: &mut Vec<u8>, values: impl ExactSizeIterator<Item = u8>) {
    layer.resize(values.len(), 0);
    layer.iter_mut().zip(values).for_each(|(i, v)| *i = v);
}

/// The sum of values, as many as a band has at most.
#[inline(always)]
pub fn sum(values: impl Iterator<Item = u8>) -> f64 {
    f64::from(values.map(u32::from).sum::<u32>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::se2::Se2;

    #[test]
    fn windows_are_summed_in_every_band() {
        for (width, height) in [(1, 1), (2, 5), (7, 3), (9, 9), (300, 120), (64, 700)] {
            let value = |k: usize| (k * k % 5) as i8;
            let cells: Vec<i8> = (0..width * height).map(value).collect();
            let slowly = |row: usize, col: usize| -> u8 {
                let near = |at: usize, size: usize| at.saturating_sub(2)..(at + 3).min(size);
                let rows = near(row, height);
                rows.flat_map(|r| near(col, width).map(move |c| value(r * width + c) as u8)).sum()
            };
            let grid = OccupancyGrid::new("g", width, height, 0.1, Se2::IDENTITY, cells).unwrap();
            let (mut sums, mut scratch, mut rows) = (Vec::new(), Vec::new(), 0);
            for band in all(&grid, 2) {
                band.tell(&mut sums, grid.cells(), |v| v as u8);
                band.take_of_window::<2>(&mut sums, &mut scratch, |a, b| a + b);
                for row in band.own(&sums).chunks_exact(band.stride) {
                    assert!((0..width).all(|col| row[col] == slowly(rows, col)), "{rows}");
                    rows += 1;
                }
            }
            assert_eq!(rows, height);
        }
    }
}
