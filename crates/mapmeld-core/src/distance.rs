//! Exact distance transforms, truncated to a byte.
//!
//! Separable (Felzenszwalb and Huttenlocher, "Distance transforms of sampled functions", 2012): columns give the
//! distance along the column, rows take the lower envelope of parabolas. Since a byte ends within 16 cells, few
//! parabolas reach a cell: all of them are asked, many bytes of a row at once.

use crate::grid::{class_of, Class, OccupancyGrid};

/// Squared distance, in cells, that the byte table can hold; larger ones read [`FAR`].
pub const MAX_SQUARED: u32 = 254;
/// Table value of cells at a squared distance above [`MAX_SQUARED`] (about 16 cells).
pub const FAR: u8 = 255;

/// Distance in cells that no byte holds.
pub const REACH: u8 = 16;

/// Of a distance in cells, [`FAR`] where it does not fit.
#[inline(always)]
fn square(d: u8) -> u8 {
    d.saturating_mul(d)
}

/// Takes a row's distances from the neighbouring row's where those are less, a cell farther on.
#[inline(always)]
fn step(row: &mut [u8], neighbours: &[u8]) {
    row.iter_mut().zip(neighbours).for_each(|(d, other)| *d = (other + 1).min(*d));
}

/// Takes what others know, so much farther away, where that is less: bytes that saturate, many at a time.
#[inline(always)]
fn nearer(best: &mut [u8], others: &[u8], across: u8) {
    best.iter_mut().zip(others).for_each(|(b, v)| *b = v.saturating_add(across).min(*b));
}

/// Squared distances of cells, from zero for those of a set and [`REACH`] for all others.
#[multiversion::multiversion(targets("x86_64+avx2"))]
fn squared(mut along: Vec<u8>, width: usize) -> Vec<u8> {
    // Along the columns first, a whole row at a time: each cell is one farther than the nearer of its neighbours.
    let rows: Vec<usize> = (0..along.len()).step_by(width).collect();
    for row in rows.iter().skip(1) {
        let (before, here) = along.split_at_mut(*row);
        step(&mut here[..width], &before[row - width..]);
    }
    for row in rows.iter().rev().skip(1) {
        let (here, after) = along.split_at_mut(row + width);
        step(&mut here[*row..], &after[..width]);
    }
    along.iter_mut().for_each(|d| *d = square(*d));
    // Then the best of what lies within reach in the row, each with its own distance.
    let mut squared = along.clone();
    for (best, line) in squared.chunks_exact_mut(width).zip(along.chunks_exact(width)) {
        if line.iter().fold(FAR, |least, v| least.min(*v)) == FAR {
            continue;
        }
        for d in 1..usize::from(REACH).min(width) {
            let across = square(d as u8);
            nearer(&mut best[d..], line, across);
            nearer(best, &line[d..], across);
        }
    }
    squared
}

/// Squared distance in cells from every cell to the nearest cell of a set, exact up to
/// [`MAX_SQUARED`], one byte a cell.
#[derive(Debug, Clone)]
pub struct DistanceTable {
    squared: Vec<u8>,
}

impl DistanceTable {
    /// Distances to the cells of one class.
    pub fn to_class(grid: &OccupancyGrid, class: Class) -> Self {
        Self::to_set(grid.cells().iter().map(|v| class_of(*v) == class), grid.width())
    }

    /// Distances to the cells that are not of the class (how deep a cell lies inside it); cells
    /// outside the grid count as not of the class only where the grid has such cells.
    pub fn to_other_than(grid: &OccupancyGrid, class: Class) -> Self {
        Self::to_set(grid.cells().iter().map(|v| class_of(*v) != class), grid.width())
    }

    /// Distances to the cells, row by row and so many in a row, where `set` is true.
    pub fn to_set(set: impl Iterator<Item = bool>, width: usize) -> Self {
        Self { squared: squared(set.map(|is_in| if is_in { 0 } else { REACH }).collect(), width) }
    }

    /// Squared distance in cells at a cell index, [`FAR`] beyond the table's reach.
    #[inline(always)]
    pub fn squared(&self, index: usize) -> u8 {
        self.squared[index]
    }

    /// All values, in the grid's cell order.
    pub fn as_slice(&self) -> &[u8] {
        &self.squared
    }
}

/// `exp(-d^2 / (2 sigma^2))` for every table value; zero at [`FAR`]. `sigma` in cells.
pub fn gaussian_lut(sigma: f64) -> [f64; 256] {
    let mut lut = [0.0; 256];
    for (d2, v) in lut.iter_mut().enumerate().take(FAR as usize) {
        *v = (-(d2 as f64) / (2.0 * sigma * sigma)).exp();
    }
    lut
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};

    fn brute(set: &[bool], w: usize, h: usize) -> Vec<u8> {
        (0..w * h)
            .map(|i| {
                let best = (0..w * h)
                    .filter(|j| set[*j])
                    .map(|j| {
                        let (dx, dy) = ((i % w).abs_diff(j % w), (i / w).abs_diff(j / w));
                        dx * dx + dy * dy
                    })
                    .min();
                best.filter(|d| *d as u32 <= MAX_SQUARED).map_or(FAR, |d| d as u8)
            })
            .collect()
    }

    #[test]
    fn equals_brute_force() {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(5);
        for (w, h, p) in [
            (1, 1, 0.5),
            (40, 1, 0.05),
            (1, 40, 0.05),
            (37, 53, 0.002),
            (45, 30, 0.05),
            (8, 9, 0.9),
        ] {
            for _ in 0..10 {
                let set: Vec<bool> = (0..w * h).map(|_| rng.random_bool(p)).collect();
                let table = DistanceTable::to_set(set.iter().copied(), w);
                assert_eq!(table.as_slice(), brute(&set, w, h), "{w} x {h}, p {p}");
            }
        }
        assert!(DistanceTable::to_set([false; 12].into_iter(), 4)
            .as_slice()
            .iter()
            .all(|d| *d == FAR));
    }
}
