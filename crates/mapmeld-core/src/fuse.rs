//! Placed maps into one grid.
//!
//! Free space is looked up from the output's cells, walls are also carried forward from the input's
//! cells: a wall of one cell must not fall between the output's cell centres. Where two maps show a wall within a
//! cell of each other it is one wall, drawn where the map that comes first has it.

use crate::config::{FuseConfig, FuseRule};
use crate::error::{Error, Result};
use crate::grid::{class_of, Class, OccupancyGrid, UNKNOWN};
use crate::parallel;
use crate::se2::{Se2, Vec2};

/// Log-odds that one map's occupied cell adds: hits are rarer than misses and weigh more.
const LOG_ODDS_OCCUPIED: f32 = 0.85;
/// Log-odds that one map's free cell adds.
const LOG_ODDS_FREE: f32 = -0.4;
/// Largest number of cells of a merged map.
const MAX_CELLS: f64 = 268_435_456.0;

/// The merged map of one component.
#[derive(Debug, Clone)]
pub struct Fused {
    /// The map, in the component's frame: yaw 0, origin on whole multiples of the resolution.
    pub grid: OccupancyGrid,
    /// Cells that one map shows occupied and another free, whose own walls are farther than a cell away.
    pub conflicts: usize,
    /// Cells that two maps or more know.
    pub shared: usize,
    /// Of each cell, the place in the list of the first map that shows what the merged map shows there; none
    /// where no map knows it.
    pub sources: Vec<Option<u16>>,
    /// Of each cell, whether it is one of `conflicts`.
    pub disputed: Vec<bool>,
}

/// Fuses grids placed at `T_world_map`, in their order: by log-odds the first draws a wall that several show
/// within a cell of each other, by [`FuseRule::Latest`] the last decides.
pub fn fuse(name: &str, placed: &[(&OccupancyGrid, Se2)], config: &FuseConfig) -> Result<Fused> {
    let finest = placed.iter().map(|(g, _)| g.resolution()).fold(f64::INFINITY, f64::min);
    let resolution = config.resolution.unwrap_or(finest);
    let (low, high) = known_bounds(placed).ok_or_else(|| Error::Grid {
        map: name.into(),
        field: "cells",
        problem: "no map has a known cell to fuse".into(),
    })?;
    // A margin of one cell, and an origin on whole cells.
    let first = (low / resolution).map(|v| v.floor() - 1.0);
    let last = (high / resolution).map(|v| v.ceil() + 1.0);
    let size = last - first;
    if size.x * size.y > MAX_CELLS {
        return Err(Error::Config {
            key: "fuse.resolution".into(),
            problem: format!(
                "{resolution} m makes a merged map of {} x {} cells; choose a coarser one",
                size.x, size.y
            ),
        });
    }
    let (width, height) = (size.x as usize, size.y as usize);
    // Whole nanometres: files say -17.4, not -17.400000000000002.
    let corner = (first * resolution).map(|v| (1e9 * v).round() / 1e9);
    let origin = Se2::new(corner.x, corner.y, 0.0);
    let frame =
        OccupancyGrid::new(name, width, height, resolution, origin, vec![UNKNOWN; width * height])?;

    let walls = parallel::map(placed, |(g, t)| forward_walls(g, t, &frame));
    let rows: Vec<usize> = (0..height).collect();
    let lines = parallel::map(&rows, |row| Line::new(*row, placed, &walls, &frame, config.rule));
    let mut cells = Vec::with_capacity(width * height);
    let mut sources = Vec::with_capacity(width * height);
    let mut disputed = Vec::with_capacity(width * height);
    let mut shared = 0;
    for line in lines {
        cells.extend_from_slice(&line.cells);
        sources.extend_from_slice(&line.sources);
        disputed.extend_from_slice(&line.disputed);
        shared += line.shared;
    }
    let grid = OccupancyGrid::new(name, width, height, resolution, origin, cells)?;
    let conflicts = disputed.iter().filter(|d| **d).count();
    Ok(Fused { grid, conflicts, shared, sources, disputed })
}

