//! A map's samples turned into another's axes, and what they score where they are shifted.

use crate::probe::{Axes, Probe};
use crate::registration::coarse_table::CoarseTable;
use crate::se2::Se2;

/// Samples that score a peak again.
const PEAK_SAMPLES: usize = 160;

/// How many fine cells (rows, columns) the turned map is shifted.
pub type Shift = (i32, i32);

/// A turned probe: the fine cell it lies in when the map is not shifted, and what it says.
#[derive(Clone, Copy)]
pub struct InCell {
    pub row: i32,
    pub col: i32,
    pub octant: usize,
    pub weight: f32,
    pub conflict_weight: f32,
}

/// The other map's probes at one rotation.
pub struct Turned {
    theta: f64,
    /// The lowest coordinates of any probe, metres.
    low: (f64, f64),
    /// All of the probes; cells count from `low`.
    pub probes: Vec<InCell>,
    /// Those of them that score a peak again.
    some: Vec<InCell>,
    /// Rows and columns that they fill.
    pub size: (usize, usize),
}

impl Turned {
    /// At a rotation of the probes' axes into those of the table, radians.
    pub fn new(a: &CoarseTable, b: &[Probe], theta: f64) -> Self {
        let axes = Axes::new(&Se2::new(0.0, 0.0, theta));
        let turned: Vec<(f32, f32)> = b.iter().map(|p| axes.apply(p.x, p.y)).collect();
        let low = turned.iter().fold((f32::MAX, f32::MAX), |l, p| (l.0.min(p.0), l.1.min(p.1)));
        let per_metre = (1.0 / a.cell) as f32;
        let in_cell = |(p, (x, y)): (&Probe, &(f32, f32))| InCell {
            row: ((y - low.1) * per_metre) as i32,
            col: ((x - low.0) * per_metre) as i32,
            octant: axes.octant(p.direction),
            weight: p.weight,
            conflict_weight: p.conflict_weight,
        };
        let probes: Vec<InCell> = b.iter().zip(&turned).map(in_cell).collect();
        let size = probes.iter().fold((0, 0), |s, p| (s.0.max(p.row), s.1.max(p.col)));
        let size = (size.0 as usize + 1, size.1 as usize + 1);
        let (all, asked) = (probes.len(), probes.len().min(PEAK_SAMPLES));
        let some = (0..asked).map(|k| probes[k * all / asked]).collect();
        Self { theta, low: (f64::from(low.0), f64::from(low.1)), probes, some, size }
    }

    /// The best score of a shift and of those one fine cell from it.
    pub fn look_into(&self, a: &CoarseTable, (rows, cols): Shift) -> (f32, Shift) {
        let scores = scores_around(&self.some, a, (rows, cols));
        // The first of equals, the shift itself before all others.
        let best = [4, 0, 1, 2, 3, 5, 6, 7, 8].map(|k| (k / 3, k % 3)).into_iter();
        let better = |x: (usize, usize), y: (usize, usize)| {
            if scores[y.0][y.1] > scores[x.0][x.1] {
                y
            } else {
                x
            }
        };
        let best = best.reduce(better).expect("nine of them");
        let shift = (rows + best.0 as i32 - 1, cols + best.1 as i32 - 1);
        let (all, asked) = (self.probes.len() as f32, self.some.len() as f32);
        (scores[best.0][best.1] * all / asked, shift)
    }

    /// `T_axes_axes` of a shift.
    pub fn pose(&self, (rows, cols): Shift, cell: f64) -> Se2 {
        let (x, y) = (f64::from(cols) * cell - self.low.0, f64::from(rows) * cell - self.low.1);
        Se2::new(x, y, self.theta)
    }
}

/// What probes score at a shift and at those one fine cell from it, by rows; the last column is of no use.
#[multiversion::multiversion(targets("x86_64+avx2"))]
fn scores_around(probes: &[InCell], a: &CoarseTable, (rows, cols): Shift) -> [[f32; 4]; 3] {
    let mut scores = [[0.0f32; 4]; 3];
    let (w, h) = (a.width as i32, a.height as i32);
    for p in probes {
        let (agree, contradict) = (a.agreement(p.octant), a.contradiction());
        let score = |agree: i8, contradict: i8| {
            p.weight * f32::from(agree) + p.conflict_weight * f32::from(contradict)
        };
        let (row, col) = (p.row + rows, p.col + cols);
        if (1..h - 1).contains(&row) && (1..w - 1).contains(&col) {
            for (k, scores) in (row - 1..).zip(&mut scores) {
                let first = (k * w + col - 1) as usize;
                let [agree, contradict]: [&[i8; 4]; 2] =
                    [agree, contradict].map(|t| t[first..].first_chunk().expect("one more"));
                for c in 0..4 {
                    scores[c] += score(agree[c], contradict[c]);
                }
            }
            continue;
        }
        for (r, scores) in (row - 1..).zip(&mut scores) {
            for (c, sum) in (col - 1..=col + 1).zip(scores) {
                if (0..h).contains(&r) && (0..w).contains(&c) {
                    let at = (r * w + c) as usize;
                    *sum += score(agree[at], contradict[at]);
                }
            }
        }
    }
    scores
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use crate::grid::OccupancyGrid;
    use crate::local_map::LocalMap;

    /// Inside the table, at its rim and beyond, scores are what the table says of each probe.
    #[test]
    fn looks_into_the_nine_cells_about_a_shift() {
        let cells = (0..40 * 30).map(|k| match (k % 40, k / 40) {
            (x, y) if x == 12 || y == 9 && x > 12 || (7 * x + 3 * y) % 53 == 0 => 100,
            _ => 0,
        });
        let grid = OccupancyGrid::new("g", 40, 30, 0.1, Se2::IDENTITY, cells.collect()).unwrap();
        let map = LocalMap::new(grid, &Config::default());
        let (a, turned) = (&map.coarse, Turned::new(&map.coarse, &map.probes, 0.4));
        let (w, h) = (a.width as i32, a.height as i32);
        let score = |rows: i32, cols: i32| {
            let of_probe = |p: &InCell| {
                let (row, col) = (p.row + rows, p.col + cols);
                let is_inside = (0..h).contains(&row) && (0..w).contains(&col);
                let at = if is_inside { row * w + col } else { w * h } as usize;
                p.weight * f32::from(a.agreement(p.octant)[at])
                    + p.conflict_weight * f32::from(a.contradiction()[at])
            };
            let sum = turned.some.iter().map(of_probe).sum::<f32>();
            sum * turned.probes.len() as f32 / turned.some.len() as f32
        };
        for rows in -h..h {
            for cols in -w..w {
                let around = (0..9).map(|k| score(rows + k / 3 - 1, cols + k % 3 - 1));
                let most = around.fold(f32::MIN, f32::max);
                let (got, (row, col)) = turned.look_into(a, (rows, cols));
                assert!((got - most).abs() < 1e-2, "{rows} {cols}: {got} {most}");
                assert!((row - rows).abs() <= 1 && (col - cols).abs() <= 1);
                assert!((score(row, col) - got).abs() < 1e-2, "{rows} {cols}");
            }
        }
    }
}
