//! The absolute likelihood of a pose: oriented walls against the null hypothesis.
//!
//! Psi~ * gamma~ ranks poses and cannot say that two maps do not overlap. This model can: it is
//! `log p(walls | this pose) - log p(walls | unrelated maps)`. A wall sample of one map that the
//! other map shows in the same place, facing the same way, speaks for the pose; one that lies in the
//! other's clear free space, or on a wall that faces the other way, speaks against it; one in unknown
//! space says nothing. Samples are weighted so that a straight wall is one piece of evidence and
//! neighbours count once ([`crate::local_map::WallSample::weight`]).

use crate::blocks::{Block, LANES};
use crate::config::PerceptionConfig;
use crate::likelihood_field::ProbeView;
use crate::local_map::LocalMap;
use crate::perception::placed::Placed;
use crate::probe::Axes;
use crate::se2::Se2;
use serde::{Deserialize, Serialize};

/// What the walls say about a pose. Weights count independent observations, summed over both
/// directions and halved.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct WallEvidence {
    /// Log-likelihood ratio against unrelated maps, nats.
    pub log_likelihood: f64,
    /// Observations whose wall is where it should be.
    pub hits: f64,
    /// How far the walls of the hits lie apart: half the squared distances, in variances, summed.
    pub spread: f64,
    /// Observations without a wall nearby.
    pub misses: f64,
    /// Observations on a wall that faces the other way.
    pub opposed: f64,
    /// Observations in clear free space.
    pub conflicts: f64,
    /// Those of the conflicts that lie amid long straight walls.
    pub straight_conflicts: f64,
    /// Those of the hits that break the straightness: ends, corners, clutter.
    pub distinct_hits: f64,
    /// What bending the maps until their walls meet costs, nats; the log-likelihood has paid it.
    pub bending: f64,
    /// Open floor of one that is free in the other, square metres.
    pub shared_floor: f64,
    /// Length of the walls found where they should be, metres.
    pub shared_length: f64,
    /// Sum of `w n n^T` over the hits, as (xx, xy, yy), in the other map's frame: its smaller
    /// eigenvalue is what is left when the walls of the main direction are taken away.
    pub directions: [f64; 3],
}

impl WallEvidence {
    /// Adds another's observations, each counting `share`.
    pub fn add(&mut self, other: &WallEvidence, share: f64) {
        self.log_likelihood += share * other.log_likelihood;
        self.hits += share * other.hits;
        self.spread += share * other.spread;
        self.misses += share * other.misses;
        self.opposed += share * other.opposed;
        self.conflicts += share * other.conflicts;
        self.straight_conflicts += share * other.straight_conflicts;
        self.distinct_hits += share * other.distinct_hits;
        self.bending += share * other.bending;
        self.shared_floor += share * other.shared_floor;
        self.shared_length += share * other.shared_length;
        for k in 0..3 {
            self.directions[k] += share * other.directions[k];
        }
    }

    /// Share of the observations made in known space that agree, in [0, 1].
    pub fn agreement(&self) -> f64 {
        let seen = self.hits + self.misses + self.opposed + self.conflicts;
        if seen > 0.0 {
            self.hits / seen
        } else {
            0.0
        }
    }

    /// Evidence in the second direction: the smaller eigenvalue of [`WallEvidence::directions`].
    pub fn second_direction(&self) -> f64 {
        let [xx, xy, yy] = self.directions;
        0.5 * (xx + yy - ((xx - yy).powi(2) + 4.0 * xy * xy).sqrt()).max(0.0)
    }
}

/// How far a wall may lie from the same wall in another map, metres.
pub(crate) struct Noise {
    pub inv_two_sigma_squared: f64,
    /// Where the Gaussian has fallen to the level of a miss.
    pub hit_radius: f64,
    /// Along the wall this costs nothing.
    pub slack: f64,
}

/// Of two maps: what the cells of either blur is blurred.
pub(crate) fn noise_of(a: &LocalMap, b: &LocalMap, config: &PerceptionConfig) -> Noise {
    let resolution = a.grid.resolution().max(b.grid.resolution());
    let sigma = config.wall_sigma.max(resolution);
    Noise {
        inv_two_sigma_squared: 0.5 / (sigma * sigma),
        hit_radius: sigma * (2.0 * (config.hit - config.miss)).max(0.0).sqrt(),
        slack: resolution,
    }
}

/// One map that samples of another one are looked up in.
struct Target<'a> {
    map: &'a LocalMap,
    view: ProbeView<'a>,
    /// Turns vectors of the map's axes into the frame that directions are summed in.
    to_common: Axes,
    /// Squared distance up to which a wall is in place.
    radius: f32,
    inv_two_sigma_squared: f32,
    slack: f32,
}

impl<'a> Target<'a> {
    /// Samples come from `other`, whose axes lie at `axes`: what its cells blur is blurred here too.
    fn new(
        map: &'a LocalMap,
        other: &LocalMap,
        axes: Axes,
        t_common_map: &Se2,
        config: &PerceptionConfig,
    ) -> Self {
        let noise = noise_of(map, other, config);
        Self {
            map,
            view: map.probe_view(axes),
            to_common: Axes::new(&t_common_map.compose(&map.grid.origin())),
            radius: (noise.hit_radius * noise.hit_radius) as f32,
            inv_two_sigma_squared: noise.inv_two_sigma_squared as f32,
            slack: noise.slack as f32,
        }
    }
}

