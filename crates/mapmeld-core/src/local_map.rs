//! One robot's map, prepared: everything later stages look up, computed once.

mod floor;
mod mirror;
mod patches;

pub use floor::Floor;
pub use patches::Patch;

use crate::blocks::Blocks;
use crate::boundary::{self, BoundaryPoint, CellIndex};
use crate::catchment::MAX_REACH;
use crate::config::Config;
use crate::distance::{self, DistanceTable};
use crate::grid::{class_of, Class, OccupancyGrid};
use crate::ground::Ground;
use crate::likelihood_field::{LikelihoodField, ProbeView};
use crate::probe::{self, Axes, Probe};
use crate::registration::{coarse_table::CoarseTable, rotations::Turns};
use crate::se2::Vec2;
use crate::specks;
use crate::structure::{corners, lines, Corner, Line};
use rustc_hash::FxHashSet;
use std::sync::OnceLock;

/// A wall point that stands for a stretch of wall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WallSample {
    /// Map coordinates, metres.
    pub position: Vec2,
    /// Unit normal into free space.
    pub normal: Vec2,
    /// Independent observations that this point stands for when it agrees: a straight wall is one
    /// piece of evidence, however long.
    pub weight: f64,
    /// The same when it contradicts: every metre of wall in free space needs an excuse of its own.
    pub conflict_weight: f64,
    /// Whether it lies amid a long straight wall, where nothing tells one place from the next.
    pub straight: bool,
}

/// Cells of one class, thinned evenly to a largest number.
#[derive(Debug, Clone)]
pub struct ClassCells {
    /// Centres in map coordinates, metres.
    pub centers: Vec<Vec2>,
    /// Cells of the class that each centre stands for.
    pub scale: f64,
}

/// What Psi and D know of one class of a map's cells.
#[derive(Debug, Clone)]
pub struct ClassTable {
    /// Thinned cells that are summed over.
    pub cells: ClassCells,
    /// Squared distance to the nearest cell of the class.
    pub distance: DistanceTable,
}

/// A local map with its tables (boundary, lines, corners, distances).
#[derive(Debug, Clone)]
pub struct LocalMap {
    /// The map as given but for the unknown about it, of which a rim is left: how much a mapper keeps must not matter.
    pub grid: OccupancyGrid,
    /// Oriented wall points.
    pub boundary: Vec<BoundaryPoint>,
    /// Lines, longest first.
    pub lines: Vec<Line>,
    /// Corners, most visible first.
    pub corners: Vec<Corner>,
    /// Wall points at a regular spacing, with the evidence each carries.
    pub samples: Vec<WallSample>,
    /// The same as registration asks them.
    pub probes: Vec<Probe>,
    /// The same as thousands of poses ask them.
    pub blocks: Blocks,
    /// Weight of the walls by direction in the grid's axes.
    pub turns: Turns,
    /// The wall samples in patches of a few metres.
    pub patches: Vec<Patch>,
    /// Length of all walls, every side counted, metres.
    pub wall_length: f64,
    /// Share of it that lies on long straight walls, in [0, 1].
    pub straight_share: f64,
    /// How much deeper half of its walls are drawn than sharp ones are, metres.
    pub smear: f64,
    /// Distance between neighbouring wall samples, metres.
    pub spacing: f64,
    /// Cells that are taken for free and are not in the map, see [`specks`](crate::specks). Psi, D and the middle take
    /// the map as it is.
    pub specks: usize,
    /// Mean of the known cells' centres; none for a blank map.
    pub center: Option<Vec2>,
    /// What other maps' walls mean in each cell.
    pub ground: Ground,
    /// Floor that lies clear of every wall and of the unknown.
    pub floor: Floor,
    /// Scores for exhaustive correlation.
    pub coarse: CoarseTable,
    field: LikelihoodField,
    reach_cells: usize,
    max_cells: usize,
    wide: OnceLock<OccupancyGrid>,
    occupied: OnceLock<ClassTable>,
    free: OnceLock<ClassTable>,
}

/// Length from which a wall counts as a long straight one, metres.
const STRAIGHT: f64 = 1.0;
/// Thickness below which both sides of a wall are the same wall, metres.
const THICK: f64 = 0.2;
/// Depth up to which walls are drawn sharp, cells.
const SHARP: f64 = 1.5;
/// Holes in a wall that its depth is followed through, half cells.
const HOLE: usize = 2;
/// Depth to which a wall's depth is followed, cells.
const DEEPEST: usize = 12;
/// Wall points whose depth tells the median, about so many.
const DEPTHS: usize = 1000;
/// Part of the golden ratio below one.
const GOLDEN: f64 = 0.618_033_988_749_894_9;
/// How close to its end a wall tells one place from the next, metres.
const NEAR_END: f64 = 0.3;
/// Largest number of boundary points that the likelihood field can index.
const MAX_BOUNDARY: usize = 65_000;

