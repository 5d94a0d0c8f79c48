//! Registration of one pair of prepared maps: candidates, shortlist, climb, modes.

use crate::config::{Config, PerceptionConfig, RegistrationConfig};
use crate::local_map::LocalMap;
use crate::perception::{likelihood, placed};
use crate::registration::{
    climb, corners, correlation, segments, Candidate, Mode, Registered, Rung, Source,
};
use crate::se2::{Se2, Vec2};
use nalgebra::Matrix3;
use std::f64::consts::TAU;

/// Samples that the very first look at a candidate takes.
const BLINK_SAMPLES: usize = 64;
/// Samples that a longer look takes.
const GLANCE_SAMPLES: usize = 120;
/// Samples that a climb follows.
const CLIMB_SAMPLES: usize = 250;
/// Samples that the last climb of a mode follows.
const FINAL_SAMPLES: usize = 600;
/// Steps that every candidate worth a second look is led uphill.
const FIRST_STEPS: usize = 6;

/// Registers a pair: the modes of `T_a_b`, most likely first (paper, section 3: the possible motions
/// u_t), and what the mirror image of b reaches, which is what chance and self-similarity reach; both at each
/// standard deviation of the walls that is tried. `hints` are transforms that are worth a climb whatever the
/// sources say.
pub fn register(
    ma: &LocalMap,
    mb: &LocalMap,
    mirrored_b: Option<&LocalMap>,
    hints: &[Se2],
    (a, b): (usize, usize),
    config: &Config,
) -> Registered {
    let (candidates, modes) = find_modes(ma, mb, hints, config.registration.shortlist, config);
    let mut decoys = mirrored_b.map_or_else(Vec::new, |m| {
        find_modes(ma, m, &[], config.registration.decoy_shortlist, config).1
    });
    decoys.resize(modes.len(), Vec::new());
    let evidence = |modes: Vec<Mode>| modes.into_iter().map(|m| m.evidence).collect();
    let rungs = modes
        .into_iter()
        .zip(decoys)
        .map(|(modes, decoys)| Rung { modes, decoys: evidence(decoys) })
        .collect();
    Registered { a, b, candidates, rungs }
}

/// Number of candidates, and the modes that they lead to at each standard deviation of the walls.
fn find_modes(
    ma: &LocalMap,
    mb: &LocalMap,
    hints: &[Se2],
    shortlist: usize,
    config: &Config,
) -> (usize, Vec<Vec<Mode>>) {
    let rungs = config.perception.rungs();
    let (Some(_), Some(center)) = (ma.center, mb.center) else {
        return (0, vec![Vec::new(); rungs.len()]);
    };
    let r = &config.registration;
    let found = of_structures(ma, mb, r);
    let correlated = correlation::candidates(ma, mb);
    let candidates = found.len() + correlated.len() + hints.len();

    let distance =
        r.duplicate_distance.unwrap_or(2.0 * ma.grid.resolution().min(mb.grid.resolution()));
    let stride = |samples: usize| (mb.samples.len() / samples).max(1);
    let distinct = |scored, keep| distinct(scored, keep, center, distance, r.duplicate_angle);
    let look = |found: Vec<Candidate>, samples: usize| -> Vec<(f64, Candidate)> {
        let stride = stride(samples);
        found.into_iter().map(|c| (likelihood::glance(ma, mb, &c.t_a_b, stride), c)).collect()
    };
    let climb_all = |found: &[Candidate], samples: usize, steps: usize, p: &PerceptionConfig| {
        let p = &p.rigid();
        let climbed = found.iter().filter_map(|c| {
            let t_a_b = climb::climb(ma, mb, &c.t_a_b, stride(samples), steps, p)?;
            let evidence = likelihood::pair(ma, mb, &t_a_b, stride(4 * samples), p);
            Some((evidence.log_likelihood, Candidate { t_a_b, ..*c }))
        });
        climbed.collect::<Vec<_>>()
    };
    // Narrowing down: all blinked at, many looked at, fewer led a few steps uphill, the best climbed to
    // the top.
    let mut blinked = look(found, BLINK_SAMPLES);
    blinked.sort_by(|x, y| y.0.total_cmp(&x.0));
    blinked.truncate(40 * shortlist);
    let blinked = blinked.into_iter().map(|(_, c)| c).collect();
    let mut glanced = distinct(look(blinked, GLANCE_SAMPLES), 4 * shortlist);
    let correlated = correlated.into_iter().map(|(score, c)| (f64::from(score), c)).collect();
    glanced.extend(distinct(correlated, 4 * shortlist));
    // The finest standard deviation tells sharp maps' poses apart, the widest finds those of bent maps;
    // what either finds is tried at all of them.
    let mut tops: Vec<Candidate> = Vec::new();
    let widest = (rungs.len() > 1).then(|| &rungs[rungs.len() - 1]);
    for p in rungs.first().into_iter().chain(widest) {
        let mut shortlisted =
            distinct(climb_all(&glanced, GLANCE_SAMPLES, FIRST_STEPS, p), shortlist);
        shortlisted.extend(hints.iter().map(|t| Candidate { t_a_b: *t, source: Source::Members }));
        tops.extend(distinct(
            climb_all(&shortlisted, CLIMB_SAMPLES, r.max_iterations, p),
            r.max_modes,
        ));
    }
    let modes = rungs.iter().map(|p| {
        let at_top = distinct(climb_all(&tops, FINAL_SAMPLES, r.max_iterations, p), r.max_modes);
        let mut modes: Vec<Mode> = at_top.into_iter().map(|c| mode(ma, mb, c, p)).collect();
        modes.sort_by(|x, y| y.evidence.log_likelihood.total_cmp(&x.evidence.log_likelihood));
        modes
    });
    (candidates, modes.collect())
}

