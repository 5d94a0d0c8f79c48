//! The merged map m_t as the filter carries it: placed local maps, shared between particles.
//!
//! A particle's map is the list of the maps placed so far. Successors share their ancestors' part
//! (an ancestry tree), so folding a map in copies nothing. Its cells of a class are the union of the
//! placed maps' cells of that class; each layer keeps which of its own cells are new.

use crate::blocks::LANES;
use crate::grid::Locator;
use crate::local_map::LocalMap;
use crate::perception::placed::Placed;
use crate::probe::{axes_of, Axes};
use crate::se2::{Se2, Vec2};
use crate::vicinity::Outline;
use std::sync::{Arc, OnceLock};

/// One placed map and what lies below it.
#[derive(Debug)]
pub struct Layer {
    /// Index of the local map.
    pub map: usize,
    /// Its pose: the virtual robot's x_t.
    pub t_world_map: Se2,
    /// What it covers, in the world.
    pub outline: Outline,
    /// Probability that the map lies at one of the places that were followed when this one was, given the layers
    /// below.
    pub probability: f64,
    /// Occupied cells that no layer below has, world coordinates.
    pub new_occupied: Vec<Vec2>,
    /// Free cells that no layer below has, world coordinates.
    pub new_free: Vec<Vec2>,
    /// See [`Layer::new_samples`].
    new_samples: OnceLock<Vec<u32>>,
    below: Overlay,
}

impl Layer {
    /// The map with its new samples, in its place.
    pub fn placed<'a>(&'a self, maps: &'a [LocalMap]) -> Placed<'a> {
        let samples = Some(self.new_samples(maps));
        Placed { map: &maps[self.map], t_world_map: self.t_world_map, samples }
    }

    /// Indices of the map's wall samples that no layer below shows, worked out when they are first asked for: most
    /// particles have no successor that asks.
    pub fn new_samples(&self, maps: &[LocalMap]) -> &[u32] {
        self.new_samples.get_or_init(|| {
            let below: Vec<&Layer> = self.below.near(&self.outline, 0.0).collect();
            let is_shown = shown(maps, &maps[self.map], &self.t_world_map, &below);
            (0..is_shown.len() as u32).filter(|k| !is_shown[*k as usize]).collect()
        })
    }
}

/// A merged map: the empty one, or a layer on top of another merged map. Cheap to clone.
#[derive(Debug, Clone, Default)]
pub struct Overlay(Option<Arc<Layer>>);

impl Overlay {
    /// The layers, last placed first.
    pub fn layers(&self) -> impl Iterator<Item = &Layer> {
        std::iter::successors(self.0.as_deref(), |layer| layer.below.0.as_deref())
    }

    /// Those of the layers that lie no farther than `slack`, metres, from what a map covers, last placed first.
    pub fn near<'a>(&'a self, outline: &'a Outline, slack: f64) -> impl Iterator<Item = &'a Layer> {
        self.layers().filter(move |l| l.outline.is_near(outline, slack))
    }

    /// This merged map up to one of its layers, without what lies on top of that; empty when it has no such layer.
    pub fn up_to(&self, layer: &Layer) -> Overlay {
        let mut top = self;
        while let Some(here) = top.0.as_deref() {
            if std::ptr::eq(here, layer) {
                return top.clone();
            }
            top = &here.below;
        }
        debug_assert!(false, "no layer of this merged map");
        Overlay::default()
    }

    /// True when both are the same merged map, by identity.
    pub fn is_same(&self, other: &Overlay) -> bool {
        match (&self.0, &other.0) {
            (Some(a), Some(b)) => Arc::ptr_eq(a, b),
            (None, None) => true,
            _ => false,
        }
    }

    /// The layers as placed maps with their new samples, in a frame given by `t_frame_world`.
    pub fn placed<'a>(&'a self, maps: &'a [LocalMap], t_frame_world: &Se2) -> Vec<Placed<'a>> {
        self.layers()
            .map(|l| Placed {
                map: &maps[l.map],
                t_world_map: t_frame_world.compose(&l.t_world_map),
                samples: Some(l.new_samples(maps)),
            })
            .collect()
    }

    /// Folds a local map in at a pose, one of those at which it lies with some probability. With `cells` the new
    /// cells of each class are worked out, which Psi and gamma need.
    pub fn with(
        &self,
        maps: &[LocalMap],
        map: usize,
        t_world_map: Se2,
        probability: f64,
        cells: bool,
    ) -> Overlay {
        let m = &maps[map];
        let outline = Outline::of(&m.grid, &t_world_map);
        let near = self.near(&outline, 0.0).filter(|_| cells);
        let below: Vec<(&LocalMap, Locator)> = near
            .map(|l| {
                let below = &maps[l.map];
                (below, below.wide().locator_from(&l.t_world_map.inverse()))
            })
            .collect();
        let new_cells = |occupied: bool| -> Vec<Vec2> {
            if !cells {
                return Vec::new();
            }
            let centers = &m.class_table(occupied).cells.centers;
            let is_there = |p: &Vec2| {
                below.iter().any(|(b, at)| {
                    let table = &b.class_table(occupied).distance;
                    at.index(*p).is_some_and(|k| table.squared(k) == 0)
                })
            };
            centers.iter().map(|c| t_world_map.apply(*c)).filter(|p| !is_there(p)).collect()
        };
        Overlay(Some(Arc::new(Layer {
            map,
            t_world_map,
            outline,
            probability,
            new_occupied: new_cells(true),
            new_free: new_cells(false),
            new_samples: OnceLock::new(),
            below: self.clone(),
        })))
    }
}

/// Of each wall sample of a map at its place whether a layer shows it.
fn shown(maps: &[LocalMap], m: &LocalMap, t_world_map: &Se2, layers: &[&Layer]) -> Vec<bool> {
    let mut is_shown = vec![false; m.samples.len()];
    for layer in layers {
        let below = &maps[layer.map];
        let t = axes_of(&below.grid, &m.grid, &layer.t_world_map.between(t_world_map));
        let to_axes = t.compose(&m.grid.origin().inverse()).to_rigid();
        let view = below.probe_view(Axes::new(&t));
        for patch in m.patches.iter().filter(|p| below.reaches(to_axes.apply(p.center), p.radius)) {
            for (block, samples) in patch.blocks.iter().zip(patch.samples.chunks(LANES)) {
                if samples.iter().all(|k| is_shown[*k as usize]) {
                    continue;
                }
                let walls = view.walls(&view.see(block), 0);
                for (lane, k) in samples.iter().enumerate() {
                    is_shown[*k as usize] |= walls.is_there(lane);
                }
            }
        }
    }
    is_shown
}
