//! How probable it is that a pose is right: a logistic model of what the walls and the floor say.
//!
//! The log-likelihood ratio ranks poses; how much of it chance reaches depends on the maps. The model weighs it
//! against what the mirror image and the best other pose reach, and against what a true pose of these maps would
//! show: few walls in clear free space, a good share of the walls, much floor in common. It is fitted on
//! simulated and recorded buildings and checked on buildings left out (`benchmarks/calibrate.py`).

use crate::config::{Config, EvidenceConfig, PerceptionConfig};
use crate::evidence::Status;
use crate::local_map::LocalMap;
use crate::perception::WallEvidence;
use crate::registration::{PairModes, Registered, SAME_WORLD};
use std::f64::consts::SQRT_2;

/// Number of features, without the constant.
pub const FEATURES: usize = 18;

/// Share of a pose's log-likelihood that chance may reach without making it less sure: so little is not looked for
/// with care.
pub const NEGLIGIBLE: f64 = 0.2;

/// Smear of walls that counts one, metres, and the most that it counts: between one and three
/// times the first, the most made no difference to buildings left out.
const SMEAR: (f64, f64) = (0.04, 1.5);

/// Share of opposed walls, and a little more, below which it tells nothing: who builds thick walls has none that are
/// seen from both sides.
const FEW_OPPOSED: f64 = 0.1;

/// Maps among which chance is asked no more often than the fitted model expects.
const FEW: usize = 32;

impl EvidenceConfig {
    /// The same among so many maps: each is held against more strangers, some of which look alike by chance, so less
    /// doubt is allowed. Where two large parts meet, one such pair would put all of one in the wrong place.
    pub fn among(&self, maps: usize) -> Self {
        let share = FEW as f64 / maps.max(FEW) as f64;
        Self { min_probability: 1.0 - (1.0 - self.min_probability) * share, ..self.clone() }
    }
}

/// How much less doubt is allowed where one answer places all maps of a part.
const BRIDGE: f64 = 0.25;

impl EvidenceConfig {
    /// The same for parts of so many maps in all, many: nothing holds a bridge but itself, long walls of large parts add
    /// up wherever corridors are alike, and a wrong one puts all maps of a part in the wrong place.
    pub fn of_bridges(&self, maps: usize) -> Self {
        let share = if maps > FEW { BRIDGE } else { 1.0 };
        Self { min_probability: 1.0 - (1.0 - self.min_probability) * share, ..self.clone() }
    }
}

/// What a pose's evidence is held against: facts of the maps, not of the pose.
#[derive(Debug, Clone, Copy)]
pub struct Background {
    /// Length of wall that the larger of the maps shows, metres.
    pub walls: f64,
    /// Share of the walls that is long and straight, in the map that has less of it, in [0, 1].
    pub straight: f64,
    /// How much deeper walls are drawn than sharp ones are, in the map where they are less so, metres: who draws a wall in
    /// many places draws it in wrong ones, so where much is distinct, what contradicts weighs less.
    pub smear: f64,
    /// Open floor of a map for each metre of its walls, every side counted, in the map that has more of it, metres.
    pub openness: f64,
    /// Which degree of bending the maps are weighed at, 0 the finest.
    pub rung: usize,
    /// How far a wall lies from the same wall in another map, one standard deviation, metres.
    pub sigma: f64,
    /// The best log-likelihood ratio that a mirror image reaches, nats.
    pub decoy: f64,
    /// Pairs of members of two merged maps: the walls of all add up, and any of them may agree by chance. 1 for maps.
    pub pairs: usize,
}

impl Background {
    /// Of some maps that are laid on each other, at a degree of bending: its index and its model.
    pub fn new<'m>(
        maps: impl Iterator<Item = &'m LocalMap>,
        (rung, model): (usize, &PerceptionConfig),
        decoy: f64,
    ) -> Self {
        let (smear, openness, sigma) = (f64::MAX, 0.0, model.climb_sigma);
        let none =
            Self { walls: 0.0, straight: 1.0, smear, openness, rung, sigma, decoy, pairs: 1 };
        maps.fold(none, |of, m| Self {
            sigma: of.sigma.max(m.grid.resolution()),
            walls: of.walls.max(m.wall_length),
            straight: of.straight.min(m.straight_share),
            smear: of.smear.min(m.smear),
            openness: of.openness.max(m.openness()),
            ..of
        })
    }

    /// Of these maps and some others.
    pub fn with(&self, others: &Background) -> Self {
        Self {
            walls: self.walls.max(others.walls),
            straight: self.straight.min(others.straight),
            smear: self.smear.min(others.smear),
            openness: self.openness.max(others.openness),
            sigma: self.sigma.max(others.sigma),
            decoy: self.decoy.max(others.decoy),
            ..*self
        }
    }
}

