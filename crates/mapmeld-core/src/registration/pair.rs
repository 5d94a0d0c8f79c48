//! Registration of one pair of prepared maps: candidates, shortlist, climb, modes.

use crate::config::{Config, EvidenceConfig, PerceptionConfig, RegistrationConfig};
use crate::local_map::LocalMap;
use crate::perception::{placed, rigid, WallEvidence};
use crate::registration::{
    climb::{self, Climb, STILL},
    corners, correlation,
    glance::{Glance, Look},
    segments, stories, Candidate, Mode, Registered, Rung, Source,
};
use crate::se2::{Se2, Vec2};
use crate::verdict::{self, Background};
use nalgebra::Matrix3;
use std::f64::consts::TAU;

/// Samples of each map that the very first look at a candidate takes.
const GLIMPSE_SAMPLES: usize = 16;
/// Samples that a second look takes.
const BRIEF_SAMPLES: usize = 32;
/// Samples that a longer look takes.
const LONGER_SAMPLES: usize = 128;
/// Samples of each map that the first steps uphill follow.
const FIRST_SAMPLES: usize = 80;
/// Samples of each map that a climb follows.
const CLIMB_SAMPLES: usize = 160;
/// Samples of each map that the last climb of a mode follows.
const FINAL_SAMPLES: usize = 400;
/// Steps shorter than this, in cells, end all climbs but the last.
const NEAR: f64 = 0.04;
/// So many different stories are told at least, and so many poses more weighed if they are not, however unlikely.
const LEAST_STORIES: usize = 2;
/// Steps that every candidate that was looked at longest is led uphill.
const FIRST_STEPS: usize = 6;
/// Share of the best log-likelihood that a pose needs to be followed further: what reaches less will not catch up, nor
/// does it make the best any less sure.
const RIVAL: f64 = 0.5;
/// Log-likelihood from which the best is held against the others, nats: below it all are chance's.
const TELLING: f64 = 20.0;
/// Poses that are followed however far they lie behind.
const FOLLOWED: usize = 3;

