//! Every option, nested by stage, each default written here and nowhere else.
//!
//! Lengths are metres and angles radians. An option of `None` is derived from the resolution of the
//! maps at hand.

mod parse;
mod validate;

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
        /// Most wall points of a map that the filter weighs a pose with; more are thinned evenly.
        max_samples: usize = 800,
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
        min_evidence: f64 = 12.0,
        /// The same between merged maps: much is seen of both, so chance reaches less.
        min_evidence_joined: f64 = 7.5,
        /// What a share of contradicting observations of one would cost, nats.
        conflict_cost: f64 = 150.0,
        /// Share of what chance reaches with these maps (mirror image, runner-up) that is taken off.
        noise_share: f64 = 0.5,
        /// Largest share of walls that are missing where the other map is known.
        max_miss_share: f64 = 0.33,
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
