//! Maps at their places, and what groups of them say of each other.

use crate::config::PerceptionConfig;
use crate::local_map::LocalMap;
use crate::perception::bend;
use crate::perception::likelihood::WallEvidence;
use crate::perception::overlay::Overlay;
use crate::probe::Axes;
use crate::se2::Se2;
use crate::vicinity::{Outline, BENT};

/// A map at its place, and those of its wall samples that speak for it; none: all of them.
#[derive(Clone, Copy)]
pub struct Placed<'a> {
    /// The map.
    pub map: &'a LocalMap,
    /// Where it lies.
    pub t_world_map: Se2,
    /// Indices of its wall samples.
    pub samples: Option<&'a [u32]>,
}

impl Placed<'_> {
    /// What it covers.
    pub fn outline(&self) -> Outline {
        Outline::of(&self.map.grid, &self.t_world_map)
    }

    /// False when the grids are too far apart for any wall of one to lie on the other.
    pub fn may_touch(&self, other: &Placed) -> bool {
        self.outline().is_near(&other.outline(), 0.0)
    }

    /// What this map's samples say of the other maps.
    pub fn tally_against(&self, others: &[Placed], config: &PerceptionConfig) -> WallEvidence {
        let outline = self.outline();
        let is_near = |o: &&Placed| o.outline().is_near(&outline, BENT);
        let others: Vec<Placed> = others.iter().filter(is_near).copied().collect();
        let others = others.as_slice();
        if others.is_empty() {
            return WallEvidence::default();
        }
        let count = self.samples.map_or(self.map.samples.len(), <[u32]>::len);
        let step = count.div_ceil(config.max_samples).max(1);
        let mut sum = bend::of_patches(self, others, step, config);
        sum.shared_floor += self.shared_floor(others);
        sum
    }

    /// Open floor of this map that is free in other maps, square metres.
    fn shared_floor(&self, others: &[Placed]) -> f64 {
        let views = others.iter().map(|o| (&o.map.ground, o.map.probe_view(self.axes_in(o))));
        self.map.floor.free_in(&views.collect::<Vec<_>>())
    }

    /// Its grid's axes in those of another.
    pub fn axes_in(&self, other: &Placed) -> Axes {
        let t = other.t_world_map.between(&self.t_world_map);
        Axes::between(&other.map.grid, &self.map.grid, &t)
    }
}

/// Evidence of two groups of placed maps against each other.
pub fn between(a: &[Placed], b: &[Placed], config: &PerceptionConfig) -> WallEvidence {
    let mut sum = WallEvidence::default();
    b.iter().for_each(|p| sum.add(&p.tally_against(a, config), 0.5));
    a.iter().for_each(|p| sum.add(&p.tally_against(b, config), 0.5));
    sum
}

/// Evidence of a local map against a merged map (paper, section 2: z_t given m_{t-1}).
pub fn against(
    maps: &[LocalMap],
    merged: &Overlay,
    map: usize,
    t_world_map: &Se2,
    config: &PerceptionConfig,
) -> WallEvidence {
    let local = Placed { map: &maps[map], t_world_map: *t_world_map, samples: None };
    between(&merged.placed(maps, &Se2::IDENTITY), &[local], config)
}

/// Evidence of a pair of maps for `T_a_b`, from all samples of maps that may be bent.
pub fn pair(a: &LocalMap, b: &LocalMap, t_a_b: &Se2, config: &PerceptionConfig) -> WallEvidence {
    let at = |map, t_world_map| Placed { map, t_world_map, samples: None };
    between(&[at(a, Se2::IDENTITY)], &[at(b, *t_a_b)], config)
}
