//! First looks at poses of two maps: cheap, fair to both, and longer the more promising a pose is.

use crate::blocks::LANES;
use crate::local_map::LocalMap;
use crate::probe::Axes;
use crate::registration::coarse_table;
use crate::se2::{Rigid, Se2};

/// Most samples of a map that a look asks.
pub const MOST: usize = 128;

/// Two maps whose poses are looked at, thousands of them.
pub struct Glance<'a> {
    a: &'a LocalMap,
    b: &'a LocalMap,
    to_axes_a: Rigid,
    /// Angle of b's axes in b's frame less that of a's axes in a's.
    turn: f64,
    sin_cos: (f64, f64),
}

/// A pose that is looked at: how well the walls of each map fit the other's coarse table there. Either map alone may
/// mistake much: where people crossed it, or where it shows little.
pub struct Look {
    /// Of b's axes in a's, and back.
    axes: [Axes; 2],
    /// What the samples of a said, and those of b.
    said: [f32; 2],
    /// Blocks of samples of each map that were asked.
    asked: usize,
    /// How well the maps fit, as far as it was looked.
    pub score: f32,
}

impl<'a> Glance<'a> {
    /// At poses of b in a.
    pub fn new(a: &'a LocalMap, b: &'a LocalMap) -> Self {
        let to_axes_a = a.grid.origin().inverse().to_rigid();
        let turn = b.grid.origin().theta - a.grid.origin().theta;
        Self { a, b, to_axes_a, turn, sin_cos: turn.sin_cos() }
    }

    /// How well the maps fit at `T_a_b`, after the longest look.
    pub fn score(&self, t_a_b: &Se2) -> f32 {
        let mut look = self.at(t_a_b);
        self.look(&mut look, MOST / LANES);
        look.score
    }

    /// Before the first look.
    pub fn at(&self, t_a_b: &Se2) -> Look {
        let axes = self.axes(t_a_b);
        Look { axes: [axes, axes.inverse()], said: [0.0; 2], asked: 0, score: 0.0 }
    }

    /// Looks until about so many samples of each map are asked, and keeps the best, in their order.
    pub fn narrow<T>(&self, looks: &mut Vec<(Look, T)>, samples: usize, keep: usize) {
        let blocks = samples.div_ceil(LANES);
        looks.iter_mut().for_each(|(look, _)| self.look(look, blocks));
        if looks.len() > keep {
            let mut order: Vec<usize> = (0..looks.len()).collect();
            let best_first = |x: &usize, y: &usize| {
                looks[*y].0.score.total_cmp(&looks[*x].0.score).then(x.cmp(y))
            };
            order.select_nth_unstable_by(keep, best_first);
            let mut is_kept = vec![false; looks.len()];
            order[..keep].iter().for_each(|k| is_kept[*k] = true);
            let mut is_kept = is_kept.into_iter();
            looks.retain(|_| is_kept.next().unwrap_or(false));
        }
    }

    fn look(&self, look: &mut Look, blocks: usize) {
        let sides = [(self.b, self.a, &look.axes[1]), (self.a, self.b, &look.axes[0])];
        let blocks = blocks.max(look.asked);
        look.score = 0.0;
        for ((to, of, axes), said) in sides.into_iter().zip(&mut look.said) {
            *said += coarse_table::score(&to.coarse, of.blocks.range(look.asked, blocks), axes);
            // What was asked stands for all.
            let all = of.blocks.probes();
            look.score += *said * all as f32 / all.min(blocks * LANES).max(1) as f32;
        }
        look.asked = blocks;
    }

    /// What [`Axes::between`] tells, with the sine and cosine of the pose alone.
    fn axes(&self, t_a_b: &Se2) -> Axes {
        // In double precision: it turns the origin of b, which may be a georeferenced one.
        let t = t_a_b.to_rigid();
        let corner = self.to_axes_a.apply(t.apply(self.b.grid.origin().translation()));
        let ((s, c), (s_turn, c_turn)) = (t.sin_cos(), self.sin_cos);
        let sin_cos = (s * c_turn + c * s_turn, c * c_turn - s * s_turn);
        Axes::from_parts(corner, t_a_b.theta + self.turn, sin_cos)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use crate::grid::OccupancyGrid;

    #[test]
    fn poses_of_axes_are_those_of_the_grids() {
        let config = Config::default();
        let map = |origin: Se2| {
            let cells = (0..900).map(|k| if k % 30 == 4 { 100 } else { 0 }).collect();
            LocalMap::new(OccupancyGrid::new("g", 30, 30, 0.1, origin, cells).unwrap(), &config)
        };
        // The second frame is a georeferenced one.
        for far in [Se2::new(-3.0, 2.0, -1.2), Se2::new(4.5e5, 5.4e6, -1.2)] {
            let (a, b) = (map(Se2::new(40.0, 4.0, 0.7)), map(far));
            let t_a_b = Se2::new(44.0, 5.0, 2.0).compose(&far.inverse());
            let (got, expected) =
                (Glance::new(&a, &b).axes(&t_a_b), Axes::between(&a.grid, &b.grid, &t_a_b));
            for (x, y) in [(0.0, 0.0), (3.0, 0.0), (0.0, 2.0)] {
                let ((gx, gy), (ex, ey)) = (got.apply(x, y), expected.apply(x, y));
                assert!((gx - ex).abs() < 1e-4 && (gy - ey).abs() < 1e-4, "{got:?} {expected:?}");
            }
            assert_eq!(got.octant(700), expected.octant(700));
        }
    }

    fn walls() -> (LocalMap, LocalMap) {
        let config = Config::default();
        let map = |shift: usize| {
            let is_wall = |row: usize, col: usize| {
                row == 20 || col == 30 || (row == 45 && col > 30) || (row * 7 + col * 3) % 211 == 0
            };
            let cells = (0..60 * 70).map(|k| is_wall(k / 70 + shift, k % 70));
            let cells = cells.map(|is_wall| if is_wall { 100 } else { 0 }).collect();
            let grid = OccupancyGrid::new("g", 70, 60, 0.1, Se2::IDENTITY, cells).unwrap();
            LocalMap::new(grid, &config)
        };
        (map(0), map(5))
    }

    #[test]
    fn narrowing_keeps_the_best_in_their_order_and_looks_on_where_it_left_off() {
        let (a, b) = walls();
        let glance = Glance::new(&a, &b);
        // Map b begins five rows further up.
        let at = |k: i32| Se2::new(0.0, 0.5 + 0.1 * f64::from(k), 0.0);
        let mut looks: Vec<(Look, i32)> = (-8..9).map(|k| (glance.at(&at(k)), k)).collect();
        glance.narrow(&mut looks, 16, 9);
        assert_eq!(looks.len(), 9);
        glance.narrow(&mut looks, MOST, 3);
        let kept: Vec<i32> = looks.iter().map(|(_, k)| *k).collect();
        let mut best: Vec<i32> = (-8..9).collect();
        best.sort_by(|x, y| glance.score(&at(*y)).total_cmp(&glance.score(&at(*x))));
        best.truncate(3);
        best.sort_unstable();
        assert!(kept == best && kept.contains(&0), "{kept:?} {best:?}");
        for (look, k) in &looks {
            assert!((look.score - glance.score(&at(*k))).abs() <= 1e-3 * look.score.abs());
        }
    }
}
