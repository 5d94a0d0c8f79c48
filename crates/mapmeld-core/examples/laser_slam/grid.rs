//! A particle's map: a grid of tiles that copies share until one of them is written to.

use super::world::{beam, MAX_RANGE};
use mapmeld_core::se2::{Se2, Vec2};
use std::collections::HashMap;
use std::sync::Arc;

/// Side of a cell, metres.
const CELL: f64 = 0.1;
/// Side of a tile, cells.
const TILE: usize = 16;
/// Columns and rows of tiles.
const TILES: (usize, usize) = (12, 9);
/// Where the grid begins, metres.
const CORNER: Vec2 = Vec2::new(-2.5, -2.5);
/// A cell is a wall when at least this share of the beams that came by ended in it.
const WALL: f32 = 0.2;
/// Standard deviation of a beam's end against the map, metres.
const SIGMA: f64 = 0.07;
/// Log-likelihood of a beam that ends where the map shows nothing.
const MISS: f64 = -3.0;
/// How many independent observations a beam is worth: neighbours are correlated.
const WORTH: f64 = 0.4;

/// How often beams ended in a cell or passed through it, and the mean of the ends.
#[derive(Clone, Copy, Default)]
struct Cell {
    hits: f32,
    seen: f32,
    end: [f32; 2],
}

impl Cell {
    fn wall(&self) -> Option<Vec2> {
        let is_wall = self.hits > 0.0 && self.hits >= WALL * self.seen;
        is_wall.then(|| Vec2::new(f64::from(self.end[0]), f64::from(self.end[1])))
    }
}

/// See the module's text.
#[derive(Clone)]
pub struct Grid(Vec<Arc<[Cell; TILE * TILE]>>);

impl Grid {
    /// Nothing is known.
    pub fn new() -> Self {
        let blank = Arc::new([Cell::default(); TILE * TILE]);
        Self(vec![blank; TILES.0 * TILES.1])
    }

    /// Tile and cell of a point.
    fn at(p: Vec2) -> Option<(usize, usize)> {
        let q = (p - CORNER) / CELL;
        if q.x < 0.0 || q.y < 0.0 {
            return None;
        }
        let (col, row) = (q.x as usize, q.y as usize);
        (col < TILES.0 * TILE && row < TILES.1 * TILE)
            .then_some((row / TILE * TILES.0 + col / TILE, row % TILE * TILE + col % TILE))
    }

    fn write(&mut self, p: Vec2, is_end: bool) {
        let Some((tile, k)) = Self::at(p) else { return };
        let cell = &mut Arc::make_mut(&mut self.0[tile])[k];
        cell.seen += 1.0;
        if is_end {
            cell.hits += 1.0;
            for (mean, v) in cell.end.iter_mut().zip([p.x, p.y]) {
                *mean += (v as f32 - *mean) / cell.hits;
            }
        }
    }

    /// Folds a scan in: free along the beams, occupied where they end.
    pub fn fold(&mut self, pose: &Se2, scan: &[f64]) {
        for (k, range) in scan.iter().enumerate() {
            let d = pose.rotate(Vec2::new(beam(k).cos(), beam(k).sin()));
            let free = ((range - CELL) / CELL).max(0.0) as usize;
            for step in 0..free {
                self.write(pose.translation() + d * (step as f64 * CELL), false);
            }
            if *range < MAX_RANGE - 0.1 {
                self.write(pose.translation() + d * *range, true);
            }
        }
    }

    /// log p(z | m, x): how far a scan's ends lie from those that the map remembers.
    pub fn log_likelihood(&self, pose: &Se2, scan: &[f64]) -> f64 {
        let pose = pose.to_rigid();
        let mut sum = 0.0;
        for (k, range) in scan.iter().enumerate().filter(|(_, r)| **r < MAX_RANGE - 0.1) {
            let end = pose.apply(Vec2::new(beam(k).cos(), beam(k).sin()) * *range);
            let mut nearest = f64::INFINITY;
            for (dx, dy) in (0..9).map(|i| (f64::from(i % 3 - 1), f64::from(i / 3 - 1))) {
                let near = Self::at(end + Vec2::new(dx, dy) * CELL);
                if let Some(wall) = near.and_then(|(tile, k)| self.0[tile][k].wall()) {
                    nearest = nearest.min((end - wall).norm_squared());
                }
            }
            sum += (-nearest / (2.0 * SIGMA * SIGMA)).max(MISS);
        }
        WORTH * sum
    }

    /// Where beams ended in the cells that are walls.
    pub fn walls(&self) -> Vec<Vec2> {
        self.0.iter().flat_map(|t| t.iter().filter_map(Cell::wall)).collect()
    }
}

/// Share of the grids' tiles that more than one grid holds, by identity.
pub fn shared_tiles<'a>(grids: impl Iterator<Item = &'a Grid>) -> f64 {
    let mut held: HashMap<*const _, usize> = HashMap::new();
    grids.flat_map(|g| &g.0).for_each(|t| *held.entry(Arc::as_ptr(t)).or_default() += 1);
    let all: usize = held.values().sum();
    held.values().filter(|n| **n > 1).sum::<usize>() as f64 / all as f64
}
