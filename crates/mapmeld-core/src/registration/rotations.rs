//! The rotations at which two maps may lie: those at which their walls have the same directions.

use crate::probe::Probe;
use std::f64::consts::TAU;

/// Bins of a full turn: one degree each.
const BINS: usize = 360;
/// Fine bins in one of those.
const FINE: usize = 8;
/// How far from a rotation the exact one is looked for, fine bins: the histogram is smoothed over three degrees.
const NEAR: usize = 3 * FINE / 2;
/// Share of what the best rotation promises that another must promise: walls of few directions leave few rotations.
const PROMISING: f32 = 0.95;

/// How the walls of a map turn: the weight of their normals by direction.
#[derive(Debug, Clone)]
pub struct Turns {
    /// Square roots, smoothed over about three degrees: long walls of one direction must not hide the rest.
    roots: Box<[f32; BINS]>,
    /// As it is, smoothed over half a degree: long walls tell their direction best.
    fine: Box<[f32; BINS * FINE]>,
}

impl Turns {
    /// From wall samples in the grid's axes.
    pub fn new(probes: &[Probe]) -> Self {
        let mut raw = [0.0; BINS];
        let mut finely = vec![0.0; BINS * FINE];
        for p in probes {
            raw[usize::from(p.direction) * BINS / 65536] += p.weight;
            finely[usize::from(p.direction) * (BINS * FINE) / 65536] += p.weight;
        }
        let rough = smoothed(&raw, &[0.05, 0.25, 0.6, 1.0, 0.6, 0.25, 0.05]);
        let roots = rough.into_iter().map(f32::sqrt).collect();
        let fine = smoothed(&finely, &[0.2, 0.5, 0.8, 1.0, 0.8, 0.5, 0.2]);
        let sized = "as many as there are bins";
        Self {
            roots: Vec::try_into(roots).map(Box::new).expect(sized),
            fine: Vec::try_into(fine).map(Box::new).expect(sized),
        }
    }
}

/// A histogram of directions, each bin with its neighbours.
fn smoothed(raw: &[f32], kernel: &[f32; 7]) -> Vec<f32> {
    let n = raw.len();
    let at = |k: usize, i: usize| raw[(k + n + i - 3) % n];
    (0..n).map(|k| kernel.iter().enumerate().map(|(i, w)| w * at(k, i)).sum()).collect()
}

/// In lanes: one sum would wait for each of its terms.
#[multiversion::multiversion(targets("x86_64+avx2"))]
fn dot(x: &[f32], y: &[f32]) -> f32 {
    let mut sums = [0.0; 8];
    for (x, y) in x.chunks_exact(8).zip(y.chunks_exact(8)) {
        (0..8).for_each(|k| sums[k] += x[k] * y[k]);
    }
    sums.iter().sum()
}

/// The rotations of b's axes into a's that two maps propose, some degrees apart.
pub struct Proposed<'t> {
    a: &'t Turns,
    b: &'t Turns,
    /// Bins of those that promise nearly as much as the best.
    promising: Vec<usize>,
}

impl<'t> Proposed<'t> {
    /// So many that promise nearly as much as the best, at most.
    pub fn new(a: &'t Turns, b: &'t Turns, most: usize) -> Self {
        let score = spectrum(&a.roots, &b.roots);
        let order = descending(&score);
        let nearly = |k: &usize| score[*k] >= PROMISING * score[order[0]];
        let mut promising: Vec<usize> = Vec::new();
        keep_apart(&mut promising, order.iter().copied().take_while(nearly), most);
        Self { a, b, promising }
    }

    /// The most promising ones, radians, the best first.
    pub fn promising(&self) -> Vec<f64> {
        self.exactly(&self.promising)
    }

    /// So many others at most, by how much the walls agree there, long ones before many: round columns and clutter have
    /// all directions and hide where one long wall of both lies.
    pub fn further(&self, most: usize) -> Vec<f64> {
        if most == 0 {
            return Vec::new();
        }
        let square = |x: &[f32; BINS]| x.map(|v| v * v);
        let score = spectrum(&square(&self.a.roots), &square(&self.b.roots));
        // No flanks of peaks that are there already.
        let is_peak = |k: &usize| {
            [1, 2, BINS - 2, BINS - 1].iter().all(|off| score[(k + off) % BINS] < score[*k])
        };
        let peaks = descending(&score).into_iter().filter(is_peak);
        let mut kept = self.promising.clone();
        let most = kept.len() + most;
        keep_apart(&mut kept, peaks, most);
        self.exactly(&kept[self.promising.len()..])
    }

    fn exactly(&self, bins: &[usize]) -> Vec<f64> {
        let twice: Vec<f32> = self.a.fine.iter().chain(self.a.fine.iter()).copied().collect();
        bins.iter().map(|k| exactly(*k, &twice, &self.b.fine[..])).collect()
    }
}

