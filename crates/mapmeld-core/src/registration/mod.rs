//! The motion model: registration of a pair of maps by similar structures (paper, section 3).
//!
//! Every source proposes transforms, one file each; what they propose is looked at, climbs and becomes modes in the
//! same way. Corners and pairs of walls are asked where correlation finds too little. A pair's modes depend on no
//! particle: they are computed once.

pub mod climb;
pub mod closed_form;
pub mod coarse_table;
pub mod corners;
pub mod correlation;
pub mod glance;
pub mod pair;
pub mod rotations;
pub mod search;
pub mod segments;
mod shifts;
pub mod stretch;
mod turned;
pub mod wide_table;

use crate::config::PerceptionConfig;
use crate::evidence::Status;
use crate::perception::WallEvidence;
use crate::registration::stretch::Stretch;
use crate::se2::{Se2, Vec2};
use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

/// Where a candidate came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Source {
    /// A pair of similar corners.
    Corners,
    /// A pair of walls that are not parallel, wherever they would meet.
    Segments,
    /// Correlation of oriented walls.
    Correlation,
    /// Modes of the maps that two merged maps consist of.
    Members,
}

impl Source {
    /// Name in results.
    pub fn name(self) -> &'static str {
        match self {
            Source::Corners => "corners",
            Source::Segments => "segments",
            Source::Correlation => "correlation",
            Source::Members => "members",
        }
    }
}

/// A possible motion, as proposed by a source.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// The transform.
    pub t_a_b: Se2,
    /// Who proposed it.
    pub source: Source,
}

/// A possible motion of the virtual robot from map a to map b: a mode of the proposal.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Mode {
    /// The transform at the local maximum of the likelihood.
    pub t_a_b: Se2,
    /// Its covariance, from the curvature there.
    pub covariance: Matrix3<f64>,
    /// What the walls say about it.
    pub evidence: WallEvidence,
    /// Log of the likelihood ratio's mass around it, over the search volume, nats.
    pub log_odds: f64,
    /// Who proposed it first.
    pub source: Source,
}

/// What the registration of a pair found at one degree of bending.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Rung {
    /// Modes, most likely first.
    pub modes: Vec<Mode>,
    /// The best log-likelihood that map a reaches with the mirror image of map b, which it cannot have seen, nats; zero
    /// where that is nothing that matters, none where it was not tried.
    pub decoy: Option<f64>,
    /// How far apart modes lie that tell different stories, see [`apart`].
    pub apart: f64,
}

/// All that the registration of a pair found, before it is known how bent the maps are.
#[derive(Debug, Clone)]
pub struct Registered {
    /// Index of map a.
    pub a: usize,
    /// Index of map b.
    pub b: usize,
    /// Number of candidates that the sources proposed.
    pub candidates: usize,
    /// One for each degree of bending that is tried, finest first.
    pub rungs: Vec<Rung>,
}

impl Rung {
    /// The best log-likelihood that the mirror image is known to reach, nats; zero at least.
    pub fn decoy(&self) -> f64 {
        self.decoy.unwrap_or(0.0)
    }

    /// The modes that tell different stories, each told by its likeliest, most likely first. `center` is the
    /// centre of map b's known cells.
    pub fn stories(&self, center: Vec2) -> Vec<&Mode> {
        let told = stories(self.modes.iter().map(|m| &m.t_a_b), center, self.apart);
        told.into_iter().map(|k| &self.modes[k]).collect()
    }

    /// The log-likelihood that chance and self-similarity reach with these maps: that of the best decoy, or of
    /// the second story, if that is more; never negative.
    pub fn chance(&self, center: Vec2) -> f64 {
        let second = self.stories(center).get(1).map_or(0.0, |m| m.evidence.log_likelihood);
        self.decoy().max(second)
    }
}

/// Which of some poses tell different stories, each told by the first that does: they lie so many metres apart at
/// `center`, the centre of map b's known cells, or are turned.
pub fn stories<'p>(
    poses: impl Iterator<Item = &'p Se2>,
    center: Vec2,
    distance: f64,
) -> Vec<usize> {
    let angle = SAME_WORLD.1;
    let mut told: Vec<(usize, &Se2)> = Vec::new();
    for (k, t) in poses.enumerate() {
        if !told.iter().any(|(_, other)| other.is_close_at(t, center, distance, angle)) {
            told.push((k, t));
        }
    }
    told.into_iter().map(|(k, _)| k).collect()
}

/// All that the registration of a pair found, at the degree of bending that fits the maps.
#[derive(Debug, Clone)]
pub struct PairModes {
    /// Index of map a.
    pub a: usize,
    /// Index of map b.
    pub b: usize,
    /// Number of candidates that the sources proposed.
    pub candidates: usize,
    /// Modes and decoys.
    pub found: Rung,
    /// Whether these two maps alone would be merged.
    pub status: Status,
    /// Probability that the likeliest mode is right; zero without one.
    pub probability: f64,
    /// How many times as large map b would fit best there; of pairs that alone would be merged, once all is placed.
    pub stretch: Option<Stretch>,
}

/// How far apart, metres at the map's centre, rigid poses tell different stories under a model: the walls of bent maps
/// lie right at poses some standard deviations from each other.
pub fn apart(model: &PerceptionConfig) -> f64 {
    SAME_WORLD.0.max(4.0 * model.climb_sigma)
}

/// Worlds in which maps lie closer than this (metres at the map's centre, radians) tell the same story; modes of bent
/// maps may lie further apart, see [`apart`].
pub const SAME_WORLD: (f64, f64) = (0.5, 0.0873);
