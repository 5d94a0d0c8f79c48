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
        /// Partners that a map is registered with, those that an index of corners and walls finds the most
        /// promising; none: all other maps up to 40 maps, 18 where there are more. As many as there are maps: all.
        partners: Option<usize> = None,
        /// Candidates of a pair that are refined, best first by their walls.
        shortlist: usize = 28,
        /// The same, of the mirror image that shows what chance reaches.
        decoy_shortlist: usize = 16,
        /// Modes kept for a pair.
        max_modes: usize = 6,
        /// Two modes closer than this are one, metres; none: two cells.
        duplicate_distance: Option<f64> = None,
        /// Two modes closer than this are one, radians.
        duplicate_angle: f64 = 0.0175,
        /// How far a wall may lie from its match while a mode is refined, metres.
        reach: f64 = 0.4,
        /// Most refinement steps of a mode; the last climb, which begins where others ended, takes six at most.
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
        /// Standard deviation of the distance between the same wall in two maps, metres, once they are
        /// unbent; at least one cell.
        wall_sigma: f64 = 0.07,
        /// The same before they are unbent, metres: what leads a pose to its maximum.
        climb_sigma: f64 = 0.07,
        /// Drift of a map, metres per square root of metre of distance.
        bend_shift: f64 = 0.06,
        /// The same of its heading, radians per square root of metre.
        bend_turn: f64 = 0.02,
        /// The same four for maps that are bent more and more; the set of maps decides.
        more_bent: Vec<Bending> = vec![
            Bending { climb_sigma: 0.25, wall_sigma: 0.13, bend_shift: 0.4, bend_turn: 0.1 },
        ],
        /// Length of wall that counts as one independent observation, metres.
        correlation_length: f64 = 0.5,
        /// Log-likelihood ratio of an observation whose wall is found where it should be.
        hit: f64 = 2.0,
        /// The same, of one that has no wall nearby where the other map is known.
        miss: f64 = -0.7,
        /// The same, of one that meets a wall facing the other way.
        opposed: f64 = 0.1,
        /// The same, of one inside the other map's clear free space.
        conflict: f64 = -4.0,
        /// The same, amid a long straight wall: what nobody moves and no clutter hides.
        straight_conflict: f64 = -9.0,
        /// How deep in free space a wall is a conflict, metres; at least three cells.
        conflict_depth: f64 = 0.2,
        /// How deep it is a full one, metres: bent maps and moved furniture are off by less.
        full_conflict_depth: f64 = 0.5,
    }
}

/// How bent and blurred maps may be.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bending {
    /// In the place of [`PerceptionConfig::climb_sigma`].
    pub climb_sigma: f64,
    /// In the place of [`PerceptionConfig::wall_sigma`].
    pub wall_sigma: f64,
    /// In the place of [`PerceptionConfig::bend_shift`].
    pub bend_shift: f64,
    /// In the place of [`PerceptionConfig::bend_turn`].
    pub bend_turn: f64,
}

impl PerceptionConfig {
    /// The model for maps that are laid on each other as they are.
    pub fn rigid(&self) -> PerceptionConfig {
        PerceptionConfig { wall_sigma: self.climb_sigma, ..self.clone() }
    }

    /// The models that are tried, for maps that are bent less and more; each is complete.
    pub fn rungs(&self) -> Vec<PerceptionConfig> {
        let first = PerceptionConfig { more_bent: Vec::new(), ..self.clone() };
        let further = self.more_bent.iter().map(|b| PerceptionConfig {
            climb_sigma: b.climb_sigma,
            wall_sigma: b.wall_sigma,
            bend_shift: b.bend_shift,
            bend_turn: b.bend_turn,
            ..first.clone()
        });
        std::iter::once(first.clone()).chain(further.collect::<Vec<_>>()).collect()
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
        /// Maps that are weighed as the next one for a particle at most, best first by their pairs; by the walls' model it
        /// goes to the first that is sure, without a look at another, else to the surest.
        maps_per_step: usize = 3,
    }
}

stage! {
    /// Verdicts: merged, ambiguous, or not.
    EvidenceConfig {
        /// Least probability of a merge; below it maps stay apart.
        min_probability: f64 = 0.75,
        /// The fitted model of the probability: a constant, then the weight of each feature (see
        /// `verdict::features`).
        weights: [f64; 19] = [
            -8.765, -0.340, -0.458, -0.357, 1.046, -0.513, -1.061, 1.413, 1.083, 1.910,
            -0.386, -2.813, 2.282, -0.887, -3.562, -0.870, 0.819, 0.488, 1.604,
        ],
        /// Log-likelihood ratio at which a pose is at most as probable as not, nats: what the search for it costs.
        even_log_likelihood: f64 = 8.0,
        /// Difference of log-likelihood ratios that makes one of two poses e times as probable, nats.
        temperature: f64 = 2.0,
        /// Poses less probable than this are not followed.
        least_followed: f64 = 0.02,
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
