//! Exhaustive correlation: modes where no clean corner is in common.
//!
//! The circular correlation of the two maps' histograms of wall normals leaves few rotations (a full
//! turn, since normals point into free space). At each of them every shift is scored: walls of b on
//! like-oriented walls of a, less walls of b in clear free space of a. That is what keeps small overlaps
//! in sight: few walls agree there, yet none contradicts. The score is a sum of shifted tables, one for
//! each cell that holds wall samples of b, which the compiler turns into vector adds. All shifts are scored
//! in wide cells, the best of them again in cells half as wide (Olson, "Real-time correlative scan matching",
//! ICRA 2009).

use crate::likelihood_field::DIRECTIONS;
use crate::local_map::LocalMap;
use crate::probe::{Axes, Probe};
use crate::registration::coarse_table::{CoarseTable, SCORES};
use crate::registration::wide_table::{self, WideTable, SHORTEST};
use crate::registration::{Candidate, Source};
use crate::se2::Se2;
use std::cell::RefCell;

/// Peaks that are kept at each rotation.
const PEAKS: usize = 40;
/// Samples that score a peak again.
const PEAK_SAMPLES: usize = 160;
/// Share of the best score in finer cells that another peak must reach in wide ones to be scored in finer ones, too:
/// it reaches less there.
const RIVAL: f32 = 0.5;
/// Scores that are looked at together.
const AT_ONCE: usize = 16;
/// A peak may be so many times lower than the highest.
const FAR_BELOW: i16 = 4;
/// Most bins and shifts whose memory is kept from pair to pair.
const MOST_KEPT: usize = 2 << 20;
/// Most shifts that are scored at one rotation.
const MAX_SHIFTS: f64 = 1e7;
/// Steps that a bin's contradiction is told in: it is spread wider than agreement is.
const CONTRADICTION: f32 = 4.0;

/// How much is spent on correlation.
#[derive(Clone, Copy)]
pub struct Effort {
    /// Most rotations at which all shifts are tried at first.
    pub promising: usize,
    /// Most further rotations at which they are tried where none of those leads to a pose that proves itself.
    pub further: usize,
    /// Steps of a bin's weight: independent observations times this, at most. Few steps thin the bins out.
    pub steps: f64,
    /// Most peaks of all rotations together that are scored again in finer cells.
    pub peaks: usize,
}

impl Effort {
    /// What is spent on further rotations: they are many, and few maps need them.
    pub fn of_further(self) -> Self {
        Self { steps: self.steps / 2.0, peaks: self.peaks / 2, ..self }
    }
}

/// Where a pose is looked for.
pub const THOROUGH: Effort = Effort { promising: 6, further: 8, steps: 2.0, peaks: 240 };

/// Candidates for `T_a_b` at some rotations of b's axes into a's, radians, each with its score, the best first.
pub fn candidates(
    a: &LocalMap,
    b: &LocalMap,
    rotations: &[f64],
    effort: Effort,
) -> Vec<(f32, Candidate)> {
    if a.probes.is_empty() || b.probes.is_empty() {
        return Vec::new();
    }
    let turns: Vec<Turned> =
        rotations.iter().map(|theta| Turned::new(&a.coarse, &b.probes, *theta)).collect();
    let mut peaks: Vec<(f32, usize, Shift)> = Vec::new();
    for (k, turned) in turns.iter().enumerate() {
        // Nothing in there runs in parallel: another pair on this thread would find the memory taken.
        let found =
            SHIFTS.with_borrow_mut(|shifts| shifts.peaks(&a.coarse.wide, turned, effort.steps));
        peaks.extend(found.into_iter().map(|(score, shift)| (score, k, shift)));
    }
    SHIFTS.with_borrow_mut(Shifts::give_back);
    let best_first = |x: &(f32, usize, Shift), y: &(f32, usize, Shift)| {
        y.0.total_cmp(&x.0).then((x.1, x.2).cmp(&(y.1, y.2)))
    };
    peaks.sort_unstable_by(best_first);
    peaks.truncate(effort.peaks);
    let (mut best, mut rivals) = (0.0f32, 0);
    for (score, k, shift) in &mut peaks {
        if *score < RIVAL * best {
            break;
        }
        (*score, *shift) = turns[*k].look_into(&a.coarse, *shift);
        best = best.max(*score);
        rivals += 1;
    }
    peaks.truncate(rivals);
    peaks.sort_unstable_by(best_first);
    peaks.dedup_by_key(|(_, k, shift)| (*k, *shift));
    let (to_a, from_b) = (a.grid.origin(), b.grid.origin().inverse());
    let candidate = |(score, k, shift): (f32, usize, Shift)| {
        let t_a_b = to_a.compose(&turns[k].pose(shift, a.coarse.cell)).compose(&from_b);
        (score, Candidate { t_a_b, source: Source::Correlation })
    };
    peaks.into_iter().map(candidate).collect()
}

