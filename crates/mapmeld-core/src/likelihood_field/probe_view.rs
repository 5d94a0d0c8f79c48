//! Another map's probes in a likelihood field, a block at a time.

use super::nearest::NearestPoints;
use super::{turned, LikelihoodField, Wall, DIRECTIONS};
use crate::blocks::{self, Block, LANES};
use crate::grid::OccupancyGrid;
use crate::probe::Axes;

/// Looks another map's probes up in a field.
#[derive(Clone, Copy)]
pub struct ProbeView<'a> {
    nearest: &'a NearestPoints,
    walls: &'a [Wall],
    axes: Axes,
    per_metre: f32,
    width: f32,
    height: f32,
    columns: i32,
    /// Index of the cell beyond the last.
    outside: u32,
    /// From the index of a row's first cell to where the field tells of it, and from there to the next cell.
    first: i32,
    step: i32,
    /// What the field's directions are counted from, and which way.
    octant: u8,
    octant_step: u8,
}

/// Where the probes of a block came to lie.
pub struct Seen {
    /// In the grid's axes, metres.
    pub x: [f32; LANES],
    /// The same.
    pub y: [f32; LANES],
    /// Indices of the grid's cells, row by row; one beyond the last for what lies outside the grid.
    pub cell: [u32; LANES],
    /// Where the field tells of these cells, and of the directions of their normals.
    place: [u32; LANES],
    octant: [u8; LANES],
}

/// The walls that are near the probes of a block; without a normal where there is none.
pub struct Walls {
    /// In the grid's axes, metres.
    pub x: [f32; LANES],
    /// The same.
    pub y: [f32; LANES],
    /// Unit normals into free space.
    pub nx: [f32; LANES],
    /// The same.
    pub ny: [f32; LANES],
}

impl<'a> ProbeView<'a> {
    /// A view of the field of a grid from the axes of another one.
    pub fn new(grid: &OccupancyGrid, field: &'a LikelihoodField, axes: Axes) -> Self {
        Self {
            nearest: &field.nearest,
            walls: &field.walls,
            axes,
            per_metre: (1.0 / grid.resolution()) as f32,
            width: grid.width() as f32,
            height: grid.height() as f32,
            columns: grid.width() as i32,
            outside: grid.cells().len() as u32,
            first: if field.is_turned { grid.width() as i32 - 1 } else { 0 },
            step: if field.is_turned { -1 } else { 1 },
            octant: if field.is_turned { turned(0) as u8 } else { 0 },
            octant_step: if field.is_turned { u8::MAX } else { 1 },
        }
    }

    /// Where probes lie.
    #[inline(always)]
    pub fn see(&self, block: &Block) -> Seen {
        let (zero, none) = ([0.0; LANES], [0; LANES]);
        let mut seen = Seen { x: zero, y: zero, cell: none, place: none, octant: [0; LANES] };
        for k in 0..LANES {
            let (x, y) = self.axes.apply(block.x[k], block.y[k]);
            (seen.x[k], seen.y[k]) = (x, y);
            let (u, v) = (x * self.per_metre, y * self.per_metre);
            let is_inside = (u >= 0.0) & (v >= 0.0) & (u < self.width) & (v < self.height);
            let (row, col) = (blocks::whole(v), blocks::whole(u));
            let row = row.wrapping_mul(self.columns);
            let cell = row.wrapping_add(col);
            let place = row.wrapping_add(self.first).wrapping_add(col.wrapping_mul(self.step));
            seen.cell[k] = if is_inside { cell as u32 } else { self.outside };
            seen.place[k] = if is_inside { place as u32 } else { self.outside };
        }
        for (octant, direction) in seen.octant.iter_mut().zip(block.direction) {
            let there = self.axes.octant(direction) as u8;
            *octant = self.octant.wrapping_add(there.wrapping_mul(self.octant_step));
        }
        seen
    }

    /// The nearest walls that are oriented like what lies there, or, turned by half a turn, against it.
    #[inline(always)]
    pub fn walls(&self, seen: &Seen, half_turns: usize) -> Walls {
        // All indices first: none of these loads waits for another.
        let mut nearest = [0u16; LANES];
        for (k, nearest) in nearest.iter_mut().enumerate() {
            let octant = (usize::from(seen.octant[k]) + half_turns * DIRECTIONS / 2) % DIRECTIONS;
            *nearest = self.nearest.at(seen.place[k] as usize)[octant];
        }
        let mut walls = Walls::none();
        for (k, nearest) in nearest.into_iter().enumerate() {
            let wall = &self.walls[usize::from(nearest)];
            (walls.x[k], walls.y[k]) = (wall.x, wall.y);
            (walls.nx[k], walls.ny[k]) = (wall.nx, wall.ny);
        }
        walls
    }
}

impl Walls {
    /// Squared distances of what was seen, square metres, infinite where there is no wall; so much along a wall costs nothing.
    #[inline(always)]
    pub fn squared(&self, seen: &Seen, slack: f32) -> [f32; LANES] {
        let mut found = [f32::INFINITY; LANES];
        for (k, found) in found.iter_mut().enumerate() {
            let (dx, dy) = (seen.x[k] - self.x[k], seen.y[k] - self.y[k]);
            let across = dx * self.nx[k] + dy * self.ny[k];
            let along = (dx * self.ny[k] - dy * self.nx[k]).abs() - slack;
            let along = if along > 0.0 { along } else { 0.0 };
            let squared = across * across + along * along;
            *found = if self.is_there(k) { squared } else { *found };
        }
        found
    }

    /// How far what was seen lies from the walls along their normals, metres; zero where there is no wall.
    #[inline(always)]
    pub fn residuals(&self, seen: &Seen) -> [f32; LANES] {
        let mut found = [0.0; LANES];
        for (k, found) in found.iter_mut().enumerate() {
            let (dx, dy) = (seen.x[k] - self.x[k], seen.y[k] - self.y[k]);
            *found = dx * self.nx[k] + dy * self.ny[k];
        }
        found
    }

    fn none() -> Self {
        let zero = [0.0; LANES];
        Self { x: zero, y: zero, nx: zero, ny: zero }
    }

    /// Whether there is one.
    #[inline(always)]
    pub fn is_there(&self, lane: usize) -> bool {
        self.nx[lane] * self.nx[lane] + self.ny[lane] * self.ny[lane] > 0.5
    }
}
