//! The absolute likelihood of a pose: oriented walls against the null hypothesis.
//!
//! Psi~ * gamma~ ranks poses and cannot say that two maps do not overlap. This model can: it is
//! `log p(walls | this pose) - log p(walls | unrelated maps)`. A wall sample of one map that the
//! other map shows in the same place, facing the same way, speaks for the pose; one that lies in the
//! other's clear free space, or on a wall that faces the other way, speaks against it; one in unknown
//! space says nothing. Samples are weighted so that a straight wall is one piece of evidence and
//! neighbours count once ([`crate::local_map::WallSample::weight`]).

use crate::config::PerceptionConfig;
use crate::grid::Class;
use crate::local_map::{LocalMap, WallSample};
use crate::perception::placed::Placed;
use crate::se2::{Se2, Vec2};
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

/// How one observation fell out.
#[derive(Clone, Copy)]
enum Outcome {
    Hit(f64),
    Miss,
    Opposed,
    /// With its share of a full conflict.
    Conflict(f64),
    Unknown,
}

/// One map that samples of another frame are looked up in.
struct Target<'a> {
    map: &'a LocalMap,
    view: crate::likelihood_field::FieldView<'a>,
    t_map_frame: crate::se2::Rigid,
    noise: Noise,
    config: &'a PerceptionConfig,
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

impl<'a> Target<'a> {
    /// Samples come from `other`: what its cells blur is blurred here too.
    fn new(
        map: &'a LocalMap,
        other: &LocalMap,
        t_map_frame: &Se2,
        config: &'a PerceptionConfig,
    ) -> Self {
        Self {
            map,
            view: map.field_view(t_map_frame),
            t_map_frame: t_map_frame.to_rigid(),
            noise: noise_of(map, other, config),
            config,
        }
    }

    #[inline(always)]
    fn observe(&self, position: Vec2, normal: Vec2) -> Outcome {
        let Some(cell) = self.view.cell(position) else { return Outcome::Unknown };
        let p = self.t_map_frame.apply(position);
        if let Some(k) = self.view.nearest(cell, normal) {
            let r2 = self.residual_squared(p, k);
            if r2 <= self.noise.hit_radius * self.noise.hit_radius {
                return Outcome::Hit(self.config.hit - r2 * self.noise.inv_two_sigma_squared);
            }
        }
        if let Some(k) = self.view.nearest(cell, -normal) {
            if self.residual_squared(p, k) <= 0.25 * self.noise.hit_radius * self.noise.hit_radius {
                return Outcome::Opposed;
            }
        }
        let (row, col) = cell;
        match self.map.grid.class(row, col) {
            Class::Unknown => Outcome::Unknown,
            Class::Free => match self.map.ground.conflict(row * self.map.grid.width() + col) {
                0.0 => Outcome::Miss,
                share => Outcome::Conflict(share.into()),
            },
            Class::Occupied => Outcome::Miss,
        }
    }

    /// Squared distance to a wall point; a cell's length along the wall costs nothing.
    #[inline(always)]
    fn residual_squared(&self, p: Vec2, k: usize) -> f64 {
        let b = &self.map.boundary[k];
        let d = p - b.position;
        let across = d.dot(&b.normal);
        let along = (d.x * b.normal.y - d.y * b.normal.x).abs() - self.noise.slack;
        across * across + along.max(0.0).powi(2)
    }
}

