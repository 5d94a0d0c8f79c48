//! Exact distance transforms in linear time, truncated to a byte.
//!
//! Felzenszwalb and Huttenlocher, "Distance transforms of sampled functions" (2012), on integers:
//! rows give the distance along the row, columns take the lower envelope of parabolas.

use crate::grid::{class_of, Class, OccupancyGrid};

/// Squared distance, in cells, that the byte table can hold; larger ones read [`FAR`].
pub const MAX_SQUARED: u32 = 254;
/// Table value of cells at a squared distance above [`MAX_SQUARED`] (about 16 cells).
pub const FAR: u8 = 255;

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
        const NONE: i64 = i64::MAX;
        let cap = 16i32;
        // Distance along the row, truncated at `cap` (16^2 > MAX_SQUARED).
        let mut along = vec![cap; width * height];
        for (row, line) in along.chunks_exact_mut(width).enumerate() {
            let hits = &set[row * width..(row + 1) * width];
            let mut d = cap;
            for col in 0..width {
                d = if hits[col] { 0 } else { (d + 1).min(cap) };
                line[col] = d;
            }
            d = cap;
            for col in (0..width).rev() {
                d = if hits[col] { 0 } else { (d + 1).min(cap) };
                line[col] = line[col].min(d);
            }
        }
        // Columns: the lower envelope of the parabolas (y - y0)^2 + along^2.
        let mut squared = vec![FAR; width * height];
        let mut sites: Vec<(i64, i64)> = Vec::with_capacity(height);
        let mut starts: Vec<i64> = Vec::with_capacity(height);
        for col in 0..width {
            sites.clear();
            starts.clear();
            for y in 0..height as i64 {
                let d = along[y as usize * width + col];
                if d >= cap {
                    continue;
                }
                let f = i64::from(d * d);
                let mut from = i64::MIN;
                while let Some(&(y0, f0)) = sites.last() {
                    // The first integer row at which the new parabola is lower than the last.
                    let num = (f + y * y) - (f0 + y0 * y0);
                    let cross = num.div_euclid(2 * (y - y0)) + 1;
                    if cross > *starts.last().unwrap_or(&NONE) {
                        from = cross;
                        break;
                    }
                    sites.pop();
                    starts.pop();
                }
                sites.push((y, f));
                starts.push(from);
            }
            let mut k = 0;
            for y in 0..height as i64 {
                while k + 1 < sites.len() && starts[k + 1] <= y {
                    k += 1;
                }
                if let Some(&(y0, f0)) = sites.get(k) {
                    let d = (y - y0) * (y - y0) + f0;
                    if d <= i64::from(MAX_SQUARED) {
                        squared[y as usize * width + col] = d as u8;
                    }
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
