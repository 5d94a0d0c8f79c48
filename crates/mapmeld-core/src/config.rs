//! Every option, nested by stage, each default written here and nowhere else.
//!
//! Lengths are metres and angles radians. An option of `None` is derived from the resolution of the
//! maps at hand.

use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};

macro_rules! stage {
    ($(#[$doc:meta])* $name:ident { $($(#[$fdoc:meta])* $field:ident : $ty:ty = $default:expr,)* }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields, default)]
        pub struct $name { $($(#[$fdoc])* pub $field: $ty,)* }
        impl Default for $name {
            fn default() -> Self { Self { $($field: $default,)* } }
        }
    };
}

stage! {
    /// Lines and corners of one map (paper, section 5).
    StructureConfig {
        /// Largest distance of a data point from its line, metres; at least 3/4 of a cell.
        line_tolerance: f64 = 0.05,
        /// Largest angle between a data point's normal and its line's, radians.
        line_angle_tolerance: f64 = 0.5,
        /// Shortest line, metres; at least five cells.
        min_line_length: f64 = 0.3,
        /// Farthest that a line may end from the corner it belongs to, metres; at least three cells.
        corner_gap: f64 = 0.25,
        /// Shortest arm of a corner, metres; at least four cells.
        min_arm_length: f64 = 0.3,
        /// Smallest angle between the two lines of a corner, radians.
        min_corner_angle: f64 = 0.5,
    }
}

stage! {
    /// Candidate motions of a pair of maps (paper, section 3).
    RegistrationConfig {
        /// Largest difference of the opening angles of similar corners, radians, beyond three
        /// standard deviations of the fit.
        opening_tolerance: f64 = 0.12,
        /// Most corners of a map that are matched, those with the longest arms first.
        max_corners: usize = 150,
        /// Candidates of a pair that are refined, best first by their walls.
        shortlist: usize = 40,
        /// The same, of the mirror image that shows what chance reaches.
        decoy_shortlist: usize = 16,
        /// Modes kept for a pair.
        max_modes: usize = 12,
        /// Two modes closer than this are one, metres; none: two cells.
        duplicate_distance: Option<f64> = None,
        /// Two modes closer than this are one, radians.
        duplicate_angle: f64 = 0.0175,
        /// How far a wall may lie from its match while a mode is refined, metres.
        reach: f64 = 0.4,
        /// Most refinement steps of a mode.
        max_iterations: usize = 20,
    }
}

/// Which model weighs a pose (paper, section 4, and past it).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PerceptionModel {
    /// Absolute log-likelihood ratio of oriented walls against unrelated maps.
    OrientedWalls,
    /// The paper's Psi~ * gamma~, relative to the pool of candidates.
    PsiGamma,
}

/// Over which classes Psi is summed (paper, section 4).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PsiClasses {
    /// Occupied cells only: open floor does not drown the walls.
    Occupied,
    /// Free and occupied cells, as printed in the paper.
    All,
}

stage! {
    /// The perception model (paper, section 4).
    PerceptionConfig {
        /// What the particle weights use.
        model: PerceptionModel = PerceptionModel::OrientedWalls,
        /// Classes of Psi.
        classes: PsiClasses = PsiClasses::Occupied,
        /// Standard deviation of Psi's and D's kernel, in cells of the map looked up.
        sigma_cells: f64 = 2.0,
        /// Most cells of a class that the filter sums Psi and D over; more are thinned evenly.
        max_cells: usize = 400,
        /// The worst pose's gamma~ before normalisation, as a share of the pool's range.
        gamma_floor: f64 = 0.01,
        /// Distance between the wall points that are compared, metres.
        sample_spacing: f64 = 0.1,
        /// Standard deviation of the distance between the same wall in two maps, metres; at least
        /// one cell.
        wall_sigma: f64 = 0.07,
        /// Length of wall that counts as one independent observation, metres.
        correlation_length: f64 = 0.5,
        /// Log-likelihood ratio of an observation whose wall is found where it should be.
        hit: f64 = 2.0,
        /// The same, of one that has no wall nearby where the other map is known.
        miss: f64 = -0.7,
        /// The same, of one that meets a wall facing the other way.
        opposed: f64 = -0.2,
        /// The same, of one inside the other map's clear free space.
        conflict: f64 = -4.0,
        /// How deep in free space a wall is a conflict, metres; at least three cells.
        conflict_depth: f64 = 0.2,
        /// How deep it is a full one, metres: bent maps and moved furniture are off by less.
        full_conflict_depth: f64 = 0.5,
    }
}

stage! {
    /// The particle filter (paper, sections 2 and 3).
    FilterConfig {
        /// Number of particles.
        particles: usize = 100,
        /// Resample when the effective sample size falls under this share of the particles.
        resample_below: f64 = 0.5,
        /// Candidates of one map that are weighed for one particle, best first by their pairs.
        candidates_per_map: usize = 6,
        /// Maps that are weighed as the next one for a particle, best first by their pairs.
        maps_per_step: usize = 6,
    }
}

stage! {
    /// Verdicts: merged, ambiguous, or not.
    EvidenceConfig {
        /// Least evidence of a merge: the log-likelihood ratio, less what follows, nats.
        min_evidence: f64 = 14.0,
        /// What a share of contradicting observations of one would cost, nats.
        conflict_cost: f64 = 100.0,
        /// Share of what chance reaches with these maps (mirror image, runner-up) that is taken off.
        noise_share: f64 = 0.5,
        /// Worlds less probable than this make a map ambiguous that they place elsewhere.
        ambiguous_above: f64 = 0.2,
    }
}

stage! {
    /// Joint refinement of all poses.
    RefineConfig {
        /// Most iterations.
        max_iterations: usize = 30,
        /// Scale of the Geman-McClure kernel, metres; none: two cells.
        kernel: Option<f64> = None,
    }
}

/// How cells of several maps become one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FuseRule {
    /// Sum of log-odds.
    LogOdds,
    /// The highest occupancy.
    Max,
    /// The last map of the order that knows the cell.
    Latest,
}

stage! {
    /// Fusion of the placed maps into one grid.
    FuseConfig {
        /// Rule for cells that several maps know.
        rule: FuseRule = FuseRule::LogOdds,
        /// Resolution of the merged map, metres; none: the finest of the inputs.
        resolution: Option<f64> = None,
    }
}

stage! {
    /// All options of a merge.
    Config {
        /// Seed of every random draw.
        seed: u64 = 1,
        /// Threads; none: all cores. Results do not depend on it.
        threads: Option<usize> = None,
        /// Lines and corners.
        structure: StructureConfig = Default::default(),
        /// Candidate motions.
        registration: RegistrationConfig = Default::default(),
        /// Perception model.
        perception: PerceptionConfig = Default::default(),
        /// Particle filter.
        filter: FilterConfig = Default::default(),
        /// Verdicts.
        evidence: EvidenceConfig = Default::default(),
        /// Joint refinement.
        refine: RefineConfig = Default::default(),
        /// Fusion.
        fuse: FuseConfig = Default::default(),
    }
}

impl Config {
    /// From JSON; keys that do not exist and values of a wrong type are errors that name them.
    pub fn from_json(text: &str) -> Result<Self> {
        let value: serde_json::Value = serde_json::from_str(text)
            .map_err(|e| Error::Config { key: "(whole)".into(), problem: e.to_string() })?;
        let serde_json::Value::Object(stages) = value else {
            return Err(Error::Config {
                key: "(whole)".into(),
                problem: "must be a mapping of stages to options".into(),
            });
        };
        // Each option is set on its own, so that an error knows the whole path of the key.
        let mut config = serde_json::to_value(Config::default()).expect("defaults serialise");
        for (name, value) in stages {
            set(&mut config, &name, &name, value)?;
        }
        let config: Config = serde_json::from_value(config)
            .map_err(|e| Error::Config { key: "(whole)".into(), problem: e.to_string() })?;
        config.validate()?;
        Ok(config)
    }

    /// All options as JSON.
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).expect("options serialise")
    }

    /// Checks the ranges of all values.
    pub fn validate(&self) -> Result<()> {
        let positive = |key: &str, v: f64| check(key, v.is_finite() && v > 0.0, v, "positive");
        let share =
            |key: &str, v: f64| check(key, (0.0..=1.0).contains(&v), v, "between 0 and 1");
        let angle = |key: &str, v: f64| {
            check(key, v > 0.0 && v < 1.57, v, "an angle in radians between 0 and pi/2")
        };
        let count = |key: &str, v: usize| check(key, v >= 1, v, "at least 1");
        let finite = |key: &str, v: f64| check(key, v.is_finite(), v, "finite");
        let optional = |key: &str, v: Option<f64>| v.map_or(Ok(()), |v| positive(key, v));
        if let Some(n) = self.threads {
            count("threads", n)?;
        }
        // JSON numbers of other tools lose digits beyond this, and the seed must survive the file.
        check("seed", self.seed < 1 << 53, self.seed, "below 2^53")?;
        let s = &self.structure;
        positive("structure.line_tolerance", s.line_tolerance)?;
        angle("structure.line_angle_tolerance", s.line_angle_tolerance)?;
        positive("structure.min_line_length", s.min_line_length)?;
        positive("structure.corner_gap", s.corner_gap)?;
        positive("structure.min_arm_length", s.min_arm_length)?;
        angle("structure.min_corner_angle", s.min_corner_angle)?;
        let r = &self.registration;
        angle("registration.opening_tolerance", r.opening_tolerance)?;
        count("registration.max_corners", r.max_corners)?;
        count("registration.shortlist", r.shortlist)?;
        count("registration.decoy_shortlist", r.decoy_shortlist)?;
        count("registration.max_modes", r.max_modes)?;
        optional("registration.duplicate_distance", r.duplicate_distance)?;
        angle("registration.duplicate_angle", r.duplicate_angle)?;
        positive("registration.reach", r.reach)?;
        count("registration.max_iterations", r.max_iterations)?;
        let p = &self.perception;
        positive("perception.sigma_cells", p.sigma_cells)?;
        count("perception.max_cells", p.max_cells)?;
        share("perception.gamma_floor", p.gamma_floor)?;
        positive("perception.sample_spacing", p.sample_spacing)?;
        positive("perception.wall_sigma", p.wall_sigma)?;
        positive("perception.correlation_length", p.correlation_length)?;
        positive("perception.hit", p.hit)?;
        finite("perception.miss", p.miss)?;
        finite("perception.opposed", p.opposed)?;
        finite("perception.conflict", p.conflict)?;
        positive("perception.conflict_depth", p.conflict_depth)?;
        positive("perception.full_conflict_depth", p.full_conflict_depth)?;
        let f = &self.filter;
        count("filter.particles", f.particles)?;
        share("filter.resample_below", f.resample_below)?;
        count("filter.candidates_per_map", f.candidates_per_map)?;
        count("filter.maps_per_step", f.maps_per_step)?;
        finite("evidence.min_evidence", self.evidence.min_evidence)?;
        finite("evidence.conflict_cost", self.evidence.conflict_cost)?;
        share("evidence.noise_share", self.evidence.noise_share)?;
        share("evidence.ambiguous_above", self.evidence.ambiguous_above)?;
        count("refine.max_iterations", self.refine.max_iterations)?;
        optional("refine.kernel", self.refine.kernel)?;
        optional("fuse.resolution", self.fuse.resolution)
    }
}