impl LocalMap {
    /// Prepares a map.
    pub fn new(grid: OccupancyGrid, config: &Config) -> Self {
        let reach_cells =
            ((config.registration.reach / grid.resolution()).ceil() as usize).clamp(3, MAX_REACH);
        // Walls are looked up as far outside of what is known as their field reaches.
        let grid = grid.trimmed(reach_cells);
        let cleaned = specks::without(&grid);
        let seen = cleaned.as_ref().unwrap_or(&grid);
        let (mut boundary, mut index) = boundary::extract(seen);
        let mut lines = lines::fit(seen, (&boundary, &index), &config.structure);
        // A line knows the direction of its wall better than the steps of its cells do.
        for line in &lines {
            line.points.iter().for_each(|k| boundary[*k as usize].normal = line.normal);
        }
        let mut corners = corners::find(seen, &lines, &config.structure);
        corners.truncate(config.registration.max_corners);
        let samples = sample_walls(seen, &boundary, &lines, config);
        let probes = probe::probes(&grid, &samples);
        let wall_length = boundary.len() as f64 * grid.resolution();
        let smear = (median_depth(seen, &boundary) - SHARP).max(0.0) * grid.resolution();
        let long = lines.iter().map(Line::length).filter(|l| *l >= STRAIGHT).sum::<f64>();
        // Lines and samples know every point; the field of a very large map looks up fewer.
        if boundary.len() > MAX_BOUNDARY {
            let step = boundary.len().div_ceil(MAX_BOUNDARY);
            boundary = boundary.into_iter().step_by(step).collect();
            index = CellIndex::new(&grid, boundary.iter().map(|p| p.cell));
            for line in &mut lines {
                line.points.retain(|k| *k as usize % step == 0);
                line.points.iter_mut().for_each(|k| *k /= step as u32);
            }
        }
        let field = LikelihoodField::new(&grid, &boundary, &index, reach_cells);
        let ground = Ground::new(seen, &config.perception);
        Self {
            wall_length,
            straight_share: (long / wall_length.max(1e-9)).min(1.0),
            smear,
            spacing: config.perception.sample_spacing.max(grid.resolution()),
            specks: grid.count_differing(seen),
            center: grid.known_center(),
            coarse: CoarseTable::new(&grid, &boundary, &field, &ground),
            floor: Floor::new(&grid, &ground),
            ground,
            boundary,
            lines,
            corners,
            patches: patches::of(&samples, &probes),
            turns: Turns::new(&probes),
            blocks: Blocks::new(&probes),
            probes,
            samples,
            field,
            reach_cells,
            max_cells: config.perception.max_cells,
            wide: OnceLock::new(),
            occupied: OnceLock::new(),
            free: OnceLock::new(),
            grid,
        }
    }

    /// The map with as much unknown about it as the distances of Psi and D reach.
    pub fn wide(&self) -> &OccupancyGrid {
        let g = &self.grid;
        self.wide.get_or_init(|| g.part(0..g.height(), 0..g.width(), usize::from(distance::REACH)))
    }

    /// Occupied or free cells as Psi and D see them, worked out when they are first asked for; distances by the cells of
    /// the wide map.
    pub fn class_table(&self, is_occupied: bool) -> &ClassTable {
        let (table, class) = match is_occupied {
            true => (&self.occupied, Class::Occupied),
            false => (&self.free, Class::Free),
        };
        table.get_or_init(|| ClassTable {
            cells: class_cells(&self.grid, class, self.max_cells),
            distance: DistanceTable::to_class(self.wide(), class),
        })
    }

    /// The likelihood field as seen from another grid's axes.
    pub fn probe_view(&self, axes: Axes) -> ProbeView<'_> {
        ProbeView::new(&self.grid, &self.field, axes)
    }

    /// How far the likelihood field reaches, metres.
    pub fn reach(&self) -> f64 {
        self.reach_cells as f64 * self.grid.resolution()
    }

    /// Open floor for each metre of wall, every side counted, metres.
    pub fn openness(&self) -> f64 {
        self.floor.total / self.wall_length.max(1e-9)
    }

    /// True when nothing is known: such a map can be placed nowhere.
    pub fn is_blank(&self) -> bool {
        self.center.is_none()
    }

    /// False when nothing within a circle, its centre in the grid's axes and all in metres, can lie on the grid.
    pub fn reaches(&self, at: Vec2, radius: f64) -> bool {
        let (width, height) = self.extent();
        at.x >= -radius && at.y >= -radius && at.x <= width + radius && at.y <= height + radius
    }

    /// Sides of the whole grid, unknown cells included: width and height, metres.
    pub fn extent(&self) -> (f64, f64) {
        let r = self.grid.resolution();
        (self.grid.width() as f64 * r, self.grid.height() as f64 * r)
    }
}

