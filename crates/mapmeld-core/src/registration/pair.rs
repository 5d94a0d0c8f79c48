//! Registration of one pair of prepared maps: candidates, shortlist, climb, modes.

use crate::config::{Config, RegistrationConfig};
use crate::local_map::LocalMap;
use crate::perception::likelihood;
use crate::registration::{
    climb, corners, correlation, segments, Candidate, Mode, PairModes, Source,
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
/// u_t), and what the mirror image of b reaches, which is what chance and self-similarity reach. `hints` are
/// transforms that are worth a climb whatever the sources say.
pub fn register(
    ma: &LocalMap,
    mb: &LocalMap,
    mirrored_b: Option<&LocalMap>,
    hints: &[Se2],
    (a, b): (usize, usize),
    config: &Config,
) -> PairModes {
    let (candidates, modes) = find_modes(ma, mb, hints, config.registration.shortlist, config);
    let decoys = mirrored_b.map_or_else(Vec::new, |m| {
        find_modes(ma, m, &[], config.registration.decoy_shortlist, config).1
    });
    let decoys = decoys.into_iter().map(|m| m.evidence).collect();
    PairModes { a, b, candidates, modes, decoys }
}

/// Number of candidates, and the modes that they lead to.
fn find_modes(
    ma: &LocalMap,
    mb: &LocalMap,
    hints: &[Se2],
    shortlist: usize,
    config: &Config,
) -> (usize, Vec<Mode>) {
    let (Some(_), Some(center)) = (ma.center, mb.center) else { return (0, Vec::new()) };
    let r = &config.registration;
    let p = &config.perception;
    let found = candidates(ma, mb, r);
    let candidates = found.len() + hints.len();

    let distance =
        r.duplicate_distance.unwrap_or(2.0 * ma.grid.resolution().min(mb.grid.resolution()));
    let stride = |samples: usize| (mb.samples.len() / samples).max(1);
    let distinct = |scored, keep| distinct(scored, keep, center, distance, r.duplicate_angle);
    let look = |found: Vec<Candidate>, samples: usize| -> Vec<(f64, Candidate)> {
        let stride = stride(samples);
        found.into_iter().map(|c| (likelihood::glance(ma, mb, &c.t_a_b, stride), c)).collect()
    };
    let climb_all =
        |found: Vec<Candidate>, samples: usize, steps: usize| -> Vec<(f64, Candidate)> {
            found
                .into_iter()
                .filter_map(|c| {
                    let t_a_b = climb::climb(ma, mb, &c.t_a_b, stride(samples), steps, p)?;
                    let evidence = likelihood::pair(ma, mb, &t_a_b, stride(4 * samples), p);
                    Some((evidence.log_likelihood, Candidate { t_a_b, ..c }))
                })
                .collect()
        };
    // Narrowing down: all blinked at, many looked at, fewer led a few steps uphill, the best climbed to
    // the top.
    let mut blinked = look(found, BLINK_SAMPLES);
    blinked.sort_by(|x, y| y.0.total_cmp(&x.0));
    blinked.truncate(40 * shortlist);
    let blinked = blinked.into_iter().map(|(_, c)| c).collect();
    let glanced = distinct(look(blinked, GLANCE_SAMPLES), 4 * shortlist);
    let mut shortlisted = distinct(climb_all(glanced, GLANCE_SAMPLES, FIRST_STEPS), shortlist);
    shortlisted.extend(hints.iter().map(|t| Candidate { t_a_b: *t, source: Source::Members }));
    let kept = distinct(climb_all(shortlisted, CLIMB_SAMPLES, r.max_iterations), r.max_modes);

    let log_volume = log_search_volume(ma, mb);
    let mut modes: Vec<Mode> = kept
        .into_iter()
        .map(|c| {
            let t_a_b = climb::climb(ma, mb, &c.t_a_b, stride(FINAL_SAMPLES), r.max_iterations, p)
                .unwrap_or(c.t_a_b);
            let evidence = likelihood::pair(ma, mb, &t_a_b, 1, p);
            let covariance = climb::covariance(ma, mb, &t_a_b, p);
            let log_odds = evidence.log_likelihood + log_gaussian_mass(&covariance) - log_volume;
            Mode { t_a_b, covariance, evidence, log_odds, source: c.source }
        })
        .collect();
    modes.sort_by(|x, y| y.evidence.log_likelihood.total_cmp(&x.evidence.log_likelihood));
    (candidates, modes)
}

/// What every source proposes for `T_a_b`, unrefined.
pub fn candidates(a: &LocalMap, b: &LocalMap, config: &RegistrationConfig) -> Vec<Candidate> {
    let mut found = corners::candidates(&a.corners, &b.corners, config);
    found.extend(segments::candidates(&a.lines, &b.lines));
    found.extend(correlation::candidates(a, b));
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
