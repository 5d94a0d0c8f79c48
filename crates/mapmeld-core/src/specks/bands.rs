//! Maps in bands of rows, few enough to stay in the near caches, and what surrounds each of their cells.

use crate::grid::OccupancyGrid;
use std::ops::Range;

/// Rows of a band.
const ROWS: usize = 32;
/// Rows of a map from which every second band tells of all, and from which every third does.
const TALL: [usize; 2] = [200, 300];

/// Some rows of a map, and as many more on either side as have a say in them.
pub struct Band {
    /// The cells of all these rows.
    pub seen: Range<usize>,
    /// The cells of the band's own rows.
    pub own: Range<usize>,
}

impl Band {
    /// The band's own rows, of those that are seen.
    pub fn within(&self) -> Range<usize> {
        self.own.start - self.seen.start..self.own.end - self.seen.start
    }
}

/// All rows of a map in bands, so many more rows on either side having a say.
pub fn all(grid: &OccupancyGrid, margin: usize) -> impl Iterator<Item = Band> {
    let (width, height) = (grid.width(), grid.height());
    (0..height).step_by(ROWS).map(move |first| {
        let last = (first + ROWS).min(height);
        let seen = first.saturating_sub(margin) * width..(last + margin).min(height) * width;
        Band { seen, own: first * width..last * width }
    })
}

/// Those of them that are asked about all, spread evenly.
pub fn some(grid: &OccupancyGrid, margin: usize) -> impl Iterator<Item = Band> {
    let tall = TALL.iter().filter(|rows| grid.height() >= **rows);
    all(grid, margin).step_by(1 + tall.count())
}

/// Puts values into a vector, in the place of what it holds.
#[inline(always)]
pub fn put(into: &mut Vec<u8>, values: impl ExactSizeIterator<Item = u8>) {
    into.resize(values.len(), 0);
    into.iter_mut().zip(values).for_each(|(i, v)| *i = v);
}

/// The sum of values, as many as a band has at most.
#[inline(always)]
pub fn sum(values: impl Iterator<Item = u8>) -> f64 {
    f64::from(values.map(u32::from).sum::<u32>())
}

/// Gives each cell the sum, or whatever else `of` two values makes, over a square window about it, so many cells in each
/// direction. Outside the rows all are zero.
#[inline(always)]
pub fn take_of_window<const RADIUS: usize>(
    values: &mut [u8],
    width: usize,
    of: impl Fn(u8, u8) -> u8 + Copy,
) {
    let rows = values.len() / width;
    // Of the rows that the window spans, the latest last, each cell's own value with those beside it.
    let mut spanned = vec![vec![0; width]; 2 * RADIUS + 1];
    for k in 0..rows + RADIUS {
        spanned.rotate_left(1);
        let latest = &mut spanned[2 * RADIUS];
        match values.get(k * width..(k + 1) * width) {
            Some(row) => take_beside::<RADIUS>(latest, row, of),
            None => latest.fill(0),
        }
        let Some(k) = k.checked_sub(RADIUS) else { continue };
        let out = &mut values[k * width..(k + 1) * width];
        out.copy_from_slice(&spanned[0]);
        for row in &spanned[1..] {
            out.iter_mut().zip(row).for_each(|(o, v)| *o = of(*o, *v));
        }
    }
}

/// Puts a row's values into another, each with those beside it.
#[inline(always)]
fn take_beside<const RADIUS: usize>(out: &mut [u8], row: &[u8], of: impl Fn(u8, u8) -> u8) {
    out.copy_from_slice(row);
    let width = row.len();
    for d in 1..=RADIUS {
        let (left, right) = (d.min(width), width.saturating_sub(d));
        out[left..].iter_mut().zip(row).for_each(|(o, v)| *o = of(*o, *v));
        out.iter_mut().zip(&row[left..]).for_each(|(o, v)| *o = of(*o, *v));
        out[..left].iter_mut().for_each(|o| *o = of(*o, 0));
        out[right..].iter_mut().for_each(|o| *o = of(*o, 0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_are_summed() {
        for (width, height) in [(1, 1), (2, 5), (7, 3), (9, 9)] {
            let values: Vec<u8> = (0..width * height).map(|k| (k * k % 5) as u8).collect();
            let slowly = |row: usize, col: usize| -> u8 {
                let near = |at: usize, size: usize| at.saturating_sub(2)..(at + 3).min(size);
                let rows = near(row, height);
                rows.flat_map(|r| near(col, width).map(move |c| r * width + c))
                    .map(|k| values[k])
                    .sum()
            };
            let mut sums = values.clone();
            take_of_window::<2>(&mut sums, width, |a, b| a + b);
            let expected: Vec<u8> =
                (0..width * height).map(|k| slowly(k / width, k % width)).collect();
            assert_eq!(sums, expected);
        }
    }
}
