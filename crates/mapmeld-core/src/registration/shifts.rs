//! The scores of all shifts of a turned map in a wide table, and the highest peaks among them.

use crate::likelihood_field::DIRECTIONS;
use crate::registration::coarse_table::SCORES;
use crate::registration::turned::{Shift, Turned};
use crate::registration::wide_table::{self, Bin, WideTable, SHORTEST};
use std::cell::RefCell;

/// Peaks that are kept at each rotation.
const PEAKS: usize = 40;
/// Scores that are looked at together.
const AT_ONCE: usize = 16;
/// A peak may be so many times lower than the highest.
const FAR_BELOW: i16 = 4;
/// Most values whose memory is kept from pair to pair.
const MOST_KEPT: usize = 2 << 20;
/// Most shifts that are scored at one rotation.
const MAX_SHIFTS: f64 = 1e7;
/// Steps that a bin's contradiction is told in: it is spread wider than agreement is.
const CONTRADICTION: f32 = 4.0;
/// Most times that a bin adds a table: a score so many times over fits an i16.
const MOST: f32 = 1000.0;

thread_local! {
    /// Kept from pair to pair: fresh memory costs more than the sums in it.
    static SHIFTS: RefCell<Shifts> = RefCell::default();
}

/// Scores and shifts of the highest peaks at each rotation, weights told in so many steps.
pub fn peaks(a: &WideTable, turns: &[Turned], steps: f64) -> Vec<Vec<(f32, Shift)>> {
    // Nothing in there runs in parallel: another pair on this thread would find the memory taken.
    SHIFTS.with_borrow_mut(|shifts| {
        let found = turns.iter().map(|turned| shifts.peaks(a, turned, steps)).collect();
        shifts.give_back();
        found
    })
}

/// The scores of all shifts at one rotation, reused for every rotation.
#[derive(Default)]
struct Shifts {
    scores: Vec<i16>,
    /// Weight of b's probes by direction and wide cell, and last that of their contradiction.
    bins: Vec<f32>,
    /// Of each direction, and of the contradiction, the bins that hold something.
    filled: [Filled; DIRECTIONS + 1],
    /// The bins of one table.
    sums: Vec<Bin>,
    /// Where its strips lie among the scores.
    places: Vec<u32>,
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
        let filled: usize = self.filled.iter().map(|f| f.bins.capacity()).sum();
        let (sums, places) = (self.sums.capacity(), self.places.capacity());
        let others = self.bins.capacity() + self.scores.capacity() + sums + places;
        if filled + others > MOST_KEPT {
            *self = Self::default();
        }
    }

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
            filled.bins.resize(filled.bins.len().max(b.probes.len()), (0, 0));
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
            self.sums.resize(self.sums.len().max(filled.len()), (0, 0));
            let mut number = 0;
            for (at, to) in filled {
                carry += std::mem::take(&mut self.bins[table * area + *at as usize]) * steps;
                let weight = ((carry / unit) as i32).min((MOST / unit) as i32) as f32 * unit;
                carry -= weight;
                self.sums[number] = (*to, weight as i16);
                number += usize::from(weight >= 1.0);
            }
            let (scores, places) = (&mut self.scores, &mut self.places);
            wide_table::add(&a.tables[table], scores, w, &self.sums[..number], places);
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