/// A pose with what the walls say about it.
fn mode(a: &LocalMap, b: &LocalMap, c: Candidate, p: &PerceptionConfig) -> Mode {
    let evidence = placed::pair(a, b, &c.t_a_b, p);
    let covariance = climb::covariance(a, b, &c.t_a_b, p);
    let log_mass = evidence.log_likelihood + log_gaussian_mass(&covariance);
    let log_odds = log_mass - log_search_volume(a, b);
    Mode { t_a_b: c.t_a_b, covariance, evidence, log_odds, source: c.source }
}

/// What every source proposes for `T_a_b`, unrefined.
pub fn candidates(a: &LocalMap, b: &LocalMap, config: &RegistrationConfig) -> Vec<Candidate> {
    let mut found = of_structures(a, b, config);
    found.extend(correlation::candidates(a, b).into_iter().map(|(_, c)| c));
    found
}

/// What corners and walls propose, which says nothing yet of the rest of the maps.
fn of_structures(a: &LocalMap, b: &LocalMap, config: &RegistrationConfig) -> Vec<Candidate> {
    let mut found = corners::candidates(&a.corners, &b.corners, config);
    found.extend(segments::candidates(&a.lines, &b.lines));
    found
}

/// The best `keep` candidates of which no two are the same pose (paper, section 3: duplicates are one
/// mode).
fn distinct(
    mut scored: Vec<(f64, Candidate)>,
    keep: usize,
    center: Vec2,
    distance: f64,
    angle: f64,
) -> Vec<Candidate> {
    // A stable sort: equals stay in the sources' order, whatever the machine.
    scored.sort_by(|x, y| y.0.total_cmp(&x.0));
    let mut kept: Vec<Candidate> = Vec::with_capacity(keep);
    for (_, c) in scored {
        if !kept.iter().any(|k| k.t_a_b.is_close_at(&c.t_a_b, center, distance, angle)) {
            kept.push(c);
            if kept.len() == keep {
                break;
            }
        }
    }
    kept
}

/// Log of the integral of an unnormalised Gaussian of height one.
pub fn log_gaussian_mass(covariance: &Matrix3<f64>) -> f64 {
    0.5 * (3.0 * TAU.ln() + covariance.determinant().max(f64::MIN_POSITIVE).ln())
}

/// Log of the volume of poses at which two maps can overlap at all: square metres times radians.
pub fn log_search_volume(a: &LocalMap, b: &LocalMap) -> f64 {
    let ((wa, ha), (wb, hb)) = (a.extent(), b.extent());
    ((wa + wb) * (ha + hb) * TAU).ln()
}

/// `T_b_a` modes from `T_a_b` modes.
pub fn inverse(mode: &Mode) -> (Se2, Matrix3<f64>) {
    (mode.t_a_b.inverse(), mode.t_a_b.inverse_covariance(&mode.covariance))
}