/// The rotation near a bin at which the long walls agree best, radians: half a degree of a wall of fifty metres is half a
/// metre at its end. `twice`: a's fine histogram, two turns of it.
fn exactly(bin: usize, twice: &[f32], b: &[f32]) -> f64 {
    let n = b.len();
    let first = bin * FINE + n - NEAR;
    let score: Vec<f32> = (0..=2 * NEAR)
        .map(|d| {
            let at = (first + d) % n;
            dot(b, &twice[at..at + n])
        })
        .collect();
    let best = (0..score.len()).max_by(|x, y| {
        // The nearest of equals: a map without walls has nothing to tell.
        score[*x].total_cmp(&score[*y]).then(y.abs_diff(NEAR).cmp(&x.abs_diff(NEAR)))
    });
    let k = best.expect("there are some");
    let (k, shift) = match score.get(k.wrapping_sub(1)..k + 2) {
        // The peak between the bins, by a parabola.
        Some([l, m, r]) if l - 2.0 * m + r < -1e-9 => {
            (k, (0.5 * (l - r) / (l - 2.0 * m + r)).clamp(-0.5, 0.5))
        }
        Some(_) => (k, 0.0),
        // It rises out of sight: that is a peak of something else.
        None => (NEAR, 0.0),
    };
    (first + k) as f64 % n as f64 * TAU / n as f64 + f64::from(shift) * TAU / n as f64
}

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
fn keep_apart(kept: &mut Vec<usize>, order: impl Iterator<Item = usize>, most: usize) {
    for k in order {
        if kept.len() >= most {
            break;
        }
        if kept.iter().all(|j| (k + BINS - j) % BINS >= 6 && (j + BINS - k) % BINS >= 6) {
            kept.push(k);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How much wall of each direction a map shows: peaks over pillars, which show all of them.
    fn shown(pillars: f32, peaks: &[(usize, f32)]) -> Turns {
        let mut shown = [pillars; BINS];
        peaks.iter().for_each(|(at, height)| shown[*at] += height);
        let fine = std::array::from_fn(|k| if k % FINE == 0 { shown[k / FINE] } else { 0.0 });
        Turns { roots: Box::new(shown.map(f32::sqrt)), fine: Box::new(fine) }
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
        let proposed = Proposed::new(&a, &b, 6);
        let (first, others) = (proposed.promising(), proposed.further(8));
        assert!(others.len() <= 8, "{others:?}");
        assert!(!is_among(&first, 270.0) && is_among(&others, 270.0), "{first:?} {others:?}");
        let all = [first, others].concat();
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
        let walls = |turn: usize| -> Turns {
            let peaks: Vec<_> = (0..4).flat_map(|q| wide(turn + 90 * q)).collect();
            shown(1.0, &peaks)
        };
        let (a, b) = (walls(30), walls(75));
        let proposed = Proposed::new(&a, &b, 6);
        let found = proposed.promising();
        assert_eq!((found.len(), proposed.further(8).len()), (4, 0), "{found:?}");
        let is_diagonal = |r: &f64| ((r.to_degrees() + 45.0) % 90.0 - 45.0).abs() > 44.0;
        assert!(found.iter().all(is_diagonal), "{found:?}");
    }

    #[test]
    fn maps_that_show_no_direction_have_rotations_all_the_same() {
        let round = shown(1.0, &[]);
        assert_eq!(Proposed::new(&round, &round, 6).promising().len(), 6);
    }

    #[test]
    fn long_walls_tell_the_rotation_to_a_tenth_of_a_degree() {
        // Four directions of a building, and clutter that lies otherwise in the other map; degrees.
        let map = |turn: f64, clutter: f64| {
            let walls = (0..4).map(|q| (turn + 90.0 * f64::from(q), 40.0));
            let clutter = (0..60).map(|k| (clutter + 6.0 * f64::from(k), 0.5));
            let probe = |(degrees, weight): (f64, f32)| Probe {
                direction: (degrees.rem_euclid(360.0) / 360.0 * 65536.0) as u16,
                weight,
                ..Probe::default()
            };
            Turns::new(&walls.chain(clutter).map(probe).collect::<Vec<_>>())
        };
        for turn in [0.0, 12.34, 89.9, 181.27, 359.95] {
            let (a, b) = (map(turn, turn + 0.8), map(0.41, 2.3));
            let found = Proposed::new(&a, &b, 6).promising();
            let off =
                |r: &f64| ((r.to_degrees() - turn + 0.41 + 45.0).rem_euclid(90.0) - 45.0).abs();
            assert!(found.iter().all(|r| off(r) < 0.1), "{turn}: {found:?}");
        }
    }
}
