//! Exhaustive correlation: modes where no clean corner is in common.
//!
//! The circular correlation of the two maps' histograms of wall normals leaves few rotations (a full
//! turn, since normals point into free space). At each of them every shift is scored: walls of b on
//! like-oriented walls of a, less walls of b in clear free space of a. That is what keeps small overlaps
//! in sight: few walls agree there, yet none contradicts. The score is a sum of shifted tables, one for
//! each cell that holds wall samples of b, which the compiler turns into vector adds. All shifts are scored
//! in wide cells, the best of them again in cells half as wide (Olson, "Real-time correlative scan matching",
//! ICRA 2009).

use crate::local_map::LocalMap;
use crate::registration::{
    shifts,
    turned::{Shift, Turned},
    Candidate, Source,
};

/// Share of the best score in finer cells that another peak must reach in wide ones to be scored in finer ones, too:
/// it reaches less there.
const RIVAL: f32 = 0.5;

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
    for (k, found) in shifts::peaks(&a.coarse.wide, &turns, effort.steps).into_iter().enumerate() {
        peaks.extend(found.into_iter().map(|(score, shift)| (score, k, shift)));
    }
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