fn check(key: &str, ok: bool, value: impl std::fmt::Display, must: &str) -> Result<()> {
    if ok {
        Ok(())
    } else {
        Err(Error::Config { key: key.into(), problem: format!("{value}; must be {must}") })
    }
}

/// Sets one option or one stage of options in a configuration of default values.
fn set(
    config: &mut serde_json::Value,
    path: &str,
    name: &str,
    value: serde_json::Value,
) -> Result<()> {
    let map = config.as_object_mut().expect("stages are mappings");
    if !map.contains_key(name) {
        let known: Vec<&str> = map.keys().map(String::as_str).collect();
        return Err(Error::Config {
            key: path.into(),
            problem: format!("no such option; known here: {}", known.join(", ")),
        });
    }
    if map[name].is_object() {
        let serde_json::Value::Object(options) = value else {
            return Err(Error::Config {
                key: path.into(),
                problem: format!("is a stage: give it options, not {value}"),
            });
        };
        for (k, v) in options {
            set(&mut map[name], &format!("{path}.{k}"), &k, v)?;
        }
        return Ok(());
    }
    let before = std::mem::replace(&mut map[name], value.clone());
    // The whole is parsed again for this one option: a wrong type is then known by its path.
    let mut probe = serde_json::to_value(Config::default()).expect("defaults serialise");
    let mut at = &mut probe;
    for part in path.split('.') {
        at = at.get_mut(part).expect("path exists in the defaults");
    }
    *at = value.clone();
    serde_json::from_value::<Config>(probe).map(|_| ()).map_err(|e| Error::Config {
        key: path.into(),
        problem: format!("{value} does not fit ({e}); the default is {before}"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_trip_and_partial() {
        assert_eq!(Config::from_json(&Config::default().to_json()).unwrap(), Config::default());
        let c = Config::from_json(r#"{"filter": {"particles": 7}, "threads": 2}"#).unwrap();
        assert_eq!((c.filter.particles, c.threads), (7, Some(2)));
        assert_eq!(c.registration, RegistrationConfig::default());
    }

    #[test]
    fn errors_name_the_key() {
        for (json, key) in [
            (r#"{"filtr": {}}"#, "filtr"),
            (r#"{"filter": {"particels": 3}}"#, "filter.particels"),
            (r#"{"filter": {"particles": -3}}"#, "filter.particles"),
            (r#"{"filter": {"particles": "many"}}"#, "filter.particles"),
            (r#"{"filter": {"particles": 0}}"#, "filter.particles"),
            (r#"{"filter": 5}"#, "filter"),
            (r#"{"perception": {"model": "best"}}"#, "perception.model"),
            (r#"{"fuse": {"resolution": -1}}"#, "fuse.resolution"),
            (r#"{"seed": 1e300}"#, "seed"),
        ] {
            match Config::from_json(json) {
                Err(Error::Config { key: k, .. }) => assert_eq!(k, key, "{json}"),
                other => panic!("{json}: {other:?}"),
            }
        }
    }
}
