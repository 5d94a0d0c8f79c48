//! Open floor: where a robot could stand, whoever looks.

use crate::blocks::{self, Block, LANES};
use crate::grid::OccupancyGrid;
use crate::ground::Ground;
use crate::likelihood_field::ProbeView;
use crate::probe::Probe;

/// How far open floor lies from the nearest wall or unknown cell, metres.
const CLEAR: f64 = 0.2;
/// Most points that stand for a map's open floor.
const MAX_FLOOR: usize = 400;

/// The free cells of a map that lie clear of every wall and of the unknown, thinned to a few points.
#[derive(Debug, Clone)]
pub struct Floor {
    points: Vec<Block>,
    /// What each point stands for, square metres.
    area: f64,
    /// All of it, square metres.
    pub total: f64,
}

impl Floor {
    /// Of a map.
    pub fn new(grid: &OccupancyGrid, ground: &Ground) -> Self {
        let cell = grid.resolution();
        let clear = (CLEAR / cell).max(2.0).powi(2).min(250.0) as u8;
        let w = grid.width();
        let open_in = |row: usize| ground.deep(row * w..(row + 1) * w, clear);
        let in_row: Vec<usize> = (0..grid.height()).map(|row| open_in(row).count()).collect();
        let all: usize = in_row.iter().sum();
        let kept = all.min(MAX_FLOOR);
        let (mut points, mut before) = (Vec::with_capacity(kept), 0);
        for (row, open) in in_row.into_iter().enumerate() {
            // The k-th that is kept is number k * all / kept of all.
            let wanted = |k: usize| (k * all / kept).checked_sub(before).filter(|n| *n < open);
            let mut cols = open_in(row).enumerate();
            while let Some(n) = (points.len() < kept).then(|| wanted(points.len())).flatten() {
                let (_, col) = cols.find(|(at, _)| *at == n).expect("as many as were counted");
                let middle = |k: usize| ((k as f64 + 0.5) * cell) as f32;
                points.push(Probe { x: middle(col), y: middle(row), ..Probe::default() });
            }
            before += open;
        }
        let total = all as f64 * cell * cell;
        let area = if kept == 0 { 0.0 } else { total / kept as f64 };
        Self { points: blocks::of(&points), area, total }
    }

    /// That of the mirror image of a grid so many metres wide.
    pub fn mirrored(&self, width: f64) -> Self {
        let mirror =
            |block: &Block| Block { x: block.x.map(|x| width as f32 - x), ..block.clone() };
        Self { points: self.points.iter().map(mirror).collect(), ..*self }
    }

    /// How much of it is free in other maps, square metres: where several know a point, each has its share of the word.
    pub fn free_in(&self, others: &[(&Ground, ProbeView)]) -> f64 {
        self.area * f64::from(free_of(&self.points, others))
    }
}

/// How many of some points are free.
#[multiversion::multiversion(targets("x86_64+avx2"))]
fn free_of(points: &[Block], others: &[(&Ground, ProbeView)]) -> f32 {
    let mut shared = 0.0f32;
    for block in points {
        let (mut free, mut known) = ([0.0f32; LANES], [0.0f32; LANES]);
        for (ground, view) in others {
            for (k, cell) in view.see(block).cell.into_iter().enumerate() {
                let cell = cell as usize;
                free[k] += f32::from(u8::from(ground.depth_squared(cell) > 0));
                known[k] += f32::from(u8::from(!ground.is_unknown(cell)));
            }
        }
        shared += (0..LANES).map(|k| free[k] / known[k].max(1.0)).sum::<f32>();
    }
    shared
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use crate::grid::UNKNOWN;
    use crate::local_map::LocalMap;
    use crate::probe::Axes;
    use crate::se2::Se2;

    /// A room of 6 x 4 m, in cells of 0.1 m, whose left third nobody has seen.
    fn room() -> LocalMap {
        let (w, h) = (60, 40);
        let cell = |k: usize| match (k / w, k % w) {
            (_, col) if col < 20 => UNKNOWN,
            (0 | 39, _) | (_, 59) => 100,
            _ => 0,
        };
        let origin = Se2::new(-7.0, 3.0, 0.4);
        let grid = OccupancyGrid::new("g", w, h, 0.1, origin, (0..w * h).map(cell).collect());
        LocalMap::new(grid.unwrap(), &Config::default())
    }

    #[test]
    fn open_floor_is_free_where_the_other_map_is() {
        let map = room();
        // Two cells from what is not free: columns 21 to 57, rows 2 to 37.
        let open = 3.7 * 3.6;
        let free_at = |x: f64| {
            let view = map.probe_view(Axes::new(&Se2::new(x, 0.0, 0.0)));
            map.floor.free_in(&[(&map.ground, view)])
        };
        assert!((free_at(0.0) - open).abs() < 0.01 * open, "{}", free_at(0.0));
        // A metre to the left, 0.9 m of it lies in the unknown, to the right as much in the wall and beyond.
        for x in [-1.0, 1.0] {
            assert!((free_at(x) - open * 2.8 / 3.7).abs() < 0.02 * open, "{}", free_at(x));
        }
        assert_eq!(free_at(9.0), 0.0);
        // Where one of two maps knows nothing the other has the word; where they differ, each has half of it.
        let views = |x: f64| {
            let at = |x: f64| map.probe_view(Axes::new(&Se2::new(x, 0.0, 0.0)));
            map.floor.free_in(&[(&map.ground, at(0.0)), (&map.ground, at(x))])
        };
        assert!((views(9.0) - free_at(0.0)).abs() < 1e-4);
        assert!(views(1.0) > free_at(1.0) && views(1.0) <= free_at(0.0));
    }

    #[test]
    fn that_of_the_mirror_image_is_free_in_it() {
        let (map, mirrored) = (room(), room().mirrored());
        let view =
            |m: &LocalMap| m.floor.free_in(&[(&m.ground, m.probe_view(Axes::new(&Se2::IDENTITY)))]);
        assert!(view(&map) > 5.0);
        assert!((view(&map) - view(&mirrored)).abs() < 0.02 * view(&map));
    }
}