/// How many fine cells (rows, columns) the turned map is shifted.
type Shift = (i32, i32);

/// A turned probe: the fine cell it lies in when the map is not shifted, and what it says.
#[derive(Clone, Copy)]
struct InCell {
    row: i32,
    col: i32,
    octant: usize,
    weight: f32,
    conflict_weight: f32,
}

/// The other map's probes at one rotation.
struct Turned {
    theta: f64,
    /// The lowest coordinates of any probe, metres.
    low: (f64, f64),
    /// All of the probes; cells count from `low`.
    probes: Vec<InCell>,
    /// Those of them that score a peak again.
    some: Vec<InCell>,
    /// Rows and columns that they fill.
    size: (usize, usize),
}

impl Turned {
    fn new(a: &CoarseTable, b: &[Probe], theta: f64) -> Self {
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
    fn look_into(&self, a: &CoarseTable, (rows, cols): Shift) -> (f32, Shift) {
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
    fn pose(&self, (rows, cols): Shift, cell: f64) -> Se2 {
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

thread_local! {
    /// Kept from pair to pair: fresh memory costs more than the sums in it.
    static SHIFTS: RefCell<Shifts> = RefCell::default();
}

/// The scores of all shifts at one rotation, reused for every rotation.
#[derive(Default)]
struct Shifts {
    scores: Vec<i16>,
    /// Weight of b's probes by direction and wide cell, and last that of their contradiction.
    bins: Vec<f32>,
    /// Of each direction, and of the contradiction, the bins that hold something.
    filled: [Filled; DIRECTIONS + 1],
    /// How many times a table is added, and to which shifts: those of the bin in its first cell.
    sums: Vec<(u32, i16)>,
}

/// Bins in the order in which they were filled.
#[derive(Default)]
struct Filled {
    /// The cell, and the shift at which it comes to lie on the table's first cell, both by their indices; room for as
    /// many as there are probes.
    bins: Vec<(u32, u32)>,
    number: usize,
}

impl Shifts {
    /// Memory that few pairs need is not kept.
    fn give_back(&mut self) {
        if self.bins.capacity() + self.scores.capacity() > MOST_KEPT {
            *self = Self::default();
        }
    }

    /// Scores and shifts of the highest peaks at one rotation, weights told in so many steps.
    fn peaks(&mut self, a: &WideTable, b: &Turned, steps: f64) -> Vec<(f32, Shift)> {
        let (rows, cols) = (b.size.0.div_ceil(2), b.size.1.div_ceil(2));
        let (w, h) = (a.width + cols - 1, a.height + rows - 1);
        // A map kilometres wide against one in fine cells: other sources may find it.
        if (w as f64) * (h as f64) > MAX_SHIFTS {
            return Vec::new();
        }
        let area = rows * cols;
        debug_assert!(self.bins.iter().all(|b| *b == 0.0), "each is emptied when it is added");
        self.bins.resize(self.bins.len().max(area * (DIRECTIONS + 1)), 0.0);
        for filled in &mut self.filled {
            filled.bins.resize(filled.bins.len().max(b.probes.len() + 1), (0, 0));
        }
        let mut total = 0.0;
        for p in &b.probes {
            let (row, col) = ((p.row / 2) as usize, (p.col / 2) as usize);
            let at = row * cols + col;
            let to = (rows - 1 - row) * w + cols - 1 - col;
            for (table, weight) in [(p.octant, p.weight), (DIRECTIONS, p.conflict_weight)] {
                let (bin, filled) = (&mut self.bins[table * area + at], &mut self.filled[table]);
                // Kept where the bin was empty: what is new no branch could foresee.
                filled.bins[filled.number] = (at as u32, to as u32);
                filled.number += usize::from((*bin == 0.0) & (weight > 0.0));
                *bin += weight;
            }
            total += f64::from(p.weight);
        }
        // No agreement can leave an i16; what is contradicted beyond that is beyond caring.
        let steps = steps.min(30_000.0 / (total * (SCORES.0 - f64::from(SCORES.1)))) as f32;

        self.scores.clear();
        // Strips are padded, beyond the end too.
        self.scores.resize(w * h + SHORTEST, 0);
        for (table, filled) in self.filled.iter_mut().enumerate() {
            let unit = if table == DIRECTIONS { CONTRADICTION } else { 1.0 };
            // What rounding takes from one bin it gives to the next.
            let mut carry = 0.0;
            let filled = &filled.bins[..std::mem::take(&mut filled.number)];
            self.sums.resize(self.sums.len().max(filled.len() + 1), (0, 0));
            let mut number = 0;
            for (at, to) in filled {
                carry += std::mem::take(&mut self.bins[table * area + *at as usize]) * steps;
                let weight = ((carry / unit) as i32).min(1000) as f32 * unit;
                carry -= weight;
                self.sums[number] = (*to, weight as i16);
                number += usize::from(weight >= 1.0);
            }
            for (to, weight) in &self.sums[..number] {
                wide_table::add(&a.tables[table], &mut self.scores[*to as usize..], w, *weight);
            }
        }
        let shift = |at: usize| {
            let cells = |k: usize, offset: usize| 2 * (k as i32 - offset as i32);
            (cells(at / w, rows - 1), cells(at % w, cols - 1))
        };
        let tops = peaks_of(&self.scores, w, h);
        tops.into_iter().map(|(score, at)| (f32::from(score) / steps, shift(at))).collect()
    }
}

/// Values and indices of the highest local maxima of a table, as far as they come near the highest of all.
#[multiversion::multiversion(targets("x86_64+avx2"))]
fn peaks_of(table: &[i16], w: usize, h: usize) -> Vec<(i16, usize)> {
    let inner = |row: usize| table[row * w..(row + 1) * w].iter().take(w.max(1) - 1).skip(1);
    let most = (1..h.max(1) - 1).flat_map(inner).fold(0, |most, v| most.max(*v));
    let least = (most / FAR_BELOW).max(1);
    let mut tops: Vec<(i16, usize)> = Vec::new();
    for row in 1..h.saturating_sub(1) {
        let line = row * w..(row + 1) * w;
        // Most of the table is lower: that is seen at a glance.
        for (chunk, some) in table[line].chunks(AT_ONCE).enumerate() {
            if some.iter().fold(0, |most, v| most.max(*v)) < least {
                continue;
            }
            let from = chunk * AT_ONCE;
            for col in from.max(1)..(from + some.len()).min(w - 1) {
                let v = table[row * w + col];
                let is_top = v >= least
                    && (0..9).all(|k| table[(row + k / 3 - 1) * w + col + k % 3 - 1] <= v);
                if is_top {
                    tops.push((v, row * w + col));
                }
            }
        }
    }
    let best_first = |x: &(i16, usize), y: &(i16, usize)| y.0.cmp(&x.0).then(x.1.cmp(&y.1));
    if tops.len() > PEAKS {
        tops.select_nth_unstable_by(PEAKS, best_first);
        tops.truncate(PEAKS);
    }
    tops.sort_unstable_by(best_first);
    tops
}
