//! Registration of one pair of prepared maps: its modes, and what chance reaches.

use crate::config::{Config, EvidenceConfig, PerceptionConfig};
use crate::local_map::LocalMap;
use crate::perception::{placed, WallEvidence};
use crate::registration::{
    climb, correlation,
    search::{self, Effort, Found},
    Candidate, Mode, Registered, Rung,
};
use crate::se2::Se2;
use crate::verdict::{self, Background, NEGLIGIBLE};
use nalgebra::Matrix3;
use std::f64::consts::TAU;

/// Registers a pair: the modes of `T_a_b`, most likely first (paper, section 3: the possible motions
/// u_t), and what the mirror image of b reaches, which is what chance and self-similarity reach; both at each
/// standard deviation of the walls that is tried. The mirror image is not tried where no mode can stand. `hints` are
/// transforms that are worth a climb whatever the sources say.
pub fn register(
    ma: &LocalMap,
    mb: &LocalMap,
    mirrored_b: Option<&LocalMap>,
    hints: &[Se2],
    (a, b): (usize, usize),
    config: &Config,
) -> Registered {
    let r = &config.registration;
    let rungs = config.perception.rungs();
    let effort = Effort {
        shortlist: r.shortlist,
        modes: r.max_modes,
        stories: 2,
        rotations: correlation::ROTATIONS,
        has_structures: true,
        least: f64::NEG_INFINITY,
    };
    let Found { candidates, tops } = search::tops(ma, mb, hints, &effort, config);
    let modes = tops.into_iter().zip(&rungs).map(|(tops, p)| {
        let mut modes: Vec<Mode> = tops.into_iter().map(|c| mode(ma, mb, c, p)).collect();
        modes.sort_by(|x, y| y.evidence.log_likelihood.total_cmp(&x.evidence.log_likelihood));
        modes
    });
    let modes: Vec<Vec<Mode>> = modes.collect();
    // What does not stand with nothing held against it need not be held against the mirror image. Known poses
    // may lift what walls alone do not.
    let may_stand = !hints.is_empty() || may_stand([ma, mb], &modes, &config.evidence);
    let decoys = mirrored_b.filter(|_| may_stand).map(|m| {
        // The best alone is asked for, and only if it matters beside what it is a decoy of.
        let most = modes.iter().flatten().map(|m| m.evidence.log_likelihood).fold(0.0, f64::max);
        let effort = Effort {
            shortlist: r.decoy_shortlist,
            modes: 1,
            stories: 1,
            rotations: correlation::ROTATIONS / 2,
            has_structures: false,
            least: NEGLIGIBLE * most,
        };
        let tops = search::tops(ma, m, &[], &effort, config).tops;
        let evidence = |(t, p): (Vec<Candidate>, &PerceptionConfig)| {
            t.iter().map(|t| placed::pair(ma, m, &t.t_a_b, p)).collect::<Vec<WallEvidence>>()
        };
        tops.into_iter().zip(&rungs).map(evidence).collect()
    });
    let decoys = decoys.unwrap_or_else(|| vec![Vec::new(); rungs.len()]);
    let rungs =
        modes.into_iter().zip(decoys).map(|(modes, decoys)| Rung { modes, decoys }).collect();
    Registered { a, b, candidates, rungs }
}

/// Whether any mode would be followed if neither the mirror image nor another mode spoke against it.
fn may_stand(maps: [&LocalMap; 2], modes: &[Vec<Mode>], config: &EvidenceConfig) -> bool {
    modes.iter().enumerate().any(|(rung, modes)| {
        let alone = Background::new(maps.into_iter(), rung, 0.0);
        let stands = |m: &Mode| {
            verdict::probability(&m.evidence, 0.0, &alone, config) >= config.least_followed
        };
        modes.iter().any(stands)
    })
}

/// A pose with what the walls say about it.
fn mode(a: &LocalMap, b: &LocalMap, c: Candidate, p: &PerceptionConfig) -> Mode {
    let evidence = placed::pair(a, b, &c.t_a_b, p);
    let covariance = climb::covariance(a, b, &c.t_a_b, p);
    let log_mass = evidence.log_likelihood + log_gaussian_mass(&covariance);
    let log_odds = log_mass - log_search_volume(a, b);
    Mode { t_a_b: c.t_a_b, covariance, evidence, log_odds, source: c.source }
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
