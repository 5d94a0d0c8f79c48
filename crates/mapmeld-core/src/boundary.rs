//! Oriented wall points: where occupied meets free, with the normal into free space.
//!
//! These are the data points of the paper's section 5. The normal tells the two sides of a wall
//! apart: two walls that coincide with opposed normals are no agreement.

use crate::grid::{class_of, Class, OccupancyGrid, OCCUPIED_AT_LEAST};
use crate::se2::Vec2;
use std::sync::LazyLock;

/// One side of a wall cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoundaryPoint {
    /// Centre of the occupied cell in map coordinates, metres.
    pub position: Vec2,
    /// Unit normal from the wall into free space, in the map frame.
    pub normal: Vec2,
    /// Cell index in the grid.
    pub cell: u32,
    /// How straight the wall is here: 1 for a perfect line, 0 for none.
    pub straightness: f64,
}

/// The eight neighbours, counter-clockwise from east.
const RING: [(isize, isize); 8] =
    [(0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1)];

/// Half width, in cells, of the window over which normals are fitted.
const FIT_RADIUS: isize = 3;

/// All oriented wall points of a grid, ordered by cell, and where they are. A wall seen from both sides gives two
/// points a cell, with opposed normals.
pub fn extract(grid: &OccupancyGrid) -> (Vec<BoundaryPoint>, CellIndex) {
    let raw = raw_points(grid);
    let index = CellIndex::new(grid, raw.iter().map(|p| p.cell));
    (raw.iter().map(|p| fit_normal(grid, &raw, &index, p)).collect(), index)
}

/// Points in the grid's own axes (cells), with normals from the eight neighbours.
fn raw_points(grid: &OccupancyGrid) -> Vec<BoundaryPoint> {
    let (w, h) = (grid.width(), grid.height());
    let mut out = Vec::new();
    for row in 0..h {
        for col in occupied(&grid.cells()[row * w..(row + 1) * w]) {
            for normal in &SIDES[free_about(grid, row, col)] {
                out.push(BoundaryPoint {
                    position: Vec2::new(col as f64 + 0.5, row as f64 + 0.5),
                    normal: *normal,
                    cell: (row * w + col) as u32,
                    straightness: 0.0,
                });
            }
        }
    }
    out
}

/// Columns of the occupied cells of a row.
fn occupied(row: &[i8]) -> impl Iterator<Item = usize> + '_ {
    const AT_ONCE: usize = 32;
    // Few cells are occupied: where none of many is, one comparison tells.
    let some = row.chunks(AT_ONCE).enumerate().filter(|(_, cells)| {
        cells.iter().fold(i8::MIN, |most, v| most.max(*v)) >= OCCUPIED_AT_LEAST
    });
    some.flat_map(|(chunk, cells)| {
        let is_occupied = |(_, v): &(usize, &i8)| class_of(**v) == Class::Occupied;
        cells.iter().enumerate().filter(is_occupied).map(move |(k, _)| chunk * AT_ONCE + k)
    })
}

/// Which neighbours of a cell are free, a bit each in the order of [`RING`].
fn free_about(grid: &OccupancyGrid, row: usize, col: usize) -> usize {
    let (w, cells) = (grid.width(), grid.cells());
    let bit = |k: usize, is_free: bool| usize::from(is_free) << k;
    if row > 0 && row + 1 < grid.height() && col > 0 && col + 1 < w {
        let is_free = |(dr, dc): (isize, isize)| {
            let at = (row * w + col).wrapping_add_signed(dr * w as isize + dc);
            class_of(cells[at]) == Class::Free
        };
        return (0..8).map(|k| bit(k, is_free(RING[k]))).sum();
    }
    let class = |(dr, dc)| grid.class_or_unknown(row as isize + dr, col as isize + dc);
    (0..8).map(|k| bit(k, class(RING[k]) == Class::Free)).sum()
}

/// The normals of a cell by which neighbours are free.
static SIDES: LazyLock<Vec<Vec<Vec2>>> = LazyLock::new(|| {
    (0..256).map(|free| sides(&std::array::from_fn(|k| free >> k & 1 == 1)).collect()).collect()
});

/// One unit normal for every run of free neighbours that holds a direct one.
fn sides(free: &[bool; 8]) -> impl Iterator<Item = Vec2> + '_ {
    // Start after a neighbour that is not free, so that no run is cut in two. A cell with eight free
    // neighbours is a speck without a side.
    let start = (0..8).find(|k| !free[*k]);
    let mut k = 0;
    std::iter::from_fn(move || {
        let start = start?;
        while k < 8 {
            let (mut sum, mut direct) = (Vec2::zeros(), false);
            while k < 8 && free[(start + k) % 8] {
                let at = (start + k) % 8;
                let (dr, dc) = RING[at];
                sum += Vec2::new(dc as f64, dr as f64).normalize();
                direct |= at % 2 == 0;
                k += 1;
            }
            k += 1;
            if direct && sum.norm() > 1e-6 {
                return Some(sum.normalize());
            }
        }
        None
    })
}

