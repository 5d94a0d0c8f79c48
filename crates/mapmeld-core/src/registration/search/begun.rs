//! The first steps uphill of what looks promising.

use super::{is_proven, Scored, Search, Weighed, FIRST_FOLLOWED, FIRST_SAMPLES, RIVAL};
use crate::registration::{climb::Climb, Candidate};
use crate::se2::Se2;

/// Steps that every candidate that was looked at longest is led uphill.
const FIRST_STEPS: usize = 4;
/// What begins as near as this (metres, radians) to where another has begun or come to is led the same way, nine times of ten.
const SAME_SLOPE: (f64, f64) = (0.3, 0.05);
/// The same as a share of how far walls may lie from each other when a climb begins: fine cells reach less.
const SLOPE_REACH: f64 = 1.5;

/// Poses that have taken the first steps uphill.
pub(super) struct Begun {
    /// Where they began.
    pub from: Vec<Se2>,
    /// Where they are now.
    pub poses: Vec<Weighed>,
    /// How a candidate must look to follow them.
    bar: f64,
}

impl Default for Begun {
    fn default() -> Self {
        Self { from: Vec::new(), poses: Vec::new(), bar: f64::NEG_INFINITY }
    }
}

impl Search<'_> {
    /// The first steps uphill of some candidates, the best first. What looks worse than matters takes none, nor what looks
    /// far worse than a pose that has proven itself before, nor what begins near another.
    pub(super) fn begin(&self, some: &[Scored], begun: &mut Begun) {
        let climb = Climb { steps: FIRST_STEPS, ..self.climb(FIRST_SAMPLES) };
        let rung = &self.rungs[self.rungs.len() / 2];
        let (distance, angle) = (SAME_SLOPE.0.min(SLOPE_REACH * climb.scale), SAME_SLOPE.1);
        for (look, c) in some {
            if (begun.poses.len() >= FIRST_FOLLOWED && *look < begun.bar)
                || *look < self.effort.least_look
            {
                break;
            }
            let is_here = |t: &Se2| t.is_close_at(&c.t_a_b, self.center, distance, angle);
            let is_led = |(from, to): (&Se2, &Weighed)| is_here(from) || is_here(&to.0.t_a_b);
            if begun.from.iter().zip(&begun.poses).any(is_led) {
                continue;
            }
            let Some(t_a_b) = climb.top(self.a, self.b, &c.t_a_b, rung) else { continue };
            let pose = self.weigh(Candidate { t_a_b, ..*c }, 2 * FIRST_SAMPLES);
            begun.from.push(c.t_a_b);
            if is_proven(&pose) && *look > 0.0 {
                begun.bar = begun.bar.max(RIVAL * look);
            }
            begun.poses.push(pose);
        }
    }
}
