//! Psi: how well like classes fall on each other (paper, section 4).
//!
//! `Psi(m1, m2)` sums, over the classes and both directions, over the cells p of class c in one map,
//! `exp(-d(p, nearest cell of class c in the other)^2 / (2 sigma^2))`. Unknown counts in neither.

use crate::config::PsiClasses;
use crate::distance::{gaussian_lut, DistanceTable};
use crate::grid::{Class, Locator};
use crate::local_map::LocalMap;
use crate::perception::overlay::Overlay;
use crate::se2::{Se2, Vec2};

/// Distances of a merged map's and a local map's cells to each other's classes, at one pose.
pub struct Comparison<'a> {
    maps: &'a [LocalMap],
    merged: &'a Overlay,
    local: &'a LocalMap,
    t_world_local: Se2,
    kernel: [f64; 256],
}

impl<'a> Comparison<'a> {
    /// Compares a merged map with a local map placed at `t_world_local`; sigma in cells of the map
    /// that a distance is looked up in.
    pub fn new(
        maps: &'a [LocalMap],
        merged: &'a Overlay,
        local: &'a LocalMap,
        t_world_local: Se2,
        sigma_cells: f64,
    ) -> Self {
        Self { maps, merged, local, t_world_local, kernel: gaussian_lut(sigma_cells) }
    }

    /// `sum over cells of class `of` in each map of exp(-d(p, class `to` of the other)^2 / 2 sigma^2)`.
    pub fn kernel_sum(&self, of: Class, to: Class) -> f64 {
        let local_cells = cells_of(self.local, of);
        let lookups: Vec<(&DistanceTable, Locator)> = self
            .merged
            .layers()
            .map(|l| {
                let m = &self.maps[l.map];
                let t_map_local = l.t_world_map.between(&self.t_world_local);
                (table_of(m, to), m.wide().locator_from(&t_map_local))
            })
            .collect();
        // exp is monotone: the nearest of all layers is the largest kernel value.
        let nearest = |p: &Vec2| {
            let mut best = 0.0f64;
            for (table, at) in &lookups {
                if let Some(k) = at.index(*p) {
                    best = best.max(self.kernel[table.squared(k) as usize]);
                }
            }
            best
        };
        let forward: f64 = local_cells.centers.iter().map(nearest).sum::<f64>() * local_cells.scale;
        let table = table_of(self.local, to);
        let at = self.local.wide().locator_from(&self.t_world_local.inverse());
        let backward: f64 = self
            .merged
            .layers()
            .map(|l| {
                let cells = if of == Class::Occupied { &l.new_occupied } else { &l.new_free };
                let sum: f64 = cells
                    .iter()
                    .filter_map(|p| at.index(*p))
                    .map(|k| self.kernel[table.squared(k) as usize])
                    .sum();
                sum * cells_of(&self.maps[l.map], of).scale
            })
            .sum();
        forward + backward
    }
}

fn cells_of(map: &LocalMap, class: Class) -> &crate::local_map::ClassCells {
    &map.class_table(class == Class::Occupied).cells
}

fn table_of(map: &LocalMap, class: Class) -> &DistanceTable {
    &map.class_table(class == Class::Occupied).distance
}

/// Psi of a comparison.
pub fn psi(comparison: &Comparison, classes: PsiClasses) -> f64 {
    let occupied = comparison.kernel_sum(Class::Occupied, Class::Occupied);
    match classes {
        PsiClasses::Occupied => occupied,
        PsiClasses::All => occupied + comparison.kernel_sum(Class::Free, Class::Free),
    }
}
