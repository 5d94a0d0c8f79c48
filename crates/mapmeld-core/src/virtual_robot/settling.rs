//! What settles the noise of draws while the robot travels: the joint refinement, and particles that tell the same.

use super::{VirtualRobot, NOISE};
use crate::perception::overlay::Layer;
use crate::perception::Overlay;
use crate::prior;
use crate::refine;
use crate::registration::SAME_WORLD;
use crate::se2::Se2;
use std::collections::HashMap;

/// Of many maps, from so many that are placed on, those that are placed are refined...
const SETTLED_FROM: usize = 12;
/// ... whenever there are so many times more of them.
const SETTLED_EVERY: f64 = 1.25;

impl VirtualRobot<'_> {
    /// Whether so many more maps are placed than when they were refined last that they are refined anew.
    pub(super) fn is_due_to_settle(&self, merged: &Overlay) -> bool {
        let times = |n: usize| ((n as f64).ln() / SETTLED_EVERY.ln()) as usize;
        let n = merged.layers().count();
        self.is_large() && self.parts.is_none() && n >= SETTLED_FROM && times(n) > times(n - 1)
    }

    /// The same maps, refined together.
    pub(super) fn settle(&self, merged: &Overlay) -> Overlay {
        let mut layers: Vec<&Layer> = merged.layers().collect();
        layers.reverse();
        let (members, poses): (Vec<usize>, Vec<Se2>) =
            layers.iter().map(|l| (l.map, l.t_world_map)).unzip();
        let held = prior::held(&members, &self.known.priors);
        let enough = (refine::SETTLED, self.config);
        let (poses, _) = refine::poses(self.maps, &members, &poses, &held, self.known, enough);
        self.memory.forget_words();
        let placed = layers.iter().zip(poses);
        placed.fold(Overlay::default(), |below, (l, x)| self.fold(&below, l.map, x, l.probability))
    }

    /// Particles that tell the same story, in whatever order, differ by the noise of their draws alone. The
    /// joint refinement settles that; it is not worth weighing every map anew for each of them.
    pub(super) fn is_same_story(&self, a: &Overlay, b: &Overlay) -> bool {
        if a.is_same(b) || a.layers().count() != b.layers().count() {
            return a.is_same(b);
        }
        let is_close = |x: &Layer, y: &Layer| {
            let center = self.maps[x.map].center.unwrap_or_default();
            // Of a thousand maps one is always drawn a little farther off: what counts is that the world is the same.
            let (distance, angle) = if self.is_large() { SAME_WORLD } else { NOISE };
            x.t_world_map.is_close_at(&y.t_world_map, center, distance, angle)
        };
        // Most particles place the same maps one after the other.
        for (x, y) in a.layers().zip(b.layers()) {
            if std::ptr::eq(x, y) {
                return true;
            }
            if x.map != y.map {
                let there: HashMap<usize, &Layer> = b.layers().map(|l| (l.map, l)).collect();
                return a.layers().all(|x| there.get(&x.map).is_some_and(|y| is_close(x, y)));
            }
            if !is_close(x, y) {
                return false;
            }
        }
        true
    }
}
