//! Floor plans, and robots' maps of them.
#![allow(dead_code)] // Every test binary uses its own part.

use mapmeld_core::grid::{OccupancyGrid, UNKNOWN};
use mapmeld_core::se2::{wrap, Se2, Vec2};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::PI;

/// Walls of one thickness, and the floor that is free where no wall stands.
#[derive(Clone, Default)]
pub struct Plan {
    /// Ends of the walls' centre lines, metres.
    pub walls: Vec<(Vec2, Vec2)>,
    /// Rectangles of floor: x and y of the lower left and the upper right corner.
    pub floors: Vec<[f64; 4]>,
    /// Half the thickness of the walls.
    pub half: f64,
}

impl Plan {
    /// Adds walls along a polyline.
    pub fn wall(mut self, points: &[(f64, f64)]) -> Self {
        let p: Vec<Vec2> = points.iter().map(|(x, y)| Vec2::new(*x, *y)).collect();
        self.walls.extend(p.windows(2).map(|w| (w[0], w[1])));
        self
    }

    /// Adds floor.
    pub fn floor(mut self, rectangle: [f64; 4]) -> Self {
        self.floors.push(rectangle);
        self
    }

    /// What stands at a point. Wall ends are square.
    pub fn value(&self, p: Vec2) -> i8 {
        let in_wall = |(a, b): &(Vec2, Vec2)| {
            let (d, length) = ((b - a).normalize(), (b - a).norm());
            let (along, across) = ((p - a).dot(&d), (p - a).perp(&d));
            across.abs() <= self.half && along >= -self.half && along <= length + self.half
        };
        let on_floor = |f: &[f64; 4]| p.x >= f[0] && p.y >= f[1] && p.x <= f[2] && p.y <= f[3];
        if self.walls.iter().any(in_wall) {
            100
        } else if self.floors.iter().any(on_floor) {
            0
        } else {
            UNKNOWN
        }
    }

    /// A robot's map of the part of the plan where `seen` holds, in a frame of its own.
    pub fn draw(
        &self,
        name: &str,
        t_plan_map: &Se2,
        resolution: f64,
        seen: impl Fn(Vec2) -> bool,
    ) -> OccupancyGrid {
        let ends = self.walls.iter().flat_map(|(a, b)| [*a, *b]);
        let corners = self.floors.iter().flat_map(|f| {
            [(f[0], f[1]), (f[2], f[1]), (f[0], f[3]), (f[2], f[3])].map(|(x, y)| Vec2::new(x, y))
        });
        let t_map_plan = t_plan_map.inverse();
        let inside: Vec<Vec2> = ends.chain(corners).map(|p| t_map_plan.apply(p)).collect();
        let low = inside.iter().fold(inside[0], |m, p| m.inf(p)).add_scalar(-0.5);
        let high = inside.iter().fold(inside[0], |m, p| m.sup(p)).add_scalar(0.5);
        let size = ((high - low) / resolution).map(|v| v.ceil() as usize);
        let cells = (0..size.x * size.y)
            .map(|k| {
                let cell = Vec2::new((k % size.x) as f64 + 0.5, (k / size.x) as f64 + 0.5);
                let p = t_plan_map.apply(low + cell * resolution);
                if seen(p) {
                    self.value(p)
                } else {
                    UNKNOWN
                }
            })
            .collect();
        let origin = Se2::new(low.x, low.y, 0.0);
        OccupancyGrid::new(name, size.x, size.y, resolution, origin, cells).unwrap()
    }
}

/// One floor of an office, 18 m x 10 m, without any symmetry: a corridor, rooms of all sizes, doors
/// that lie nowhere alike, a niche, a pillar and a bench.
pub fn office() -> Plan {
    Plan { half: 0.1, ..Plan::default() }
        .floor([0.0, 0.0, 18.0, 10.0])
        .wall(&[(0.0, 0.0), (18.0, 0.0), (18.0, 10.0), (0.0, 10.0), (0.0, 0.0)])
        // South of the corridor, with doors.
        .wall(&[(0.0, 4.0), (1.2, 4.0)])
        .wall(&[(2.1, 4.0), (6.4, 4.0)])
        .wall(&[(7.3, 4.0), (9.6, 4.0)])
        .wall(&[(10.8, 4.0), (15.7, 4.0)])
        .wall(&[(16.6, 4.0), (18.0, 4.0)])
        .wall(&[(5.0, 0.0), (5.0, 4.0)])
        .wall(&[(8.5, 0.0), (8.5, 4.0)])
        .wall(&[(14.0, 0.0), (14.0, 2.8), (12.4, 2.8)])
        // North of it.
        .wall(&[(0.0, 5.8), (2.4, 5.8)])
        .wall(&[(3.4, 5.8), (8.0, 5.8), (8.0, 6.5), (9.0, 6.5), (9.0, 5.8), (11.2, 5.8)])
        .wall(&[(12.2, 5.8), (18.0, 5.8)])
        .wall(&[(3.9, 5.8), (3.9, 8.6)])
        .wall(&[(10.0, 5.8), (10.0, 10.0)])
        .wall(&[(13.1, 7.2), (13.1, 10.0)])
        .wall(&[(15.2, 5.8), (16.9, 8.3)])
        // What stands about.
        .wall(&[(2.2, 1.8), (3.3, 1.8), (3.3, 1.2)])
        .wall(&[(6.2, 8.0), (7.6, 8.6)])
}

/// A frame anywhere within ten metres, at any angle.
pub fn any_frame(rng: &mut Pcg64Mcg) -> Se2 {
    Se2::new(
        rng.random_range(-10.0..10.0),
        rng.random_range(-10.0..10.0),
        rng.random_range(-PI..PI),
    )
}

/// The random numbers of a test.
pub fn rng(seed: u64) -> Pcg64Mcg {
    Pcg64Mcg::seed_from_u64(seed)
}

/// How far two transforms lie apart: metres at a point of the right-hand frame, degrees.
pub fn apart(a: &Se2, b: &Se2, at: Vec2) -> (f64, f64) {
    ((a.apply(at) - b.apply(at)).norm(), wrap(a.theta - b.theta).abs().to_degrees())
}