/// Sums the outcomes of samples against targets; where several targets see a sample, each has its
/// share of the word. Directions are summed in one common frame.
fn tally<'s>(
    samples: impl Iterator<Item = &'s WallSample>,
    targets: &[Target],
    t_common_samples: &Se2,
    spacing: f64,
    config: &PerceptionConfig,
) -> WallEvidence {
    let mut sum = WallEvidence::default();
    let to_common = t_common_samples.to_rigid();
    for s in samples {
        // What the targets say of this sample, before it is shared out.
        let (mut value, mut seen) = (0.0, 0.0);
        let (mut hits, mut misses, mut opposed, mut conflicts) = (0.0, 0.0, 0.0, 0.0);
        for t in targets {
            match t.observe(s.position, s.normal) {
                Outcome::Unknown => continue,
                Outcome::Hit(v) => {
                    hits += 1.0;
                    value += v;
                }
                Outcome::Miss => misses += 1.0,
                Outcome::Opposed => opposed += 1.0,
                Outcome::Conflict(share) => conflicts += share,
            }
            seen += 1.0;
        }
        if seen == 0.0 {
            continue;
        }
        let w = s.weight / seen;
        let contradicted = conflicts * s.conflict_weight / seen;
        sum.spread += w * (hits * config.hit - value);
        value += misses * config.miss + opposed * config.opposed;
        let excuse = if s.straight { config.straight_conflict } else { config.conflict };
        sum.log_likelihood += w * value + contradicted * excuse;
        sum.hits += w * hits;
        sum.misses += w * misses;
        sum.opposed += w * opposed;
        sum.conflicts += contradicted;
        if s.straight {
            sum.straight_conflicts += contradicted;
        } else {
            sum.distinct_hits += w * hits;
        }
        if hits > 0.0 {
            let (n, w) = (to_common.rotate(s.normal), w * hits);
            sum.shared_length += spacing * hits / seen;
            sum.directions[0] += w * n.x * n.x;
            sum.directions[1] += w * n.x * n.y;
            sum.directions[2] += w * n.y * n.y;
        }
    }
    sum
}

/// Evidence of a pair of rigid maps for `T_a_b`, from every `stride`-th sample.
pub fn pair(
    a: &LocalMap,
    b: &LocalMap,
    t_a_b: &Se2,
    stride: usize,
    config: &PerceptionConfig,
) -> WallEvidence {
    let mut sum = WallEvidence::default();
    let half = 0.5 * stride as f64;
    let in_a = [Target::new(a, b, t_a_b, config)];
    sum.add(&tally(b.samples.iter().step_by(stride), &in_a, t_a_b, b.spacing, config), half);
    let in_b = [Target::new(b, a, &t_a_b.inverse(), config)];
    sum.add(
        &tally(a.samples.iter().step_by(stride), &in_b, &Se2::IDENTITY, a.spacing, config),
        half,
    );
    sum
}

/// Open floor of a map, were it placed at `t_world_from`, that is free in other maps, square metres.
pub fn shared_floor(
    from: &LocalMap,
    t_world_from: &Se2,
    others: &[Placed],
    config: &PerceptionConfig,
) -> f64 {
    let targets = targets(from, t_world_from, others, config);
    let floor = &from.floor;
    let mut shared = 0.0;
    for p in &floor.centers {
        let (mut free, mut seen) = (0.0, 0.0);
        for t in &targets {
            let Some(cell) = t.view.cell(*p) else { continue };
            match t.map.grid.class(cell.0, cell.1) {
                Class::Free => free += 1.0,
                Class::Occupied => {}
                Class::Unknown => continue,
            }
            seen += 1.0;
        }
        if seen > 0.0 {
            shared += floor.scale * free / seen;
        }
    }
    shared
}

/// What some wall samples of a map say of other maps, were it placed at `t_world_from`.
pub fn one_way<'s>(
    samples: impl Iterator<Item = &'s WallSample>,
    from: &LocalMap,
    t_world_from: &Se2,
    others: &[Placed],
    config: &PerceptionConfig,
) -> WallEvidence {
    tally(samples, &targets(from, t_world_from, others, config), t_world_from, from.spacing, config)
}

fn targets<'a>(
    from: &LocalMap,
    t_world_from: &Se2,
    others: &[Placed<'a>],
    config: &'a PerceptionConfig,
) -> Vec<Target<'a>> {
    let target =
        |o: &Placed<'a>| Target::new(o.map, from, &o.t_world_map.between(t_world_from), config);
    others.iter().map(target).collect()
}
