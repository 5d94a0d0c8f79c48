//! The rotations at which two maps may lie: those at which their walls have the same directions.

use crate::probe::Probe;
use crate::registration::correlation::Effort;
use std::f64::consts::TAU;

/// Bins of a full turn: one degree each.
pub const BINS: usize = 360;
/// Share of what the best rotation promises that another must promise: walls of few directions leave few rotations.
const PROMISING: f32 = 0.95;

/// Square roots of the weight of the wall normals by direction, smoothed over about three degrees. Square roots:
/// long walls of one direction must not hide the rest.
pub fn turns(probes: &[Probe]) -> [f32; BINS] {
    let mut raw = [0.0; BINS];
    for p in probes {
        raw[usize::from(p.direction) * BINS / 65536] += p.weight;
    }
    let kernel = [0.05, 0.25, 0.6, 1.0, 0.6, 0.25, 0.05];
    std::array::from_fn(|k| {
        let at = |i: usize| raw[(k + BINS + i - 3) % BINS];
        kernel.iter().enumerate().map(|(i, w)| w * at(i)).sum::<f32>().sqrt()
    })
}

/// In lanes: one sum would wait for each of its terms.
fn dot(x: &[f32; BINS], y: &[f32]) -> f32 {
    let mut sums = [0.0; 8];
    for (x, y) in x.chunks_exact(8).zip(y.chunks_exact(8)) {
        (0..8).for_each(|k| sums[k] += x[k] * y[k]);
    }
    sums.iter().sum()
}

/// The most promising rotations of b's axes into a's, radians, at least six degrees apart, and how many of them promise
/// nearly as much as the best; from how their walls turn, see [`turns`]. The others follow by how much the walls agree
/// there, long ones before many: round columns and clutter have all directions and hide where one long wall of both lies.
pub fn proposed(a: &[f32; BINS], b: &[f32; BINS], effort: Effort) -> (Vec<f64>, usize) {
    let score = spectrum(a, b);
    let order = descending(&score);
    let nearly = |k: &usize| score[*k] >= PROMISING * score[order[0]];
    let mut kept: Vec<Bin> = Vec::new();
    keep_apart(&mut kept, order.iter().copied().take_while(nearly), effort.promising, &score);
    let promising = kept.len();
    if effort.further > 0 {
        let square = |x: &[f32; BINS]| x.map(|v| v * v);
        let score = spectrum(&square(a), &square(b));
        // No flanks of peaks that are there already.
        let is_peak = |k: &usize| {
            [1, 2, BINS - 2, BINS - 1].iter().all(|off| score[(k + off) % BINS] < score[*k])
        };
        let peaks = descending(&score).into_iter().filter(is_peak);
        keep_apart(&mut kept, peaks, promising + effort.further, &score);
    }
    (kept.into_iter().map(|(_, theta)| theta).collect(), promising)
}

/// A rotation as a bin, and in radians.
type Bin = (usize, f64);

/// What each rotation promises: the circular correlation of two histograms of wall normals.
fn spectrum(a: &[f32; BINS], b: &[f32; BINS]) -> [f32; BINS] {
    let twice: Vec<f32> = a.iter().chain(a).copied().collect();
    std::array::from_fn(|k| dot(b, &twice[k..k + BINS]))
}

fn descending(score: &[f32; BINS]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..BINS).collect();
    order.sort_by(|x, y| score[*y].total_cmp(&score[*x]).then(x.cmp(y)));
    order
}

/// Adds rotations that lie at least six degrees from each other until there are so many.
fn keep_apart(
    kept: &mut Vec<Bin>,
    order: impl Iterator<Item = usize>,
    most: usize,
    score: &[f32; BINS],
) {
    for k in order {
        if kept.len() >= most {
            break;
        }
        let apart = |j: &Bin| (k + BINS - j.0) % BINS >= 6 && (j.0 + BINS - k) % BINS >= 6;
        if kept.iter().all(apart) {
            // The peak between the bins, by a parabola.
            let (l, m, r) = (score[(k + BINS - 1) % BINS], score[k], score[(k + 1) % BINS]);
            let bend = l - 2.0 * m + r;
            let shift = if bend < -1e-9 { (0.5 * (l - r) / bend).clamp(-0.5, 0.5) } else { 0.0 };
            kept.push((k, (k as f64 + f64::from(shift)) * TAU / BINS as f64));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::registration::correlation::THOROUGH;

    /// Square roots of how much wall of each direction a map shows: peaks over pillars, which show all of them.
    fn shown(pillars: f32, peaks: &[(usize, f32)]) -> [f32; BINS] {
        let mut shown = [pillars; BINS];
        peaks.iter().for_each(|(at, height)| shown[*at] += height);
        shown.map(f32::sqrt)
    }

    fn is_among(rotations: &[f64], degrees: f64) -> bool {
        rotations
            .iter()
            .any(|r| ((r.to_degrees() - degrees).rem_euclid(360.0) - 180.0).abs() > 179.0)
    }

    #[test]
    fn one_long_wall_of_both_maps_is_found_among_pillars() {
        // The wall at 20 degrees of a is b's at 110; the rest are different places that look alike.
        let a = shown(1.0, &[(20, 90.0), (60, 40.0), (180, 40.0), (300, 40.0)]);
        let b = shown(1.0, &[(110, 90.0), (75, 60.0), (195, 60.0), (315, 60.0)]);
        let few = Effort { promising: 6, further: 0, steps: 1.0 };
        let (first, promising) = proposed(&a, &b, few);
        assert_eq!(first.len(), promising);
        let (all, same) = proposed(&a, &b, THOROUGH);
        assert_eq!((&all[..promising], same), (&first[..], promising));
        assert!(all.len() <= promising + THOROUGH.further);
        assert!(!is_among(&first, 270.0) && is_among(&all, 270.0), "{all:?}");
        for (k, x) in all.iter().enumerate() {
            for y in &all[..k] {
                let apart = (x - y).to_degrees().rem_euclid(360.0);
                assert!(apart.min(360.0 - apart) > 4.9, "{x} {y}");
            }
        }
    }

    #[test]
    fn flanks_of_right_angled_walls_are_not_tried() {
        let wide = |at: usize| {
            (0..7)
                .map(move |k| ((at + BINS + k - 3) % BINS, 90.0 / (1.0 + (k as f32 - 3.0).powi(2))))
        };
        let walls = |turn: usize| -> [f32; BINS] {
            let peaks: Vec<_> = (0..4).flat_map(|q| wide(turn + 90 * q)).collect();
            shown(1.0, &peaks)
        };
        let (found, promising) = proposed(&walls(30), &walls(75), THOROUGH);
        assert_eq!((promising, found.len()), (4, 4), "{found:?}");
        let is_diagonal = |r: &f64| ((r.to_degrees() + 45.0) % 90.0 - 45.0).abs() > 44.0;
        assert!(found.iter().all(is_diagonal), "{found:?}");
    }

    #[test]
    fn maps_that_show_no_direction_have_rotations_all_the_same() {
        let round = shown(1.0, &[]);
        assert_eq!(proposed(&round, &round, THOROUGH).1, THOROUGH.promising);
    }
}