/// What is spent on one search.
struct Effort {
    /// Candidates that climb to the top.
    shortlist: usize,
    /// Modes that are kept.
    modes: usize,
    /// Rotations at which all shifts are tried.
    rotations: usize,
    /// Whether corners and walls propose poses.
    has_structures: bool,
    /// Log-likelihood that a pose is held against, nats, if the best here has less.
    least: f64,
}

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
        rotations: correlation::ROTATIONS,
        has_structures: true,
        least: 0.0,
    };
    let (candidates, tops) = find_tops(ma, mb, hints, &effort, (&rungs, config));
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
        // The best alone is asked for, and only if it comes near to what it is a decoy of.
        let most = modes.iter().flatten().map(|m| m.evidence.log_likelihood).fold(0.0, f64::max);
        let effort = Effort {
            shortlist: r.decoy_shortlist,
            modes: 2,
            rotations: correlation::ROTATIONS / 2,
            has_structures: false,
            least: 0.5 * most,
        };
        let (_, tops) = find_tops(ma, m, &[], &effort, (&rungs, config));
        let evidence = |(tops, p): (Vec<Candidate>, &PerceptionConfig)| -> Vec<WallEvidence> {
            tops.iter().map(|c| placed::pair(ma, m, &c.t_a_b, p)).collect()
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

/// Number of candidates, and the local maxima that they lead to at each standard deviation of the walls.
fn find_tops(
    ma: &LocalMap,
    mb: &LocalMap,
    hints: &[Se2],
    effort: &Effort,
    (rungs, config): (&[PerceptionConfig], &Config),
) -> (usize, Vec<Vec<Candidate>>) {
    let (Some(_), Some(center)) = (ma.center, mb.center) else {
        return (0, vec![Vec::new(); rungs.len()]);
    };
    let r = &config.registration;
    let Effort { shortlist, modes, .. } = *effort;
    let found = if effort.has_structures { of_structures(ma, mb, r) } else { Vec::new() };
    let correlated = correlation::candidates(ma, mb, effort.rotations);
    let candidates = found.len() + correlated.len() + hints.len();

    let distance =
        r.duplicate_distance.unwrap_or(2.0 * ma.grid.resolution().min(mb.grid.resolution()));
    let distinct = |scored, keep| distinct(scored, keep, center, distance, r.duplicate_angle);
    let glance = Glance::new(ma, mb);
    let finely = |found: &[Candidate], samples: usize, p: &PerceptionConfig| {
        let score = |c: &Candidate| rigid::log_likelihood(ma, mb, &c.t_a_b, samples, p);
        found.iter().map(|c| (score(c), *c)).collect::<Vec<_>>()
    };
    let climbed = |found: &[Candidate], climb: &Climb, p: &PerceptionConfig| {
        let top = |c: &Candidate| Some(Candidate { t_a_b: climb.top(ma, mb, &c.t_a_b, p)?, ..*c });
        found.iter().filter_map(top).collect::<Vec<_>>()
    };
    let rivals = |scored| rivals(scored, effort.least);
    let wide = climb::wide(ma, mb);
    let rigid: Vec<PerceptionConfig> = rungs.iter().map(PerceptionConfig::rigid).collect();

    // Narrowing down: all are looked at briefly, some longer, fewer are led a few steps uphill, the best climb to
    // the top.
    let mut looks: Vec<Look> = found.into_iter().map(|c| glance.at(c)).collect();
    glance.narrow(&mut looks, GLIMPSE_SAMPLES, 30 * shortlist);
    glance.narrow(&mut looks, BRIEF_SAMPLES, 8 * shortlist);
    looks.extend(correlated.into_iter().map(|(_, c)| glance.at(c)));
    glance.narrow(&mut looks, LONGER_SAMPLES, usize::MAX);
    let looks = looks.into_iter().map(|l| (f64::from(l.score), l.candidate)).collect();
    let begun = distinct(looks, 3 * shortlist / 2);
    let first = Climb { samples: FIRST_SAMPLES, steps: FIRST_STEPS, scale: wide, still: NEAR };
    let begun = climbed(&begun, &first, &rigid[rigid.len() / 2]);

    // The finest standard deviation tells sharp maps' poses apart, the widest finds those of bent maps;
    // what either finds is tried at all of them.
    let mut tops: Vec<Candidate> = Vec::new();
    let widest = (rigid.len() > 1).then(|| &rigid[rigid.len() - 1]);
    for p in rigid.first().into_iter().chain(widest) {
        let mut shortlisted = distinct(rivals(finely(&begun, 2 * FIRST_SAMPLES, p)), shortlist / 2);
        shortlisted.extend(hints.iter().map(|t| Candidate { t_a_b: *t, source: Source::Members }));
        let climb =
            Climb { samples: CLIMB_SAMPLES, steps: r.max_iterations, scale: wide, still: NEAR };
        let mut at_top = climbed(&shortlisted, &climb, p);
        at_top.extend(shortlisted);
        tops.extend(distinct(rivals(finely(&at_top, 2 * CLIMB_SAMPLES, p)), modes));
    }
    let at_each = rigid.iter().map(|rigid| {
        let few = distinct(rivals(finely(&tops, FINAL_SAMPLES, rigid)), modes);
        let climb =
            Climb { samples: FINAL_SAMPLES, steps: r.max_iterations, scale: 0.0, still: STILL };
        let mut at_top = climbed(&few, &climb, rigid);
        at_top.extend(few);
        let scored = finely(&at_top, 2 * FINAL_SAMPLES, rigid);
        // What strangers would fit as well is no mode, but some runner-up there must be.
        let (likely, unlikely): (Vec<_>, Vec<_>) = scored.into_iter().partition(|(l, _)| *l > 0.0);
        let mut tops = distinct(rivals(likely), modes);
        if stories(tops.iter().map(|c| &c.t_a_b), center).len() < LEAST_STORIES {
            tops.extend(distinct(unlikely, LEAST_STORIES));
        }
        tops
    });
    (candidates, at_each.collect())
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
    found.extend(correlation::candidates(a, b, correlation::ROTATIONS).into_iter().map(|(_, c)| c));
    found
}

/// What corners and walls propose, which says nothing yet of the rest of the maps.
fn of_structures(a: &LocalMap, b: &LocalMap, config: &RegistrationConfig) -> Vec<Candidate> {
    let mut found = corners::candidates(&a.corners, &b.corners, config);
    found.extend(segments::candidates(&a.lines, &b.lines));
    found
}

/// Those of some poses that may still matter, given what another one reached at least, nats; the best first.
fn rivals(mut scored: Vec<(f64, Candidate)>, least: f64) -> Vec<(f64, Candidate)> {
    scored.sort_by(|x, y| y.0.total_cmp(&x.0));
    let most = scored.first().map_or(least, |(l, _)| least.max(*l));
    if most > TELLING {
        let hopeful = scored.iter().take_while(|(l, _)| *l >= RIVAL * most).count();
        scored.truncate(hopeful.max(FOLLOWED));
    }
    scored
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
