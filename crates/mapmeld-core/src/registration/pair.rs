//! Registration of one pair of prepared maps: its modes, and what chance reaches.

use crate::config::{Config, PerceptionConfig};
use crate::local_map::LocalMap;
use crate::perception::placed;
use crate::registration::{
    self, climb, correlation,
    glance::Glance,
    search::{self, Effort, Found},
    Candidate, Mode, Registered, Rung,
};
use crate::se2::Se2;
use crate::verdict::{self, Background, NEGLIGIBLE};
use nalgebra::Matrix3;
use std::f64::consts::TAU;

/// How the mirror image is looked for: what its best pose reaches matters, and not where that is.
const OF_DECOYS: correlation::Effort =
    correlation::Effort { promising: 4, further: 0, steps: 1.0, peaks: 40 };
/// Share of how a mode that has proven itself looks: what the mirror image looks less like is negligible, too.
const LEAST_LOOK: f64 = 0.2;

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
        correlation: correlation::THOROUGH,
        has_structures: true,
        least: vec![f64::NEG_INFINITY; rungs.len()],
        least_look: f64::NEG_INFINITY,
    };
    let Found { candidates, tops } = search::tops(ma, mb, hints, &effort, config);
    // The best of the first stories tell whether any may stand.
    let center = mb.center.unwrap_or_default();
    let mut modes: Vec<Vec<Mode>> = Vec::new();
    let mut others: Vec<Vec<Candidate>> = Vec::new();
    for (tops, p) in tops.into_iter().zip(&rungs) {
        let apart = registration::apart(p);
        let told = registration::stories(tops.iter().map(|c| &c.t_a_b), center, apart);
        let is_first = |k: &usize| told.iter().take(effort.stories).any(|told| told == k);
        let (first, rest): (Vec<usize>, Vec<usize>) = (0..tops.len()).partition(is_first);
        modes.push(first.into_iter().map(|k| mode(ma, mb, tops[k], p)).collect());
        others.push(rest.into_iter().map(|k| tops[k]).collect());
    }
    // What does not stand with nothing held against it need not be held against the mirror image, nor against others
    // that do not stand. Known poses may lift what walls alone do not.
    let may_stand = !hints.is_empty() || may_stand([ma, mb], &modes, config);
    for ((modes, others), p) in modes.iter_mut().zip(others).zip(&rungs) {
        modes.extend(others.into_iter().filter(|_| may_stand).map(|c| mode(ma, mb, c, p)));
        modes.sort_by(|x, y| y.evidence.log_likelihood.total_cmp(&x.evidence.log_likelihood));
    }
    let decoys = mirrored_b.filter(|_| may_stand).map(|m| decoys(ma, mb, m, &modes, config));
    let decoys = decoys.unwrap_or_else(|| vec![None; rungs.len()]);
    let rung = |((modes, decoy), p): ((Vec<Mode>, Option<f64>), &PerceptionConfig)| Rung {
        modes,
        decoy,
        apart: registration::apart(p),
    };
    let rungs = modes.into_iter().zip(decoys).zip(&rungs).map(rung).collect();
    Registered { a, b, candidates, rungs }
}

/// The best log-likelihood that the mirror image of map b reaches on a, nats, at each standard deviation of the walls:
/// looked for only as far as it matters beside the modes that it is a decoy of.
fn decoys(
    a: &LocalMap,
    b: &LocalMap,
    mirrored_b: &LocalMap,
    modes: &[Vec<Mode>],
    config: &Config,
) -> Vec<Option<f64>> {
    let glance = Glance::new(a, b);
    let proven = modes.iter().filter_map(|modes| modes.first());
    let proven = proven.filter(|m| m.evidence.log_likelihood >= search::PROVEN);
    // What is bent may lie right and look like nothing.
    let looks = proven.map(|m| f64::from(glance.score(&m.t_a_b))).filter(|look| *look > 0.0);
    let most =
        |modes: &Vec<Mode>| modes.first().map_or(0.0, |m| m.evidence.log_likelihood.max(0.0));
    let effort = Effort {
        shortlist: config.registration.decoy_shortlist,
        modes: 1,
        stories: 1,
        correlation: OF_DECOYS,
        has_structures: false,
        least: modes.iter().map(|m| NEGLIGIBLE * most(m)).collect(),
        least_look: looks.reduce(f64::min).map_or(f64::NEG_INFINITY, |look| LEAST_LOOK * look),
    };
    let tops = search::tops(a, mirrored_b, &[], &effort, config).tops;
    let best = |(tops, p): (Vec<Candidate>, PerceptionConfig)| {
        let reached = tops.iter().map(|t| placed::pair(a, mirrored_b, &t.t_a_b, &p).log_likelihood);
        Some(reached.fold(0.0, f64::max))
    };
    tops.into_iter().zip(config.perception.rungs()).map(best).collect()
}

/// Whether any mode would be followed if neither the mirror image nor another mode spoke against it.
fn may_stand(maps: [&LocalMap; 2], modes: &[Vec<Mode>], config: &Config) -> bool {
    let c = &config.evidence;
    modes.iter().zip(config.perception.rungs()).enumerate().any(|(rung, (modes, model))| {
        let alone = Background::new(maps.into_iter(), (rung, &model), 0.0);
        let stands =
            |m: &Mode| verdict::probability(&m.evidence, 0.0, &alone, c) >= c.least_followed;
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
