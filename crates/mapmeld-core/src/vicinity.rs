//! Which placed maps lie near each other: the others have nothing to say to each other.

use crate::grid::OccupancyGrid;
use crate::local_map::LocalMap;
use crate::se2::{Se2, Vec2};

/// How far walls may be moved while maps are compared, metres: more than climbing and bending ever do.
pub const SLACK: f64 = 3.0;

/// How far bending alone moves walls, metres: hardly ever more than this.
pub const BENT: f64 = 1.0;

/// A circle around a placed map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Circle {
    /// In the frame in which the map is placed, metres.
    pub center: Vec2,
    /// Metres.
    pub radius: f64,
}

impl Circle {
    /// Around the grid of a map that lies at `t_frame_map`.
    pub fn around(grid: &OccupancyGrid, t_frame_map: &Se2) -> Self {
        let (w, h) = (grid.width() as f64, grid.height() as f64);
        let center = t_frame_map.apply(grid.grid_to_map(0.5 * w, 0.5 * h));
        Self { center, radius: 0.5 * w.hypot(h) * grid.resolution() }
    }

    /// Whether maps in these circles may have something in common once walls have moved a little.
    pub fn is_near(&self, other: &Circle) -> bool {
        let reach = self.radius + other.radius + SLACK;
        (self.center - other.center).norm_squared() <= reach * reach
    }
}

/// The rectangle that the grid of a placed map covers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outline {
    /// In the frame in which the map is placed, metres.
    center: Vec2,
    /// Unit vector along the rows.
    along: Vec2,
    /// Half the sides, along the rows and across, metres.
    half: Vec2,
}

impl Outline {
    /// Of a map that lies at `t_frame_map`.
    pub fn of(grid: &OccupancyGrid, t_frame_map: &Se2) -> Self {
        let (w, h) = (grid.width() as f64, grid.height() as f64);
        let (s, c) = (t_frame_map.theta + grid.origin().theta).sin_cos();
        Self {
            center: t_frame_map.apply(grid.grid_to_map(0.5 * w, 0.5 * h)),
            along: Vec2::new(c, s),
            half: 0.5 * grid.resolution() * Vec2::new(w, h),
        }
    }

    /// False when the rectangles lie farther apart than `slack`, metres, as seen along a side of either.
    pub fn is_near(&self, other: &Outline, slack: f64) -> bool {
        let between = other.center - self.center;
        let reach = self.half.norm() + other.half.norm() + slack;
        between.norm_squared() <= reach * reach
            && self.meets(other, between, slack)
            && other.meets(self, between, slack)
    }

    /// Whether the other one reaches to this one along both sides of this one.
    fn meets(&self, other: &Outline, between: Vec2, slack: f64) -> bool {
        let across = |v: Vec2| Vec2::new(-v.y, v.x);
        let sides = [(self.along, self.half.x), (across(self.along), self.half.y)];
        sides.iter().all(|(side, half)| {
            let of_other = other.half.x * side.dot(&other.along).abs()
                + other.half.y * side.dot(&across(other.along)).abs();
            between.dot(side).abs() <= half + of_other + slack
        })
    }
}

/// Pairs of places, i before j, of maps whose grids overlap; in the order of i, then of j.
pub fn pairs(maps: &[LocalMap], members: &[usize], poses: &[Se2]) -> Vec<(usize, usize)> {
    let placed = members.iter().zip(poses);
    let outlines: Vec<Outline> = placed.map(|(m, t)| Outline::of(&maps[*m].grid, t)).collect();
    let n = outlines.len();
    let all = (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j)));
    all.filter(|(i, j)| outlines[*i].is_near(&outlines[*j], 0.0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};

    /// Least distance between the points of two grids, from dense points of the one.
    fn apart(a: (&OccupancyGrid, &Se2), b: (&OccupancyGrid, &Se2)) -> f64 {
        let to_a = a.0.origin().inverse().compose(&a.1.inverse()).compose(b.1);
        let (w, h) = (a.0.width() as f64 * 0.1, a.0.height() as f64 * 0.1);
        let points = (0..=b.0.height()).flat_map(|r| (0..=b.0.width()).map(move |c| (r, c)));
        let distances = points.map(|(r, c)| {
            let p = to_a.apply(b.0.grid_to_map(c as f64, r as f64));
            let out = |x: f64, side: f64| (-x).max(x - side).max(0.0);
            out(p.x, w).hypot(out(p.y, h))
        });
        distances.fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn outlines_are_near_where_the_grids_are() {
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(8);
        let (mut near, mut far) = (0, 0);
        for _ in 0..300 {
            let mut grid = || {
                let (w, h) = (rng.random_range(5..60), rng.random_range(5..60));
                let origin =
                    Se2::new(1.0, rng.random_range(-3.0..3.0), rng.random_range(-3.0..3.0));
                OccupancyGrid::new("g", w, h, 0.1, origin, vec![0; w * h]).unwrap()
            };
            let (a, b) = (grid(), grid());
            let mut pose = || {
                let mut at = || rng.random_range(-4.0..4.0);
                Se2::new(at(), at(), at())
            };
            let (x, y) = (pose(), pose());
            let slack = rng.random_range(0.0..1.0);
            let said = Outline::of(&a, &x).is_near(&Outline::of(&b, &y), slack);
            assert_eq!(said, Outline::of(&b, &y).is_near(&Outline::of(&a, &x), slack));
            let distance = apart((&a, &x), (&b, &y)).min(apart((&b, &y), (&a, &x)));
            // Nothing near is missed; what two corners point at may be told of from a little farther off.
            if distance <= slack {
                assert!(said, "{distance} m apart, {slack} m are near");
                near += 1;
            } else if distance > 1.5 * slack + 0.1 {
                assert!(!said, "{distance} m apart, {slack} m are near");
                far += 1;
            }
        }
        assert!(near > 30 && far > 30, "{near} near, {far} far");
    }
}
