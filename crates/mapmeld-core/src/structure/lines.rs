//! Lines fitted to the data points (paper, section 5), by growing straight connected runs.

use crate::boundary::{BoundaryPoint, CellIndex};
use crate::config::StructureConfig;
use crate::grid::OccupancyGrid;
use crate::se2::Vec2;
use std::cmp::Reverse;

/// One straight side of a wall, in map coordinates.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// First end, metres. From here to `end` free space lies on the left.
    pub start: Vec2,
    /// Last end, metres.
    pub end: Vec2,
    /// Unit normal into free space.
    pub normal: Vec2,
    /// Standard deviation of the direction, radians.
    pub angle_sigma: f64,
    /// Indices of the boundary points that it was fitted to, ascending.
    pub points: Vec<u32>,
}

impl Line {
    /// Unit vector from start to end.
    pub fn direction(&self) -> Vec2 {
        Vec2::new(self.normal.y, -self.normal.x)
    }
    /// Length, metres.
    pub fn length(&self) -> f64 {
        (self.end - self.start).norm()
    }
}

/// Points within this many cells of each other are connected.
const CONNECT: isize = 3;

/// Lines of a map, longest first.
pub fn fit(
    grid: &OccupancyGrid,
    (boundary, index): (&[BoundaryPoint], &CellIndex),
    config: &StructureConfig,
) -> Vec<Line> {
    let mut taken = vec![false; boundary.len()];
    // The straightest places first: they have the best direction to start from. Rounded, so that those that are equally
    // straight come in the same order wherever the map's frame lies.
    let straightness = |k: &usize| (1e6 * boundary[*k].straightness).round() as u32;
    let mut seeds: Vec<usize> = (0..boundary.len()).collect();
    seeds.sort_by_cached_key(|k| Reverse(straightness(k)));
    let mut lines = Vec::new();
    // The last seed whose line took each point in.
    let mut seen_from = vec![u32::MAX; boundary.len()];
    for seed in seeds {
        if taken[seed] || boundary[seed].straightness < 0.8 {
            continue;
        }
        let members = grow(grid, boundary, index, (&taken, &mut seen_from), seed, config);
        if let Some(line) = finish(boundary, members, grid.resolution(), config) {
            line.points.iter().for_each(|k| taken[*k as usize] = true);
            lines.push(line);
        }
    }
    lines.sort_by(|a, b| b.length().total_cmp(&a.length()));
    lines
}

/// A total least-squares fit: centre, unit normal (sign open), rms distance.
fn total_least_squares(points: impl Iterator<Item = Vec2> + Clone) -> (Vec2, Vec2, f64) {
    let n = points.clone().count() as f64;
    let c = points.clone().sum::<Vec2>() / n;
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for p in points {
        let d = p - c;
        xx += d.x * d.x;
        xy += d.x * d.y;
        yy += d.y * d.y;
    }
    let along = 0.5 * (2.0 * xy).atan2(xx - yy);
    let normal = Vec2::new(-along.sin(), along.cos());
    let least = 0.5 * (xx + yy - ((xx - yy).powi(2) + 4.0 * xy * xy).sqrt());
    (c, normal, (least.max(0.0) / n).sqrt())
}

/// Grows a connected set of points on one line from a seed; the fit follows the set.
fn grow(
    grid: &OccupancyGrid,
    boundary: &[BoundaryPoint],
    index: &CellIndex,
    (taken, seen_from): (&[bool], &mut [u32]),
    seed: usize,
    config: &StructureConfig,
) -> Vec<u32> {
    // Wider than the final one: a slanted wall climbs in steps of a cell, which must not end the line.
    let tolerance = config.line_tolerance.max(1.5 * grid.resolution());
    let cos_tolerance = config.line_angle_tolerance.cos();
    seen_from[seed] = seed as u32;
    let mut members = vec![seed as u32];
    let (mut centre, mut normal) = (boundary[seed].position, boundary[seed].normal);
    let mut refit_at = 8;
    let mut head = 0;
    while head < members.len() {
        let at = boundary[members[head] as usize].cell;
        head += 1;
        index.for_window(at, CONNECT, |k| {
            let p = &boundary[k];
            if !taken[k]
                && p.normal.dot(&normal) > cos_tolerance
                && (p.position - centre).dot(&normal).abs() <= tolerance
                && seen_from[k] != seed as u32
            {
                seen_from[k] = seed as u32;
                members.push(k as u32);
            }
        });
        if members.len() >= refit_at {
            let (c, n, _) =
                total_least_squares(members.iter().map(|k| boundary[*k as usize].position));
            (centre, normal) = (c, if n.dot(&normal) >= 0.0 { n } else { -n });
            refit_at = members.len() * 3 / 2;
        }
    }
    members
}

/// Fits the final line, drops what the moving fit let in wrongly, and asks for a minimal length.
fn finish(
    boundary: &[BoundaryPoint],
    members: Vec<u32>,
    resolution: f64,
    config: &StructureConfig,
) -> Option<Line> {
    if members.len() < 5 {
        return None;
    }
    let tolerance = config.line_tolerance.max(0.75 * resolution);
    let mean_normal: Vec2 = members.iter().map(|k| boundary[*k as usize].normal).sum();
    let position = |k: &u32| boundary[*k as usize].position;
    let (c, n, _) = total_least_squares(members.iter().map(position));
    let mut points: Vec<u32> =
        members.into_iter().filter(|k| (position(k) - c).dot(&n).abs() <= tolerance).collect();
    if points.len() < 5 {
        return None;
    }
    let (c, n, rms) = total_least_squares(points.iter().map(position));
    let normal = if n.dot(&mean_normal) >= 0.0 { n } else { -n };
    let along = Vec2::new(normal.y, -normal.x);
    let (mut lo, mut hi) = (f64::INFINITY, f64::NEG_INFINITY);
    for k in &points {
        let s = (position(k) - c).dot(&along);
        lo = lo.min(s);
        hi = hi.max(s);
    }
    let length = hi - lo;
    // Whole cells are often just as long as is asked: rounding must not decide.
    if length < config.min_line_length.max(5.0 * resolution) - 1e-3 * resolution {
        return None;
    }
    points.sort_unstable();
    // Direction of n points spread evenly over the length; a cell's own rounding is the least noise.
    let sigma = rms.max(0.29 * resolution);
    let angle_sigma = sigma * (12.0 / points.len() as f64).sqrt() / length;
    Some(Line { start: c + along * lo, end: c + along * hi, normal, angle_sigma, points })
}
