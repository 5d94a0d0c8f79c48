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
        let area = if kept == 0 { 0.0 } else { all as f64 / kept as f64 * cell * cell };
        Self { points: blocks::of(&points), area }
    }

    /// That of the mirror image of a grid so many metres wide.
    pub fn mirrored(&self, width: f64) -> Self {
        let mirror =
            |block: &Block| Block { x: block.x.map(|x| width as f32 - x), ..block.clone() };
        Self { points: self.points.iter().map(mirror).collect(), area: self.area }
    }

    /// How much of it is free in other maps, square metres: where several know a point, each has its share of the word.
    pub fn free_in(&self, others: &[(&Ground, ProbeView)]) -> f64 {
        let mut shared = 0.0f32;
        for block in &self.points {
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
        self.area * f64::from(shared)
    }
}
