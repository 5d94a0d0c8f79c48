//! Corners: where two neighbouring lines meet (paper, section 5).

use crate::config::StructureConfig;
use crate::grid::{Class, OccupancyGrid};
use crate::se2::Vec2;
use crate::structure::Line;
use std::f64::consts::{PI, TAU};

/// A corner. Turning counter-clockwise from arm 0 to arm 1 sweeps free space, by `opening` radians:
/// less than pi is a corner of a room, more is the edge of something that stands in it.
#[derive(Debug, Clone, PartialEq)]
pub struct Corner {
    /// Where the lines meet, map coordinates, metres.
    pub vertex: Vec2,
    /// Unit vectors from the vertex along the two walls.
    pub arms: [Vec2; 2],
    /// Visible lengths of the arms, metres.
    pub lengths: [f64; 2],
    /// Angle through free space, radians, in (0, 2 pi).
    pub opening: f64,
    /// Standard deviation of the opening, radians.
    pub opening_sigma: f64,
}

impl Corner {
    /// Unit vector that halves the free side.
    pub fn bisector(&self) -> Vec2 {
        let a = self.arms[0].y.atan2(self.arms[0].x) + 0.5 * self.opening;
        Vec2::new(a.cos(), a.sin())
    }
}

/// Corners of a map, those with the longest shorter arm first.
pub fn find(grid: &OccupancyGrid, lines: &[Line], config: &StructureConfig) -> Vec<Corner> {
    let gap = config.corner_gap.max(3.0 * grid.resolution());
    let min_arm = config.min_arm_length.max(4.0 * grid.resolution());
    let mut found = Vec::new();
    for (i, a) in lines.iter().enumerate() {
        for b in &lines[i + 1..] {
            let Some(vertex) = meet(a, b, config.min_corner_angle, gap) else { continue };
            for arm_a in arms(a, vertex, min_arm) {
                for arm_b in arms(b, vertex, min_arm) {
                    if let Some(c) = corner(grid, vertex, (a, arm_a), (b, arm_b)) {
                        found.push(c);
                    }
                }
            }
        }
    }
    found.sort_by(|a, b| reach(b).total_cmp(&reach(a)));
    let mut kept: Vec<Corner> = Vec::new();
    for c in found {
        let same = |k: &Corner| {
            (k.vertex - c.vertex).norm() < gap
                && k.arms[0].dot(&c.arms[0]) > 0.9
                && k.arms[1].dot(&c.arms[1]) > 0.9
        };
        if !kept.iter().any(same) {
            kept.push(c);
        }
    }
    kept
}

fn reach(c: &Corner) -> f64 {
    c.lengths[0].min(c.lengths[1])
}

/// Intersection of two lines when both come within `gap` of it.
fn meet(a: &Line, b: &Line, min_angle: f64, gap: f64) -> Option<Vec2> {
    let (da, db) = (a.direction(), b.direction());
    let cross = da.x * db.y - da.y * db.x;
    if cross.abs() < min_angle.sin() {
        return None;
    }
    let d = b.start - a.start;
    let s = (d.x * db.y - d.y * db.x) / cross;
    let vertex = a.start + da * s;
    let t = (vertex - b.start).dot(&db);
    let near = |s: f64, length: f64| s > -gap && s < length + gap;
    (near(s, a.length()) && near(t, b.length())).then_some(vertex)
}

/// The parts of a line that leave the vertex: direction and length.
fn arms(line: &Line, vertex: Vec2, min_arm: f64) -> impl Iterator<Item = (Vec2, f64)> {
    let d = line.direction();
    [(d, (line.end - vertex).dot(&d)), (-d, (vertex - line.start).dot(&d))]
        .into_iter()
        .filter(move |(_, length)| *length >= min_arm)
}

/// The corner of two arms, if both walls face the same side of it and that side is free.
fn corner(
    grid: &OccupancyGrid,
    vertex: Vec2,
    (line_a, (arm_a, length_a)): (&Line, (Vec2, f64)),
    (line_b, (arm_b, length_b)): (&Line, (Vec2, f64)),
) -> Option<Corner> {
    let inside = (line_a.normal.dot(&arm_b) > 0.0, line_b.normal.dot(&arm_a) > 0.0);
    let convex = match inside {
        (true, true) => true,
        (false, false) => false,
        // One wall faces into the angle and the other out of it: not one corner.
        _ => return None,
    };
    // Free space lies to the left of arm 0 (its normal is the arm turned by +90 degrees).
    let left_of_a = line_a.normal.dot(&Vec2::new(-arm_a.y, arm_a.x)) > 0.0;
    let (arms, lengths) = if left_of_a {
        ([arm_a, arm_b], [length_a, length_b])
    } else {
        ([arm_b, arm_a], [length_b, length_a])
    };
    let cross = arms[0].x * arms[1].y - arms[0].y * arms[1].x;
    let opening = cross.atan2(arms[0].dot(&arms[1])).rem_euclid(TAU);
    if convex != (opening < PI) {
        return None;
    }
    let opening_sigma = line_a.angle_sigma.hypot(line_b.angle_sigma);
    let c = Corner { vertex, arms, lengths, opening, opening_sigma };
    // The free side must have been seen to be free, a few cells out.
    let probe = vertex + c.bisector() * (3.5 * grid.resolution());
    let free = grid
        .locator()
        .index(probe)
        .is_some_and(|k| crate::grid::class_of(grid.cells()[k]) == Class::Free);
    free.then_some(c)
}
