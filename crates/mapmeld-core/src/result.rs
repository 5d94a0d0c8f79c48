//! What a merge takes beside maps, and what it gives.

use crate::error::Result;
use crate::evidence::{Hypothesis, Status};
use crate::filter::Step;
use crate::fuse::Fused;
use crate::prior::Prior;
use crate::registration::PairModes;
use crate::relation::Relation;
use crate::se2::Se2;
use nalgebra::Matrix3;

/// What the caller knows beside the maps.
#[derive(Debug, Clone, Default)]
pub struct Known {
    /// The order in which the maps connect (indices; maps left out come after, in any order).
    pub order: Option<Vec<usize>>,
    /// Maps whose frames are those of their components; of several in one component, the first.
    pub references: Vec<usize>,
    /// What is known of each map's pose in one world; empty when nothing is. Components with such maps are one, in
    /// that world, and no reference lends it its frame.
    pub priors: Vec<Option<Prior>>,
    /// Where two maps lie to each other, as far as it is known.
    pub relations: Vec<Relation>,
    /// Pairs whose match is wrong, whatever their walls say: these walls are no evidence of how the two lie to each
    /// other, and nothing places the two where they match best.
    pub forbidden: Vec<(usize, usize)>,
}

impl Known {
    /// Whether the match of two maps is wrong.
    pub fn is_forbidden(&self, a: usize, b: usize) -> bool {
        self.forbidden.iter().any(|(x, y)| (*x, *y) == (a, b) || (*x, *y) == (b, a))
    }

    /// Whether anything is known of where a map lies.
    pub fn is_told(&self, map: usize) -> bool {
        self.priors.get(map).is_some_and(Option::is_some)
            || self.relations.iter().any(|r| r.a == map || r.b == map)
    }
}

/// Where a map ended up.
#[derive(Debug, Clone)]
pub struct Placement {
    /// Component, from 0 (the largest); none for a blank map.
    pub component: Option<usize>,
    /// `T_component_map`; none for a blank map.
    pub t_component_map: Option<Se2>,
    /// Covariance of the pose relative to the component's reference map; in a world that priors give, of the pose
    /// there.
    pub covariance: Matrix3<f64>,
    /// In what standing.
    pub status: Status,
    /// Probability that the map lies where `t_component_map` says, given the hypotheses.
    pub probability: f64,
}

/// The trajectory of the virtual robot through one component, and how the filter fared.
#[derive(Debug, Clone)]
pub struct Component {
    /// The map whose frame is the component's.
    pub reference: usize,
    /// Whether the frame is the priors' world instead.
    pub in_world: bool,
    /// Maps in the order in which the most probable particles merged them.
    pub order: Vec<usize>,
    /// The filter's steps.
    pub steps: Vec<Step>,
    /// Root mean square of the walls' residuals after the joint refinement, metres.
    pub rms: Option<f64>,
    /// The merged map, or why it cannot be drawn: pins may lie too far apart.
    pub fused: Result<Fused>,
}

/// All that a merge found.
#[derive(Debug, Clone)]
pub struct Merge {
    /// One a map, in the order given.
    pub placements: Vec<Placement>,
    /// Components, those of most maps first.
    pub components: Vec<Component>,
    /// Probability that all of these placements are right.
    pub probability: f64,
    /// Whole worlds that fit, most probable first.
    pub hypotheses: Vec<Hypothesis>,
    /// Registration of the pairs that were worth it: all of a few maps.
    pub pairs: Vec<PairModes>,
    /// How many of them had to be registered, rather than being known from an earlier merge.
    pub registered_pairs: usize,
    /// Seconds by stage.
    pub seconds: Vec<(&'static str, f64)>,
}

/// Stages of a merge, as an observer hears of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Classes, boundary, lines, corners and tables of each map.
    Prepare,
    /// Registration of each pair.
    Register,
    /// Steps of the filter.
    Filter,
    /// Travel among the merged maps.
    Join,
    /// Fusion of each component.
    Fuse,
}

impl Stage {
    /// Name in results.
    pub fn name(self) -> &'static str {
        match self {
            Stage::Prepare => "prepare",
            Stage::Register => "register",
            Stage::Filter => "filter",
            Stage::Join => "join",
            Stage::Fuse => "fuse",
        }
    }
}

/// Hears (stage, done, total) and answers whether to go on.
pub type Observer<'a> = &'a (dyn Fn(Stage, usize, usize) -> bool + Sync);
