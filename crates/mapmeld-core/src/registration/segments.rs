//! Pairs of walls that are not parallel: corners that nobody needs to have seen.
//!
//! Where the place at which two walls meet is hidden, or there is a door, there is no corner; the
//! walls' lines still meet in one point, which two maps share. The rotation comes from the two
//! directions, the shift from the point.

use crate::registration::{Candidate, Source};
use crate::se2::{Rigid, Se2, Vec2};
use crate::structure::Line;

/// Lines of a map that are paired, longest first.
const MAX_LINES: usize = 40;
/// Crossings of a map that are matched, those with the longest shorter line first.
const MAX_CROSSINGS: usize = 50;
/// Farthest that a line's end may lie from the crossing, metres.
const MAX_GAP: f64 = 6.0;
/// Smallest sine of the angle between the lines.
const MIN_SINE: f64 = 0.4;
/// Largest difference of the angles between the walls of two crossings, radians.
const TOLERANCE: f64 = 0.12;

/// Where the lines of two walls cross.
#[derive(Debug, Clone, Copy)]
struct Crossing {
    point: Vec2,
    /// Direction halfway between the normals, radians; the second is reached counter-clockwise from the first by `turn`.
    heading: f64,
    /// Sine and cosine of it.
    sin_cos: (f64, f64),
    /// In (0, pi).
    turn: f64,
    weight: f64,
}

/// Crossings of a map's longest lines, the best supported first.
fn crossings(lines: &[Line]) -> Vec<Crossing> {
    let lines = &lines[..lines.len().min(MAX_LINES)];
    let mut out = Vec::new();
    for (i, a) in lines.iter().enumerate() {
        for b in &lines[i + 1..] {
            let cross = a.normal.x * b.normal.y - a.normal.y * b.normal.x;
            if cross.abs() < MIN_SINE {
                continue;
            }
            // n_a . p = n_a . a and n_b . p = n_b . b
            let (ca, cb) = (a.normal.dot(&a.start), b.normal.dot(&b.start));
            let point = Vec2::new(
                (ca * b.normal.y - cb * a.normal.y) / cross,
                (cb * a.normal.x - ca * b.normal.x) / cross,
            );
            let gap = |l: &Line| (point - l.start).norm().min((point - l.end).norm());
            if gap(a).max(gap(b)) > MAX_GAP {
                continue;
            }
            let (first, turn) = if cross > 0.0 {
                (a, cross.atan2(a.normal.dot(&b.normal)))
            } else {
                (b, (-cross).atan2(a.normal.dot(&b.normal)))
            };
            let heading = first.normal.y.atan2(first.normal.x) + 0.5 * turn;
            let (sin_cos, weight) = (heading.sin_cos(), a.length().min(b.length()));
            out.push(Crossing { point, heading, sin_cos, turn, weight });
        }
    }
    out.sort_by(|x, y| y.weight.total_cmp(&x.weight));
    out.truncate(MAX_CROSSINGS);
    out
}

/// Candidates for `T_a_b`: one for every two crossings whose walls make the same angle.
pub fn candidates(a: &[Line], b: &[Line]) -> Vec<Candidate> {
    let (ca, cb) = (crossings(a), crossings(b));
    let mut out = Vec::new();
    for x in &ca {
        for y in cb.iter().filter(|y| (x.turn - y.turn).abs() < TOLERANCE) {
            // The mean of the two walls' rotations.
            let ((sx, cx), (sy, cy)) = (x.sin_cos, y.sin_cos);
            let sin_cos = (sx * cy - cx * sy, cx * cy + sx * sy);
            let turned = Rigid::from_parts(Vec2::zeros(), sin_cos).apply(y.point);
            let t_a_b = Se2::from_parts(x.point - turned, x.heading - y.heading);
            out.push(Candidate { t_a_b, source: Source::Segments });
        }
    }
    out
}
