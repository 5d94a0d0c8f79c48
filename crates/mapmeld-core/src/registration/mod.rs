//! The motion model: registration of a pair of maps by similar structures (paper, section 3).
//!
//! Every source proposes transforms, one file each; all feed the same shortlist, climb and list of
//! modes. A pair's modes depend on no particle: they are computed once.

pub mod climb;
pub mod closed_form;
pub mod corners;
pub mod correlation;
pub mod pair;
pub mod segments;

use crate::perception::WallEvidence;
use crate::se2::Se2;
use nalgebra::Matrix3;

/// Where a candidate came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// A pair of similar corners.
    Corners,
    /// A pair of walls that are not parallel, wherever they would meet.
    Segments,
    /// Correlation of oriented walls.
    Correlation,
}

impl Source {
    /// Name in results.
    pub fn name(self) -> &'static str {
        match self {
            Source::Corners => "corners",
            Source::Segments => "segments",
            Source::Correlation => "correlation",
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
#[derive(Debug, Clone, PartialEq)]
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

/// All that the registration of a pair found.
#[derive(Debug, Clone)]
pub struct PairModes {
    /// Index of map a.
    pub a: usize,
    /// Index of map b.
    pub b: usize,
    /// Number of candidates that the sources proposed.
    pub candidates: usize,
    /// Modes, most likely first.
    pub modes: Vec<Mode>,
}
