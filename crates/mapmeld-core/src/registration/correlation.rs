//! Exhaustive correlation: modes where no clean corner is in common.
//!
//! The circular correlation of the two maps' histograms of wall normals leaves few rotations (a full
//! turn, since normals point into free space). At each of them every shift is scored: walls of b on
//! like-oriented walls of a, less walls of b in clear free space of a. That is what keeps small overlaps
//! in sight: few walls agree there, yet none contradicts. The score is a sum of shifted tables, one for
//! each wall sample of b, which the compiler turns into vector adds.

use crate::boundary::BoundaryPoint;
use crate::distance::DistanceTable;
use crate::grid::{class_of, Class, OccupancyGrid};
use crate::likelihood_field::{direction, LikelihoodField, DIRECTIONS};
use crate::local_map::{LocalMap, WallSample};
use crate::registration::{Candidate, Source};
use crate::se2::{Se2, Vec2};
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Bins of a full turn: one degree each.
const BINS: usize = 360;
/// Rotations that are tried.
const ROTATIONS: usize = 12;
/// Peaks that are kept at each rotation.
const PEAKS: usize = 40;
/// Side of a coarse cell, metres, where the table stays small enough.
const CELL: f64 = 0.2;
/// Most coarse cells of a map; larger maps are correlated more coarsely.
const MAX_CELLS: f64 = 40_000.0;
/// Most shifts that are scored at one rotation.
const MAX_SHIFTS: f64 = 3e7;
/// Distance at which a wall is half as good as in place, metres beyond half a coarse cell.
const BLUR: f64 = 0.15;
/// Depth in free space from which a wall contradicts, metres beyond half a coarse cell.
const DEPTH: f64 = 0.3;
/// Score of a wall in place, where none is, and in clear free space.
const SCORES: (f64, i8, i8) = (8.0, -3, -16);
/// Most steps of a sample's weight: independent observations times this.
const STEPS: f64 = 40.0;

/// Candidates for `T_a_b`, each with its score, the best of each rotation first.
pub fn candidates(a: &LocalMap, b: &LocalMap) -> Vec<(i32, Candidate)> {
    if a.samples.is_empty() || b.samples.is_empty() {
        return Vec::new();
    }
    let mut shifts = Shifts { scores: Vec::new() };
    rotations(&histogram(&a.samples), &histogram(&b.samples))
        .into_iter()
        .flat_map(|theta| shifts.peaks(&a.coarse, &b.samples, theta))
        .map(|(score, t_a_b)| (score, Candidate { t_a_b, source: Source::Correlation }))
        .collect()
}

/// Weight of the wall normals by direction, smoothed over about three degrees.
fn histogram(samples: &[WallSample]) -> [f64; BINS] {
    let mut raw = [0.0; BINS];
    for s in samples {
        let angle = s.normal.y.atan2(s.normal.x).rem_euclid(TAU);
        raw[(angle / TAU * BINS as f64) as usize % BINS] += s.weight;
    }
    let kernel = [0.05, 0.25, 0.6, 1.0, 0.6, 0.25, 0.05];
    std::array::from_fn(|k| {
        kernel.iter().enumerate().map(|(i, w)| w * raw[(k + BINS + i - 3) % BINS]).sum()
    })
}