/// Makes one of walls that lie within a cell of each other. A wall is drawn by the first map that shows it: a
/// later map gives up its own cell where an earlier one has the same wall next to it, and takes the earlier one's.
/// `is_beside` tells whether a map has a wall beside the cell.
fn make_one(votes: &mut [(usize, Class)], is_beside: impl Fn(usize) -> bool) {
    for k in 1..votes.len() {
        let (earlier, rest) = votes.split_at_mut(k);
        let (map, class) = &mut rest[0];
        let first_says = |c: Class| earlier.iter().any(|(_, e)| *e == c);
        let is_drawn = || earlier.iter().any(|(j, e)| *e == Class::Free && is_beside(*j));
        match class {
            Class::Occupied if is_drawn() => *class = Class::Free,
            Class::Free if first_says(Class::Occupied) && is_beside(*map) => {
                *class = Class::Occupied;
            }
            _ => {}
        }
    }
}

/// One row of the layers.
struct Line {
    cells: Vec<i8>,
    sources: Vec<Option<u16>>,
    disputed: Vec<bool>,
    shared: usize,
}

impl Line {
    fn new(
        row: usize,
        placed: &[(&OccupancyGrid, Se2)],
        walls: &[WallCells],
        frame: &OccupancyGrid,
        rule: FuseRule,
    ) -> Self {
        let width = frame.width();
        let mut line = Self {
            cells: vec![UNKNOWN; width],
            sources: vec![None; width],
            disputed: vec![false; width],
            shared: 0,
        };
        // What each of the maps that reach this row shows of it, map by map.
        let here: Vec<usize> = (0..placed.len()).filter(|k| walls[*k].has_row(row)).collect();
        let mut shown = vec![Class::Unknown; here.len() * width];
        let (mut occupied, mut free) = (vec![0u32; width], vec![0u32; width]);
        let (origin, cell) = (frame.cell_center(row, 0), frame.resolution());
        for (k, shown) in here.iter().zip(shown.chunks_exact_mut(width)) {
            let (grid, t_world_map) = &placed[*k];
            let (locator, cells) = (grid.locator_from(&t_world_map.inverse()), grid.cells());
            for col in walls[*k].columns() {
                let center = origin + Vec2::new(col as f64 * cell, 0.0);
                let class = match walls[*k].contains(row, col) {
                    true => Class::Occupied,
                    false => locator.index(center).map_or(Class::Unknown, |i| class_of(cells[i])),
                };
                shown[col] = class;
                occupied[col] += u32::from(class == Class::Occupied);
                free[col] += u32::from(class == Class::Free);
            }
        }
        let known_at = |col: usize| {
            let classes = here.iter().enumerate().map(move |(n, k)| (*k, n * width + col));
            classes.map(|(k, at)| (k, shown[at])).filter(|(_, class)| *class != Class::Unknown)
        };
        for col in 0..width {
            let known = occupied[col] + free[col];
            if known == 0 {
                continue;
            }
            line.shared += usize::from(known > 1);
            if occupied[col] == 0 || free[col] == 0 {
                line.cells[col] = if free[col] == 0 { 100 } else { 0 };
                line.sources[col] = known_at(col).next().map(|(k, _)| k as u16);
                continue;
            }
            let as_seen: Vec<(usize, Class)> = known_at(col).collect();
            let mut as_one = as_seen.clone();
            make_one(&mut as_one, |k| walls[k].is_beside(row, col));
            let says = |class: Class| as_one.iter().any(|(_, c)| *c == class);
            line.disputed[col] = says(Class::Occupied) && says(Class::Free);
            let told = if rule == FuseRule::LogOdds { &as_one } else { &as_seen };
            let drawn = combine(told, rule);
            line.cells[col] = drawn;
            let shows_it = |(_, c): &&(usize, Class)| *c == class_of(drawn);
            line.sources[col] = told.iter().find(shows_it).map(|(k, _)| *k as u16);
        }
        line
    }
}

/// What is drawn of a cell that maps, in their order, show as they do.
fn combine(shown: &[(usize, Class)], rule: FuseRule) -> i8 {
    let occupied = shown.iter().filter(|(_, class)| *class == Class::Occupied).count();
    let is_wall = match rule {
        FuseRule::LogOdds => {
            let free = shown.len() - occupied;
            LOG_ODDS_OCCUPIED * occupied as f32 + LOG_ODDS_FREE * free as f32 > 0.0
        }
        FuseRule::Max => occupied > 0,
        FuseRule::Latest => shown.last().is_some_and(|(_, class)| *class == Class::Occupied),
    };
    if is_wall {
        100
    } else {
        0
    }
}

/// Cells of the output that hold the centre of an occupied cell of one map.
struct WallCells {
    /// The part of the output that the map may reach: first row and column, rows and columns.
    window: [usize; 4],
    bits: Vec<u64>,
}

