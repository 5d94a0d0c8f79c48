//! Correlation of oriented walls: modes where no clean corner is in common.
//!
//! The circular correlation of the two maps' histograms of wall normals leaves few rotations (a full
//! turn, since normals point into free space). At each of them every pair of like-oriented wall
//! samples votes for the shift between them; the peaks are candidates. That is the cross-correlation
//! of the oriented boundaries, at the cost of their samples instead of their areas.

use crate::local_map::{LocalMap, WallSample};
use crate::registration::{Candidate, Source};
use crate::se2::{Se2, Vec2};
use std::f64::consts::TAU;

/// Bins of a full turn: one degree each.
const BINS: usize = 360;
/// Rotations that are tried.
const ROTATIONS: usize = 8;
/// Peaks of the votes that are kept at each rotation.
const PEAKS: usize = 40;
/// Side of a vote's bin, metres, where the table stays small enough.
const BIN: f64 = 0.2;
/// Most bins of a table; shifts of larger maps are told apart more coarsely.
const MAX_BINS: f64 = 4e6;
/// Most samples of a map that vote.
const MAX_VOTERS: usize = 350;

/// Candidates for `T_a_b`.
pub fn candidates(a: &LocalMap, b: &LocalMap) -> Vec<Candidate> {
    if a.samples.is_empty() || b.samples.is_empty() {
        return Vec::new();
    }
    let mut votes = Votes::new(a, b);
    rotations(&histogram(&a.samples), &histogram(&b.samples))
        .into_iter()
        .flat_map(|theta| votes.peaks(theta))
        .map(|t_a_b| Candidate { t_a_b, source: Source::Correlation })
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

/// The table of shifts, reused for every rotation.
struct Votes {
    a: Vec<WallSample>,
    b: Vec<WallSample>,
    table: Vec<f32>,
}

impl Votes {
    fn new(a: &LocalMap, b: &LocalMap) -> Self {
        let voters = |m: &LocalMap| -> Vec<WallSample> {
            let step = m.samples.len().div_ceil(MAX_VOTERS).max(1);
            m.samples.iter().step_by(step).copied().collect()
        };
        Self { a: voters(a), b: voters(b), table: Vec::new() }
    }

    /// Transforms of the highest peaks at one rotation.
    fn peaks(&mut self, theta: f64) -> Vec<Se2> {
        let turn = Se2::new(0.0, 0.0, theta).to_rigid();
        let b: Vec<WallSample> = self
            .b
            .iter()
            .map(|s| WallSample {
                position: turn.apply(s.position),
                normal: turn.rotate(s.normal),
                ..*s
            })
            .collect();
        let (a_min, a_max) = bounds(&self.a);
        let (b_min, b_max) = bounds(&b);
        let low = a_min - b_max;
        let span = a_max - b_min - low;
        let bin = BIN.max((span.x * span.y / MAX_BINS).sqrt()).max(span.max() / MAX_BINS);
        let size = span / bin;
        let (w, h) = (size.x as usize + 3, size.y as usize + 3);
        self.table.clear();
        self.table.resize(w * h, 0.0);
        for sa in &self.a {
            let base = (sa.position - low) / bin + Vec2::new(0.5, 0.5);
            for sb in &b {
                let dot = sa.normal.dot(&sb.normal);
                if dot.abs() < 0.8 {
                    continue;
                }
                let p = base - sb.position / bin;
                let (col, row) = (p.x as usize, p.y as usize);
                // Opposed walls in the same place speak against the shift.
                let vote = (sa.weight * sb.weight).sqrt() * if dot > 0.0 { 1.0 } else { -0.5 };
                let (fx, fy) = ((p.x - col as f64) as f32, (p.y - row as f64) as f32);
                let vote = vote as f32;
                let at = row * w + col;
                self.table[at] += vote * (1.0 - fx) * (1.0 - fy);
                self.table[at + 1] += vote * fx * (1.0 - fy);
                self.table[at + w] += vote * (1.0 - fx) * fy;
                self.table[at + w + 1] += vote * fx * fy;
            }
        }
        let mut tops: Vec<(f32, usize)> = Vec::new();
        for row in 1..h - 1 {
            for col in 1..w - 1 {
                let v = self.table[row * w + col];
                if v <= 0.0 {
                    continue;
                }
                let is_top = (0..9).all(|k| {
                    let at = (row + k / 3 - 1) * w + col + k % 3 - 1;
                    self.table[at] <= v
                });
                if is_top {
                    tops.push((v, row * w + col));
                }
            }
        }
        tops.sort_by(|x, y| y.0.total_cmp(&x.0).then(x.1.cmp(&y.1)));
        tops.truncate(PEAKS);
        tops.into_iter()
            .map(|(_, at)| {
                let shift = low + Vec2::new((at % w) as f64 - 0.5, (at / w) as f64 - 0.5) * bin;
                Se2::from_parts(shift, theta)
            })
            .collect()
    }
}

fn bounds(samples: &[WallSample]) -> (Vec2, Vec2) {
    let first = samples[0].position;
    samples.iter().fold((first, first), |(lo, hi), s| (lo.inf(&s.position), hi.sup(&s.position)))
}