/// The most promising rotations of b into a, at least six degrees apart.
fn rotations(a: &[f64; BINS], b: &[f64; BINS]) -> Vec<f64> {
    // Square roots: long walls of one direction must not hide the rest.
    let (a, b) = (a.map(f64::sqrt), b.map(f64::sqrt));
    let score: Vec<f64> =
        (0..BINS).map(|k| (0..BINS).map(|i| b[i] * a[(i + k) % BINS]).sum()).collect();
    let mut order: Vec<usize> = (0..BINS).collect();
    order.sort_by(|x, y| score[*y].total_cmp(&score[*x]).then(x.cmp(y)));
    let mut kept: Vec<usize> = Vec::new();
    for k in order {
        let apart = |j: &usize| (k + BINS - j) % BINS >= 6 && (j + BINS - k) % BINS >= 6;
        if kept.iter().all(apart) {
            kept.push(k);
            if kept.len() == ROTATIONS {
                break;
            }
        }
    }
    kept.into_iter()
        .map(|k| {
            // The peak between the bins, by a parabola.
            let (l, m, r) = (score[(k + BINS - 1) % BINS], score[k], score[(k + 1) % BINS]);
            let bend = l - 2.0 * m + r;
            let shift = if bend < -1e-12 { (0.5 * (l - r) / bend).clamp(-0.5, 0.5) } else { 0.0 };
            (k as f64 + shift) * TAU / BINS as f64
        })
        .collect()
}

/// What a wall sample of another map scores in each coarse cell of this one, by its direction.
#[derive(Debug, Clone)]
pub struct CoarseTable {
    /// Grid axes, in coarse cells.
    t_map_coarse: Se2,
    cell: f64,
    width: usize,
    height: usize,
    /// Agreement, one table for each direction.
    agree: Vec<i8>,
    /// Contradiction, whatever the direction: a wall that is no agreement.
    contradict: Vec<i8>,
}

impl CoarseTable {
    /// From a map's other tables.
    pub fn new(
        g: &OccupancyGrid,
        boundary: &[BoundaryPoint],
        field: &LikelihoodField,
        depth: &DistanceTable,
    ) -> Self {
        let (w, h) = (g.width() as f64 * g.resolution(), g.height() as f64 * g.resolution());
        let cell = CELL.max((w * h / MAX_CELLS).sqrt()).max(g.resolution());
        let (width, height) = ((w / cell).ceil() as usize, (h / cell).ceil() as usize);
        let half = 0.5 * cell;
        let deep = ((DEPTH + half) / g.resolution()).powi(2).min(250.0) as u8;
        let mut agree = vec![0i8; DIRECTIONS * width * height];
        let mut contradict = vec![0i8; width * height];
        for row in 0..height {
            for col in 0..width {
                let (u, v) = ((col as f64 + 0.5) * cell, (row as f64 + 0.5) * cell);
                let (fine_col, fine_row) =
                    ((u / g.resolution()) as usize, (v / g.resolution()) as usize);
                if fine_col >= g.width() || fine_row >= g.height() {
                    continue;
                }
                let fine = fine_row * g.width() + fine_col;
                let at = row * width + col;
                contradict[at] = match class_of(g.cells()[fine]) {
                    Class::Unknown => 0,
                    Class::Free if depth.squared(fine) >= deep => SCORES.2,
                    _ => SCORES.1,
                };
                let center = g.cell_center(fine_row, fine_col);
                for d in 0..DIRECTIONS {
                    let Some(k) = field.nearest(fine, d) else { continue };
                    let r = ((boundary[k].position - center).norm() - half).max(0.0);
                    let value = SCORES.0 * (-(r / BLUR).powi(2)).exp2();
                    // Agreement takes the place of what the cell says of strangers.
                    let value = value.round() as i8 - contradict[at].max(SCORES.1);
                    agree[d * width * height + at] = if value > 0 { value } else { 0 };
                }
            }
        }
        Self { t_map_coarse: g.origin(), cell, width, height, agree, contradict }
    }
}

/// The scores of all shifts at one rotation, reused for every rotation.
struct Shifts {
    scores: Vec<i16>,
}