impl WallCells {
    /// Index of a cell in the window; none outside of it.
    #[inline(always)]
    fn index(&self, row: usize, col: usize) -> Option<usize> {
        let [first_row, first_col, rows, cols] = self.window;
        let (r, c) = (row.wrapping_sub(first_row), col.wrapping_sub(first_col));
        (r < rows && c < cols).then(|| r * cols + c)
    }

    #[inline(always)]
    fn contains(&self, row: usize, col: usize) -> bool {
        self.index(row, col).is_some_and(|k| self.bits[k / 64] >> (k % 64) & 1 == 1)
    }

    fn has_row(&self, row: usize) -> bool {
        row.wrapping_sub(self.window[0]) < self.window[2]
    }

    fn columns(&self) -> std::ops::Range<usize> {
        self.window[1]..self.window[1] + self.window[3]
    }

    /// Whether a wall runs beside the cell: one of the eight cells around is a wall. A gap between two opposite
    /// ones is not beside a wall but in it.
    fn is_beside(&self, row: usize, col: usize) -> bool {
        let is_wall = |dr: isize, dc: isize| {
            self.contains(row.wrapping_add_signed(dr), col.wrapping_add_signed(dc))
        };
        let half = [(0, 1), (1, 1), (1, 0), (1, -1)].map(|(r, c)| (is_wall(r, c), is_wall(-r, -c)));
        half.iter().any(|(a, b)| *a || *b) && !half.iter().any(|(a, b)| *a && *b)
    }
}

fn forward_walls(grid: &OccupancyGrid, t_world_map: &Se2, frame: &OccupancyGrid) -> WallCells {
    let mut walls = WallCells { window: window(grid, t_world_map, frame), bits: Vec::new() };
    walls.bits = vec![0; (walls.window[2] * walls.window[3]).div_ceil(64)];
    let to_frame = frame.locator_from(t_world_map);
    let w = grid.width();
    for (i, v) in grid.cells().iter().enumerate() {
        if class_of(*v) == Class::Occupied {
            let cell = to_frame.index(grid.cell_center(i / w, i % w));
            if let Some(k) = cell.and_then(|k| walls.index(k / frame.width(), k % frame.width())) {
                walls.bits[k / 64] |= 1 << (k % 64);
            }
        }
    }
    walls
}

/// The part of the frame that a grid reaches: first row and column, rows and columns.
fn window(grid: &OccupancyGrid, t_world_map: &Se2, frame: &OccupancyGrid) -> [usize; 4] {
    let (w, h) = (grid.width() as f64, grid.height() as f64);
    let origin = frame.origin().translation();
    let corner = |(c, r): (f64, f64)| {
        (t_world_map.apply(grid.grid_to_map(c, r)) - origin) / frame.resolution()
    };
    let corners = [(0.0, 0.0), (w, 0.0), (0.0, h), (w, h)].map(corner);
    let low = corners.iter().fold(corners[0], |a, b| a.inf(b));
    let high = corners.iter().fold(corners[0], |a, b| a.sup(b));
    // A cell more on every side: rounding must not cost one.
    let span = |low: f64, high: f64, most: usize| {
        let first = (low.floor() - 1.0).clamp(0.0, most as f64) as usize;
        (first, (high.ceil() + 1.0).clamp(first as f64, most as f64) as usize - first)
    };
    let (row, rows) = span(low.y, high.y, frame.height());
    let (col, cols) = span(low.x, high.x, frame.width());
    [row, col, rows, cols]
}

/// Smallest and largest world coordinates of the known cells.
fn known_bounds(placed: &[(&OccupancyGrid, Se2)]) -> Option<(Vec2, Vec2)> {
    let mut bounds: Option<(Vec2, Vec2)> = None;
    for (g, t) in placed {
        let w = g.width();
        for row in 0..g.height() {
            let line = &g.cells()[row * w..(row + 1) * w];
            let known = |v: &i8| class_of(*v) != Class::Unknown;
            // The row's first and last known cells span it; a rigid motion keeps it so.
            let (Some(a), Some(b)) = (line.iter().position(known), line.iter().rposition(known))
            else {
                continue;
            };
            for (c, r) in [(a, row), (a, row + 1), (b + 1, row), (b + 1, row + 1)] {
                let p = t.apply(g.grid_to_map(c as f64, r as f64));
                let (lo, hi) = bounds.unwrap_or((p, p));
                bounds = Some((lo.inf(&p), hi.sup(&p)));
            }
        }
    }
    bounds
}