/// What targets say of the samples of a block, lane by lane, before it is shared out.
#[derive(Default)]
struct Said {
    /// Targets that know anything.
    seen: [f32; LANES],
    hits: [f32; LANES],
    misses: [f32; LANES],
    opposed: [f32; LANES],
    /// Each with its share of a full conflict.
    conflicts: [f32; LANES],
    /// How far the walls of the hits lie apart, see [`WallEvidence::spread`].
    spread: [f32; LANES],
    /// Sum of `n n^T` over the hits, as (xx, xy, yy).
    directions: [[f32; LANES]; 3],
}

impl Said {
    #[inline(always)]
    fn add(&mut self, t: &Target, block: &Block) {
        let seen = t.view.see(block);
        let (with, against) = (t.view.walls(&seen, 0), t.view.walls(&seen, 1));
        let (nearest, facing) = (with.squared(&seen, t.slack), against.squared(&seen, t.slack));
        let (conflicts, misses) = t.map.ground.conflicts_and_misses(&seen.cell);
        for (k, (conflict, miss)) in conflicts.into_iter().zip(misses).enumerate() {
            let hit = f32::from(u8::from(nearest[k] <= t.radius));
            let opposed = (1.0 - hit) * f32::from(u8::from(facing[k] <= 0.25 * t.radius));
            let (nx, ny) = t.to_common.rotate(with.nx[k], with.ny[k]);
            let neither = 1.0 - hit - opposed;
            self.hits[k] += hit;
            self.opposed[k] += opposed;
            self.misses[k] += neither * miss;
            self.conflicts[k] += neither * conflict;
            let is_known = f32::from(u8::from(conflict + miss > 0.0));
            self.seen[k] += hit + opposed + neither * is_known;
            let squared = if nearest[k] <= t.radius { nearest[k] } else { 0.0 };
            self.spread[k] += squared * t.inv_two_sigma_squared;
            self.directions[0][k] += hit * nx * nx;
            self.directions[1][k] += hit * nx * ny;
            self.directions[2][k] += hit * ny * ny;
        }
    }
}

/// Sums what targets say of samples; where several targets see a sample, each has its share of the word.
#[multiversion::multiversion(targets("x86_64+avx2"))]
fn tally(
    blocks: &[Block],
    targets: &[Target],
    spacing: f64,
    config: &PerceptionConfig,
) -> WallEvidence {
    let mut sums = [[0.0f32; LANES]; 11];
    for block in blocks {
        let mut said = Said::default();
        targets.iter().for_each(|t| said.add(t, block));
        for k in 0..LANES {
            let share = if said.seen[k] > 0.0 { 1.0 / said.seen[k] } else { 0.0 };
            let w = block.weight[k] * share;
            let contradicted = said.conflicts[k] * block.conflict_weight[k] * share;
            let straight = f32::from(u8::from(block.straight[k]));
            let all = [
                w * said.hits[k],
                w * said.spread[k],
                w * said.misses[k],
                w * said.opposed[k],
                contradicted,
                straight * contradicted,
                (1.0 - straight) * w * said.hits[k],
                share * said.hits[k],
                w * said.directions[0][k],
                w * said.directions[1][k],
                w * said.directions[2][k],
            ];
            sums.iter_mut().zip(all).for_each(|(sum, v)| sum[k] += v);
        }
    }
    let [hits, spread, misses, opposed, conflicts, straight, distinct, found, xx, xy, yy] =
        sums.map(|lanes| lanes.into_iter().map(f64::from).sum::<f64>());
    let agreed = hits * config.hit - spread + misses * config.miss + opposed * config.opposed;
    let against = (conflicts - straight) * config.conflict + straight * config.straight_conflict;
    WallEvidence {
        log_likelihood: agreed + against,
        hits,
        spread,
        misses,
        opposed,
        conflicts,
        straight_conflicts: straight,
        distinct_hits: distinct,
        shared_length: spacing * found,
        directions: [xx, xy, yy],
        ..WallEvidence::default()
    }
}

/// Evidence of a pair of rigid maps for `T_a_b`, from so many samples of each, see [`crate::blocks::Blocks::first`].
pub fn pair(
    a: &LocalMap,
    b: &LocalMap,
    t_a_b: &Se2,
    samples: usize,
    config: &PerceptionConfig,
) -> WallEvidence {
    let axes = Axes::between(&a.grid, &b.grid, t_a_b);
    let in_a = [Target::new(a, b, axes, &Se2::IDENTITY, config)];
    let in_b = [Target::new(b, a, axes.inverse(), t_a_b, config)];
    let mut sum = WallEvidence::default();
    for (from, targets) in [(b, in_a), (a, in_b)] {
        let said = tally(from.blocks.first(samples), &targets, from.spacing, config);
        sum.add(&said, 0.5 * from.blocks.share(samples));
    }
    sum
}

/// What some wall samples of a map say of other maps, were it placed at `t_world_from`.
pub fn one_way(
    samples: &[Block],
    from: &LocalMap,
    t_world_from: &Se2,
    others: &[Placed],
    config: &PerceptionConfig,
) -> WallEvidence {
    let targets = others.iter().map(|o| {
        let t_o_from = o.t_world_map.between(t_world_from);
        let axes = Axes::between(&o.map.grid, &from.grid, &t_o_from);
        Target::new(o.map, from, axes, &o.t_world_map, config)
    });
    tally(samples, &targets.collect::<Vec<_>>(), from.spacing, config)
}