impl Shifts {
    /// Scores and transforms of the highest peaks at one rotation.
    fn peaks(&mut self, a: &CoarseTable, b: &[WallSample], theta: f64) -> Vec<(i32, Se2)> {
        // b's samples in a's grid axes, turned but not shifted.
        let to_axes = Se2::new(0.0, 0.0, theta - a.t_map_coarse.theta).to_rigid();
        let turned: Vec<(Vec2, Vec2, &WallSample)> =
            b.iter().map(|s| (to_axes.apply(s.position), to_axes.rotate(s.normal), s)).collect();
        let first = turned[0].0;
        let (low, high) =
            turned.iter().fold((first, first), |(lo, hi), (p, _, _)| (lo.inf(p), hi.sup(p)));
        let index = |p: &Vec2| {
            let q = (p - low) / a.cell;
            (q.y as usize, q.x as usize)
        };
        let (rows, cols) = index(&high);
        let (w, h) = (a.width + cols + 1, a.height + rows + 1);
        // A map kilometres wide against one in fine cells: other sources may find it.
        if (w as f64) * (h as f64) > MAX_SHIFTS {
            return Vec::new();
        }

        // Samples of one coarse cell and direction are looked up together.
        let mut agree: BTreeMap<(usize, usize, usize), f64> = BTreeMap::new();
        let mut contradict: BTreeMap<(usize, usize), f64> = BTreeMap::new();
        let mut total = 0.0;
        for (p, n, s) in &turned {
            let (row, col) = index(p);
            *agree.entry((direction(*n), row, col)).or_default() += s.weight;
            *contradict.entry((row, col)).or_default() += s.conflict_weight;
            total += s.weight;
        }
        // No agreement can leave an i16; what is contradicted beyond that is beyond caring.
        let steps = STEPS.min(30_000.0 / (total * (SCORES.0 - f64::from(SCORES.1))));

        self.scores.clear();
        self.scores.resize(w * h, 0);
        let area = a.width * a.height;
        // What rounding takes from one sample it gives to the next.
        let mut carry = 0.0;
        let mut add = |table: &[i8], (row, col): (usize, usize), weight: f64| {
            carry += weight * steps;
            let weight = carry.floor().min(1000.0);
            carry -= weight;
            if weight < 1.0 {
                return;
            }
            let weight = weight as i16;
            for (y, line) in table.chunks_exact(a.width).enumerate() {
                // The sample lies in a's cell (y, x) when b is shifted by that, less its own cell.
                let at = (y + rows - row) * w + cols - col;
                let scores = &mut self.scores[at..at + a.width];
                let add = |(s, t): (&mut i16, &i8)| *s = s.saturating_add(weight * i16::from(*t));
                scores.iter_mut().zip(line).for_each(add);
            }
        };
        for ((d, row, col), weight) in &agree {
            add(&a.agree[d * area..(d + 1) * area], (*row, *col), *weight);
        }
        for (at, weight) in &contradict {
            add(&a.contradict, *at, *weight);
        }
        let tops = peaks_of(&self.scores, w, h);
        tops.into_iter()
            .map(|(score, at)| {
                // Cells to metres: low of b comes to lie at the shift's cell.
                let cells = Vec2::new((at % w) as f64 - cols as f64, (at / w) as f64 - rows as f64);
                let shift = cells * a.cell - low;
                let in_axes = Se2::from_parts(shift, theta - a.t_map_coarse.theta);
                ((f64::from(score) / steps) as i32, a.t_map_coarse.compose(&in_axes))
            })
            .collect()
    }
}

/// Values and indices of the highest local maxima of a table that are above zero.
fn peaks_of(table: &[i16], w: usize, h: usize) -> Vec<(i16, usize)> {
    let mut tops: Vec<(i16, usize)> = Vec::new();
    for row in 1..h.saturating_sub(1) {
        for col in 1..w - 1 {
            let v = table[row * w + col];
            let is_top =
                v > 0 && (0..9).all(|k| table[(row + k / 3 - 1) * w + col + k % 3 - 1] <= v);
            if is_top {
                tops.push((v, row * w + col));
            }
        }
    }
    tops.sort_by(|x, y| y.0.cmp(&x.0).then(x.1.cmp(&y.1)));
    tops.truncate(PEAKS);
    tops
}
