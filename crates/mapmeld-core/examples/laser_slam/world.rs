//! A simulated hall, and a drive around it.

use mapmeld_core::se2::{Se2, Vec2};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use std::f64::consts::TAU;

/// Beams of a scan, all around.
pub const BEAMS: usize = 60;
/// A beam that hits nothing reads this, metres.
pub const MAX_RANGE: f64 = 7.0;

/// What a drive recorded, and where the robot truly was.
pub struct Drive {
    /// True poses, the first included.
    pub truth: Vec<Se2>,
    /// Motions between them, as the wheels tell.
    pub odometry: Vec<Se2>,
    /// Ranges at every pose, metres.
    pub scans: Vec<Vec<f64>>,
}

/// Direction of a beam against the robot's, radians.
pub fn beam(k: usize) -> f64 {
    TAU * k as f64 / BEAMS as f64
}

/// A hall of 14 m x 9 m with niches, a block in the middle to drive around, pillars and a panel.
fn walls() -> Vec<(Vec2, Vec2)> {
    let outlines: [&[(f64, f64)]; 6] = [
        &[(0.0, 0.0), (5.0, 0.0), (5.0, 0.6), (6.0, 0.6), (6.0, 0.0), (14.0, 0.0), (14.0, 9.0)],
        &[(14.0, 9.0), (9.5, 9.0), (9.5, 8.2), (8.0, 8.2), (8.0, 9.0), (0.0, 9.0), (0.0, 0.0)],
        &[(5.0, 3.6), (9.0, 3.6), (9.0, 5.4), (6.8, 5.4), (6.8, 4.9), (5.0, 4.9), (5.0, 3.6)],
        &[(0.9, 6.9), (1.4, 6.9), (1.4, 7.4), (0.9, 7.4), (0.9, 6.9)],
        &[(12.4, 1.1), (12.9, 1.4), (12.6, 1.9), (12.4, 1.1)],
        &[(2.4, 1.1), (3.4, 0.8)],
    ];
    let p = |c: &(f64, f64)| Vec2::new(c.0, c.1);
    outlines.iter().flat_map(|o| o.windows(2).map(move |w| (p(&w[0]), p(&w[1])))).collect()
}

/// Distance from a point to the nearest wall, metres.
pub fn distance_to_wall(p: Vec2) -> f64 {
    let distance = |(a, b): &(Vec2, Vec2)| {
        let e = b - a;
        let along = ((p - a).dot(&e) / e.norm_squared()).clamp(0.0, 1.0);
        (p - a - e * along).norm()
    };
    walls().iter().map(distance).fold(f64::INFINITY, f64::min)
}

/// Range to the nearest wall along a ray, metres.
fn range(walls: &[(Vec2, Vec2)], from: Vec2, angle: f64) -> f64 {
    let d = Vec2::new(angle.cos(), angle.sin());
    let hit = |(a, b): &(Vec2, Vec2)| {
        let (e, r) = (b - a, a - from);
        let cross = d.perp(&e);
        if cross.abs() < 1e-12 {
            return None;
        }
        let (range, along) = (r.perp(&e) / cross, r.perp(&d) / cross);
        (range > 0.0 && (0.0..=1.0).contains(&along)).then_some(range)
    };
    walls.iter().filter_map(hit).fold(MAX_RANGE, f64::min)
}

/// Drives around the block, a round in 70 steps, on wheels that drift and slip.
pub fn drive(steps: usize, seed: u64) -> Drive {
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut noise = |sigma: f64| -> f64 {
        let unit: f64 = StandardNormal.sample(&mut rng);
        sigma * unit
    };
    let walls = walls();
    let place = |k: usize| {
        let (s, c) = (TAU * k as f64 / 70.0).sin_cos();
        Se2::new(7.0 + 4.6 * c, 4.5 + 2.7 * s, (2.7 * c).atan2(-4.6 * s))
    };
    let truth: Vec<Se2> = (0..=steps).map(place).collect();
    let mut odometry = Vec::new();
    for w in truth.windows(2) {
        let t = w[0].between(&w[1]);
        let turn = t.theta + 0.006 + noise(0.015);
        odometry.push(Se2::new(1.04 * t.x + noise(0.02), t.y + noise(0.02), turn));
    }
    let mut scans = Vec::new();
    for t in &truth {
        let mut see = |k| range(&walls, t.translation(), t.theta + beam(k)) + noise(0.02);
        scans.push((0..BEAMS).map(&mut see).collect());
    }
    Drive { truth, odometry, scans }
}
