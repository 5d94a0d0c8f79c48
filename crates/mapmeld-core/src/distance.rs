//! Exact distance transforms, truncated to a byte.
//!
//! Separable (Felzenszwalb and Huttenlocher, "Distance transforms of sampled functions", 2012): rows give the
//! distance along the row, columns take the lower envelope of parabolas. Since a byte ends within 16 cells, few
//! parabolas reach a cell: all of them are asked, a whole row of bytes at once.

use crate::grid::{class_of, Class, OccupancyGrid};

/// Squared distance, in cells, that the byte table can hold; larger ones read [`FAR`].
pub const MAX_SQUARED: u32 = 254;
/// Table value of cells at a squared distance above [`MAX_SQUARED`] (about 16 cells).
pub const FAR: u8 = 255;

/// Distance in cells that no byte holds.
const REACH: u8 = 16;

/// Of a distance in cells, [`FAR`] where it does not fit.
fn square(d: u8) -> u8 {
    d.saturating_mul(d)
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
        let hit: Vec<bool> = grid.cells().iter().map(|v| class_of(*v) == class).collect();
        Self::to_set(&hit, grid.width(), grid.height())
    }

    /// Distances to the cells that are not of the class (how deep a cell lies inside it); cells
    /// outside the grid count as not of the class only where the grid has such cells.
    pub fn to_other_than(grid: &OccupancyGrid, class: Class) -> Self {
        let hit: Vec<bool> = grid.cells().iter().map(|v| class_of(*v) != class).collect();
        Self::to_set(&hit, grid.width(), grid.height())
    }

    /// Distances to the cells where `set` is true; `set.len() == width * height`.
    pub fn to_set(set: &[bool], width: usize, height: usize) -> Self {
        // Squared distance along the row, which ends where the byte does.
        let mut along = vec![FAR; width * height];
        for (line, hits) in along.chunks_exact_mut(width).zip(set.chunks_exact(width)) {
            let mut d = REACH;
            for (value, hit) in line.iter_mut().zip(hits) {
                d = if *hit { 0 } else { (d + 1).min(REACH) };
                *value = square(d);
            }
            d = REACH;
            for (value, hit) in line.iter_mut().zip(hits).rev() {
                d = if *hit { 0 } else { (d + 1).min(REACH) };
                *value = square(d).min(*value);
            }
        }
        // The best of the rows within reach, each with its own distance: bytes that saturate, sixteen at a time.
        let mut squared = vec![FAR; width * height];
        for (row, line) in along.chunks_exact(width).enumerate() {
            if line.iter().all(|v| *v == FAR) {
                continue;
            }
            let reach = usize::from(REACH) - 1;
            for to in row.saturating_sub(reach)..(row + reach + 1).min(height) {
                let across = square(row.abs_diff(to) as u8);
                let nearest = &mut squared[to * width..(to + 1) * width];
                for (best, v) in nearest.iter_mut().zip(line) {
                    *best = v.saturating_add(across).min(*best);
                }
            }
        }
        Self { squared }
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
                let table = DistanceTable::to_set(&set, w, h);
                assert_eq!(table.as_slice(), brute(&set, w, h), "{w} x {h}, p {p}");
            }
        }
        assert!(DistanceTable::to_set(&[false; 12], 4, 3).as_slice().iter().all(|d| *d == FAR));
    }
}