/// The features, in the order of [`EvidenceConfig::weights`] after the constant. `chance` is the best
/// log-likelihood ratio, nats, that the mirror image or a less likely pose reaches with these maps; it counts for
/// [`NEGLIGIBLE`] of the pose's own at least.
pub fn features(e: &WallEvidence, chance: f64, of: &Background) -> [f64; FEATURES] {
    // A few agreeing observations are taken for granted, so that a small overlap does not turn one stray
    // cell into a large share.
    let share = |part: f64| part / (part + e.hits + 5.0);
    let cover = (e.shared_length + 1.0).ln() - of.walls.max(1.0).ln();
    let smear = (of.smear / SMEAR.0).min(SMEAR.1);
    let most = e.log_likelihood.max(0.0);
    let chance = chance.max(NEGLIGIBLE * most);
    // Walls laid on the backs of others share no floor; who sees walls together sees the floor before them.
    let floor_of_walls = e.shared_length * of.openness;
    [
        most.sqrt(),
        chance.sqrt(),
        e.shared_length / (e.shared_floor + 1.0),
        // Its square: the less there is, the more the rest of it tells.
        (share(e.conflicts) + 0.03).ln().powi(2),
        (share(e.straight_conflicts) + 0.02).ln(),
        cover,
        e.distinct_hits.ln_1p(),
        e.shared_floor.ln_1p(),
        // What breaks the straightness is what makes a place unique.
        e.distinct_hits.ln_1p() - e.hits.ln_1p(),
        // Bending fits anything to straight walls: it counts against them.
        of.rung as f64 * of.straight,
        (e.spread / e.hits.max(1e-9)).min(3.0),
        // Panels as thin as a cell are seen from both sides.
        (share(e.opposed) + 0.03).max(FEW_OPPOSED).ln(),
        cover * cover,
        // Bending that costs most of what it gains.
        e.bending / (most + 5.0),
        smear,
        smear * e.distinct_hits.ln_1p(),
        // In long corridors chance reaches much; what matters there is what the rest adds.
        (most - chance).max(0.0).sqrt(),
        e.shared_floor.ln_1p() - floor_of_walls.ln_1p(),
    ]
}

/// Probability that a pose is right, in (0, 1): that of the fitted model, and no more than the walls alone make it. Where
/// little is seen, the model is asked for more than it was fitted to. Where any of several pairs of maps may agree by chance,
/// the odds of the walls alone are as many times less.
pub fn probability(
    e: &WallEvidence,
    chance: f64,
    background: &Background,
    config: &EvidenceConfig,
) -> f64 {
    let [constant, weights @ ..] = &config.weights;
    let features = features(e, chance, background);
    let sum: f64 = features.iter().zip(weights).map(|(f, w)| f * w).sum();
    let walls = (e.log_likelihood - config.even_log_likelihood) / config.temperature
        - (background.pairs.max(1) as f64).ln();
    1.0 / (1.0 + (-(constant + sum).min(walls)).exp())
}

/// Probability that walls hold a pose where it is, along the axis that they hold least: in a bare corridor it may lie
/// anywhere.
fn held(e: &WallEvidence, background: &Background) -> f64 {
    let slide = background.sigma / e.second_direction().max(1e-12).sqrt();
    libm::erf(SAME_WORLD.0 / (SQRT_2 * slide))
}

/// The verdict on two maps alone, at one of the degrees of bending.
pub fn of_pair(found: Registered, rung: usize, maps: [&LocalMap; 2], config: &Config) -> PairModes {
    let (model, config) = (&config.perception.rungs()[rung], &config.evidence);
    let Registered { a, b, candidates, mut rungs } = found;
    let found = rungs.swap_remove(rung);
    let background = Background::new(maps.into_iter(), (rung, model), found.decoy());
    let stories = found.stories(maps[1].center.unwrap_or_default());
    let poses: Vec<&WallEvidence> = stories.iter().map(|m| &m.evidence).collect();
    let verdict = weigh(&poses, &background, config);
    let probability = verdict.probabilities.first().copied().unwrap_or(0.0);
    let status = match verdict.is_carried {
        true if probability >= config.min_probability => Status::Merged,
        true => Status::Ambiguous,
        false => Status::NoEvidence,
    };
    PairModes { a, b, candidates, found, status, probability, stretch: None }
}

/// What is said of the poses at which one map may lie.
#[derive(Debug, Clone)]
pub struct Verdict {
    /// Probability that each pose is right.
    pub probabilities: Vec<f64>,
    /// Whether the map lies at one of them for sure, whichever that is.
    pub is_carried: bool,
}

/// Weighs poses that exclude each other, the likeliest first. Each is held against those below it and the mirror
/// image: the first that stands carries the map, wherever it lies. The first of all is no more probable than it
/// stands against the others, nor than its share of their likelihoods, nor than the walls hold it along each axis; the
/// others follow in proportion. What is lacking to one is for it to lie elsewhere.
pub fn weigh(poses: &[&WallEvidence], of: &Background, config: &EvidenceConfig) -> Verdict {
    let likelihoods: Vec<f64> = poses.iter().map(|e| e.log_likelihood).collect();
    let standing = |k: usize| {
        let chance = likelihoods.get(k + 1).copied().unwrap_or(0.0).max(of.decoy);
        probability(poses[k], chance, of, config)
    };
    let standing: Vec<f64> = (0..poses.len()).map(standing).collect();
    let carried = standing.iter().copied().fold(0.0, f64::max);
    let Some(most) = likelihoods.first() else {
        return Verdict { probabilities: Vec::new(), is_carried: false };
    };
    // The ratios count correlated observations as if they were independent: the temperature makes up for that.
    let odds: Vec<f64> =
        likelihoods.iter().map(|l| ((l - most) / config.temperature).exp()).collect();
    let first = standing[0].min(carried / odds.iter().sum::<f64>()).min(held(poses[0], of));
    Verdict {
        probabilities: odds.into_iter().map(|o| first * o).collect(),
        is_carried: carried >= config.min_probability,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_maps_allow_less_doubt() {
        let least = |maps| EvidenceConfig::default().among(maps).min_probability;
        let few = EvidenceConfig::default().min_probability;
        assert_eq!([least(0), least(2), least(32)], [few; 3]);
        assert!((1.0 - least(320) - 0.1 * (1.0 - few)).abs() < 1e-12);
        let bridge = |maps| EvidenceConfig::default().of_bridges(maps).min_probability;
        assert_eq!(bridge(32), few);
        assert!((1.0 - bridge(33) - 0.25 * (1.0 - few)).abs() < 1e-12);
    }
}
