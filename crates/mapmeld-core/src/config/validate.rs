//! The range of every option.

use crate::config::Config;
use crate::error::{Error, Result};

/// Largest number of anything that is counted: beyond it lie memory and patience, not quality.
const MAX_COUNT: usize = 100_000;

impl Config {
    /// Checks the ranges of all values.
    pub fn validate(&self) -> Result<()> {
        let positive = |key: &str, v: f64| check(key, v.is_finite() && v > 0.0, v, "positive");
        let share = |key: &str, v: f64| check(key, (0.0..=1.0).contains(&v), v, "between 0 and 1");
        let angle = |key: &str, v: f64| {
            check(key, v > 0.0 && v < 1.57, v, "an angle in radians between 0 and pi/2")
        };
        let count = |key: &str, v: usize| {
            check(key, (1..=MAX_COUNT).contains(&v), v, "between 1 and 100000")
        };
        let cost =
            |key: &str, v: f64| check(key, (-1000.0..=0.0).contains(&v), v, "between -1000 and 0");
        let finite = |key: &str, v: f64| check(key, v.is_finite(), v, "finite");
        let optional = |key: &str, v: Option<f64>| v.map_or(Ok(()), |v| positive(key, v));
        if let Some(n) = self.threads {
            check("threads", (1..=1024).contains(&n), n, "between 1 and 1024")?;
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
        if let Some(partners) = r.partners {
            count("registration.partners", partners)?;
        }
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
        count("perception.max_samples", p.max_samples)?;
        for p in p.rungs() {
            positive("perception.climb_sigma", p.climb_sigma)?;
            positive("perception.wall_sigma", p.wall_sigma)?;
            positive("perception.bend_shift", p.bend_shift)?;
            positive("perception.bend_turn", p.bend_turn)?;
        }
        positive("perception.correlation_length", p.correlation_length)?;
        positive("perception.hit", p.hit)?;
        cost("perception.miss", p.miss)?;
        finite("perception.opposed", p.opposed)?;
        cost("perception.conflict", p.conflict)?;
        cost("perception.straight_conflict", p.straight_conflict)?;
        positive("perception.conflict_depth", p.conflict_depth)?;
        positive("perception.full_conflict_depth", p.full_conflict_depth)?;
        let f = &self.filter;
        count("filter.particles", f.particles)?;
        share("filter.resample_below", f.resample_below)?;
        count("filter.candidates_per_map", f.candidates_per_map)?;
        count("filter.maps_per_step", f.maps_per_step)?;
        share("evidence.min_probability", self.evidence.min_probability)?;
        share("evidence.least_followed", self.evidence.least_followed)?;
        positive("evidence.temperature", self.evidence.temperature)?;
        finite("evidence.even_log_likelihood", self.evidence.even_log_likelihood)?;
        for w in &self.evidence.weights {
            finite("evidence.weights", *w)?;
        }
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