/// Refits a point's normal as that of the wall through its neighbours on the same side, and takes
/// the point to map coordinates.
fn fit_normal(
    grid: &OccupancyGrid,
    raw: &[BoundaryPoint],
    index: &CellIndex,
    point: &BoundaryPoint,
) -> BoundaryPoint {
    let (mut n, mut mean, mut normals) = (0.0, Vec2::zeros(), Vec2::zeros());
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    index.for_window(point.cell, FIT_RADIUS, |k| {
        let q = &raw[k];
        if q.normal.dot(&point.normal) > 0.3 {
            let d = q.position - point.position;
            n += 1.0;
            mean += d;
            normals += q.normal;
            xx += d.x * d.x;
            xy += d.x * d.y;
            yy += d.y * d.y;
        }
    });
    mean /= n;
    let (cxx, cxy, cyy) =
        (xx / n - mean.x * mean.x, xy / n - mean.x * mean.y, yy / n - mean.y * mean.y);
    let spread = ((cxx - cyy).powi(2) + 4.0 * cxy * cxy).sqrt();
    let trace = cxx + cyy;
    let straightness = if trace > 1e-9 { spread / trace } else { 0.0 };
    let mean_normal = if normals.norm() > 1e-6 { normals.normalize() } else { point.normal };
    // Three points in a row are the least that has a direction.
    let normal = if n >= 3.0 && straightness > 0.8 {
        let along = 0.5 * (2.0 * cxy).atan2(cxx - cyy);
        let across = Vec2::new(-along.sin(), along.cos());
        if across.dot(&mean_normal) >= 0.0 {
            across
        } else {
            -across
        }
    } else {
        mean_normal
    };
    BoundaryPoint {
        position: grid.grid_to_map(point.position.x, point.position.y),
        normal: grid.origin().rotate(normal),
        cell: point.cell,
        straightness,
    }
}

/// Finds points by the cell they lie in. Points must come ordered by cell.
pub struct CellIndex {
    width: isize,
    height: isize,
    /// `first[cell]..first[cell + 1]` are the points of a cell.
    first: Vec<u32>,
}

impl CellIndex {
    /// Of points in these cells.
    pub fn new(grid: &OccupancyGrid, cells: impl Iterator<Item = u32>) -> Self {
        let all = grid.cells().len() + 1;
        let mut first: Vec<u32> = Vec::with_capacity(all);
        let mut points = 0;
        for cell in cells {
            debug_assert!(cell as usize + 1 >= first.len(), "points must come ordered by cell");
            first.resize(first.len().max(cell as usize + 1), points);
            points += 1;
        }
        first.resize(all, points);
        Self { width: grid.width() as isize, height: grid.height() as isize, first }
    }

    /// Calls `f` with the index of every point within `radius` cells (square window) of a cell.
    pub fn for_window(&self, cell: u32, radius: isize, mut f: impl FnMut(usize)) {
        let (row, col) = (cell as isize / self.width, cell as isize % self.width);
        let (c0, c1) = ((col - radius).max(0), (col + radius).min(self.width - 1));
        for r in (row - radius).max(0)..=(row + radius).min(self.height - 1) {
            let from = self.first[(r * self.width + c0) as usize];
            let to = self.first[(r * self.width + c1) as usize + 1];
            (from..to).for_each(|k| f(k as usize));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::se2::Se2;

    /// A straight wall between two rooms, drawn at an angle, in a rotated grid frame.
    fn wall(angle: f64, origin: Se2) -> OccupancyGrid {
        let (w, h) = (60, 60);
        let n = Vec2::new(-angle.sin(), angle.cos());
        let cells = (0..w * h)
            .map(|i| {
                let p = Vec2::new((i % w) as f64 + 0.5 - 30.0, (i / w) as f64 + 0.5 - 30.0);
                if p.dot(&n).abs() < 0.8 {
                    100
                } else {
                    0
                }
            })
            .collect();
        OccupancyGrid::new("wall", w, h, 0.05, origin, cells).unwrap()
    }

    #[test]
    fn a_wall_seen_from_both_sides_has_two_opposed_normals() {
        for angle in [0.0, 0.2, 0.7, 1.4, 2.5, -1.0] {
            let origin = Se2::new(2.0, -1.0, 0.4);
            let (points, _) = extract(&wall(angle, origin));
            let across = origin.rotate(Vec2::new(-angle.sin(), angle.cos()));
            let (mut up, mut down) = (0, 0);
            for p in &points {
                let dot = p.normal.dot(&across);
                assert!(dot.abs() > 0.95, "normal off by {:.1} deg", dot.abs().acos().to_degrees());
                assert!((p.normal.norm() - 1.0).abs() < 1e-9);
                if dot > 0.0 {
                    up += 1
                } else {
                    down += 1
                }
            }
            assert!(up > 50 && down > 50, "{up} {down}");
        }
    }

    #[test]
    fn walls_towards_the_unknown_have_one_side() {
        let (w, h) = (30, 20);
        let cells = (0..w * h)
            .map(|i| match i / w {
                0..=9 => 0,
                10 => 100,
                _ => -1,
            })
            .collect();
        let g = OccupancyGrid::new("half", w, h, 0.1, Se2::IDENTITY, cells).unwrap();
        let (points, _) = extract(&g);
        assert_eq!(points.len(), w);
        assert!(points.iter().all(|p| p.normal.y < -0.99));
    }
}
