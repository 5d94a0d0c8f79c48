//! What the walls of a map say next to those that are placed.

use super::{VirtualRobot, NOISE};
use crate::forbidden::{self, Member};
use crate::perception::overlay::Layer;
use crate::perception::placed::{self, Placed};
use crate::perception::{ceiling, Overlay, WallEvidence};
use crate::registration::climb;
use crate::se2::Se2;
use crate::vicinity::{Outline, BENT, SLACK};

/// Poses that the walls cannot lift above this, nats, are worth no closer look.
const HOPELESS: f64 = -20.0;

/// From more maps than this on, particles share what they weigh.
const MANY: usize = 40;

impl VirtualRobot<'_> {
    /// What the walls say of a map against the merged map. The walls of merged maps are those of the
    /// maps they are merged of, which no raster has blurred: the pose is led to their maximum first. None where they
    /// cannot speak for the pose.
    pub(super) fn look(&self, merged: &Overlay, map: usize, x: Se2) -> Option<(Se2, WallEvidence)> {
        // Layers far away have nothing to say.
        let outline = Outline::of(&self.maps[map].grid, &x);
        // Merged maps climb to their place first.
        let slack = if self.parts.is_some() { SLACK } else { BENT };
        let near: Vec<&Layer> = merged.near(&outline, slack).collect();
        if self.is_large() && self.parts.is_none() {
            let center = self.maps[map].center.unwrap_or_default();
            let is_close = |a: &Se2, b: &Se2| a.is_close_at(b, center, NOISE.0, NOISE.1);
            let placed: Vec<(usize, Se2)> = near.iter().map(|l| (l.map, l.t_world_map)).collect();
            let look = || self.look_at(merged, &near, map, x).map(|(_, evidence)| evidence);
            let evidence = self.memory.similar((map, &x), &placed, is_close, look);
            return evidence.map(|evidence| (x, evidence));
        }
        let at = near.iter().map(|l| std::ptr::from_ref(*l) as usize).collect();
        self.memory.look((map, &x), (merged, at), || self.look_at(merged, &near, map, x))
    }

    /// Whether there are so many maps that particles cannot each weigh all of them anew.
    pub(super) fn is_large(&self) -> bool {
        self.maps.len() > MANY
    }

    fn look_at(
        &self,
        merged: &Overlay,
        near: &[&Layer],
        map: usize,
        x: Se2,
    ) -> Option<(Se2, WallEvidence)> {
        let p = &self.config.perception;
        let Some(parts) = &self.parts else {
            let is_evidence = |l: &&&Layer| !self.known.is_forbidden(l.map, map);
            let near: Vec<&Layer> = near.iter().filter(is_evidence).copied().collect();
            let placed: Vec<Placed> = near.iter().map(|l| l.placed(self.maps)).collect();
            let local = [Placed { map: &self.maps[map], t_world_map: x, samples: None }];
            // The first word is had for little, and does not refuse for what only this map shows.
            if ceiling::of(&local[0], &placed, p) < HOPELESS
                && ceiling::between(&placed, &local, p) < HOPELESS
            {
                return None;
            }
            let mut sum = WallEvidence::default();
            sum.add(&local[0].tally_against(&placed, p), 0.5);
            for (layer, placed) in near.iter().zip(&placed) {
                // Of all that is placed only the last is new.
                let asked = (*layer, || merged.up_to(layer));
                let word = self.memory.word(asked, (map, &x), || placed.tally_against(&local, p));
                sum.add(&word, 0.5);
            }
            return Some((x, sum));
        };
        let of = |map: usize, x: &Se2| forbidden::members(&parts.overlays[map], parts.maps, x);
        let outlines: Vec<Outline> = of(map, &x).iter().map(|(_, o)| o.outline()).collect();
        let is_near = |o: &Member| {
            let there = o.1.outline();
            outlines.iter().any(|own| own.is_near(&there, SLACK))
        };
        let placed = near.iter().flat_map(|l| of(l.map, &l.t_world_map)).filter(is_near).collect();
        let (placed, own) = forbidden::evidence(placed, of(map, &Se2::IDENTITY), parts.known);
        let moved_to = |x: &Se2| -> Vec<Placed> {
            own.iter().map(|m| Placed { t_world_map: x.compose(&m.t_world_map), ..*m }).collect()
        };
        if ceiling::between(&placed, &moved_to(&x), p) < HOPELESS {
            return None;
        }
        let most = self.config.registration.max_iterations;
        let x = climb::climb_group(&placed, &own, &x, most, p).unwrap_or(x);
        Some((x, placed::between(&placed, &moved_to(&x), p)))
    }

    /// Whether a pose puts two maps where their walls match best although that match is wrong.
    pub(super) fn is_refused(&self, merged: &Overlay, map: usize, x: &Se2) -> bool {
        let placed = || merged.layers().map(|l| (l.map, l.t_world_map));
        match &self.parts {
            None if self.known.forbidden.is_empty() => false,
            Some(parts) if parts.known.forbidden.is_empty() => false,
            None => {
                let below: Vec<_> = placed().collect();
                forbidden::is_refused(&below, &[(map, *x)], self.pairs, self.maps)
            }
            Some(parts) => {
                let of = |(map, x): (usize, Se2)| {
                    let layers = parts.overlays[map].layers();
                    layers.map(move |l| (l.map, x.compose(&l.t_world_map)))
                };
                let (below, own): (Vec<_>, Vec<_>) =
                    (placed().flat_map(of).collect(), of((map, *x)).collect());
                forbidden::is_refused(&below, &own, parts.pairs, parts.maps)
            }
        }
    }
}