/// All cells of a class, or every k-th so that at most `max` are left.
pub fn class_cells(grid: &OccupancyGrid, class: Class, max: usize) -> ClassCells {
    let total = grid.count(class);
    let w = grid.width();
    let of_class =
        grid.cells().iter().enumerate().filter(|(_, v)| class_of(**v) == class).map(|(i, _)| i);
    // The k-th kept cell is cell k * total / kept: spread evenly, so that all rows weigh alike.
    let kept = total.min(max);
    let mut next = 0;
    let mut centers: Vec<Vec2> = Vec::with_capacity(kept);
    for (k, i) in of_class.enumerate() {
        if next < kept && k == next * total / kept {
            next += 1;
            centers.push(grid.cell_center(i / w, i % w));
        }
    }
    let scale = if centers.is_empty() { 0.0 } else { total as f64 / centers.len() as f64 };
    ClassCells { centers, scale }
}

/// How deep half of the walls are behind their faces, along the normals, in cells; zero without walls.
fn median_depth(grid: &OccupancyGrid, boundary: &[BoundaryPoint]) -> f64 {
    let (width, height) = (grid.width(), grid.height());
    let to_axes = grid.origin().inverse().to_rigid();
    let depth = |p: &BoundaryPoint| {
        let n = to_axes.rotate(p.normal);
        let (x, y) = (p.cell as usize % width, p.cell as usize / width);
        // From the middle of the face's cell, half a cell a step.
        let is_wall = |k: &usize| {
            let at = 0.5 * *k as f64;
            let (x, y) = (x as f64 + 0.5 - at * n.x, y as f64 + 0.5 - at * n.y);
            let is_inside = x >= 0.0 && y >= 0.0 && x < width as f64 && y < height as f64;
            is_inside && class_of(grid.cells()[y as usize * width + x as usize]) == Class::Occupied
        };
        // What is missing of a wall does not end it.
        let mut last = 0;
        for k in (1..=2 * DEEPEST).filter(is_wall) {
            if k > last + 1 + HOLE {
                break;
            }
            last = k;
        }
        last
    };
    // By multiples of the golden ratio, which keep step with no number of walls in a row for long.
    let share = DEPTHS as f64 / boundary.len() as f64;
    let is_asked = |k: usize| (k as f64 * GOLDEN).fract() < share;
    let asked = boundary.iter().enumerate().filter(|(k, _)| is_asked(*k));
    let mut depths: Vec<usize> = asked.map(|(_, p)| depth(p)).collect();
    if depths.is_empty() {
        return 0.0;
    }
    let middle = depths.len() / 2;
    // Half a cell lies before the middle.
    0.5 + 0.5 * *depths.select_nth_unstable(middle).1 as f64
}

/// Thins the boundary to a spacing and shares out the evidence: neighbouring wall points are
/// correlated, and a straight wall is one piece of evidence that grows only with the logarithm of
/// its length.
fn sample_walls(
    grid: &OccupancyGrid,
    boundary: &[BoundaryPoint],
    lines: &[Line],
    config: &Config,
) -> Vec<WallSample> {
    let p = &config.perception;
    let spacing = p.sample_spacing.max(grid.resolution());
    let mut line_of = vec![usize::MAX; boundary.len()];
    for (i, line) in lines.iter().enumerate() {
        line.points.iter().for_each(|k| line_of[*k as usize] = i);
    }
    let to_grid = grid.locator();
    let per_bucket = spacing / grid.resolution();
    let mut seen = FxHashSet::default();
    let mut picked: Vec<usize> = Vec::new();
    for (k, b) in boundary.iter().enumerate() {
        let at = to_grid.to_cells(b.position) / per_bucket;
        let side = crate::likelihood_field::direction(to_grid.rotate(b.normal));
        if seen.insert((at.x as i64, at.y as i64, side, line_of[k])) {
            picked.push(k);
        }
    }
    let mut count = vec![0u32; lines.len()];
    for k in &picked {
        count.get_mut(line_of[*k]).into_iter().for_each(|n| *n += 1);
    }
    picked
        .iter()
        .map(|k| {
            let b = &boundary[*k];
            let weight = match lines.get(line_of[*k]) {
                Some(line) => {
                    let units = line.length() / p.correlation_length;
                    let units = if units > 1.0 { 1.0 + units.ln() } else { units };
                    units / f64::from(count[line_of[*k]])
                }
                None => spacing / p.correlation_length,
            };
            let straight = lines.get(line_of[*k]).is_some_and(|l| {
                let end = (b.position - l.start).norm().min((b.position - l.end).norm());
                l.length() >= STRAIGHT && end >= NEAR_END
            });
            // A wall that is seen from both sides is one wall.
            let behind = to_grid.index(b.position - THICK * b.normal);
            let is_thin = behind.is_some_and(|k| class_of(grid.cells()[k]) == Class::Free);
            let share = if is_thin { 0.5 } else { 1.0 };
            WallSample {
                position: b.position,
                normal: b.normal,
                weight,
                conflict_weight: share * spacing / p.correlation_length,
                straight,
            }
        })
        .collect()
}
