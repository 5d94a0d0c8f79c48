//! First looks at poses of two maps: cheap, fair to both, and longer the more promising a pose is.

use crate::local_map::LocalMap;
use crate::probe::{Axes, Probe};
use crate::se2::{Rigid, Se2};

/// Samples that are asked at once.
pub const AT_ONCE: usize = 8;
/// Most samples of a map that a look asks.
const MOST: usize = 128;

/// Some wall samples of a map, in its grid's axes, as many as are asked at once; those that stand for none weigh
/// nothing.
#[derive(Debug, Clone, Default)]
pub struct Samples {
    /// Metres from the corner of cell (0, 0).
    pub x: [f32; AT_ONCE],
    /// The same.
    pub y: [f32; AT_ONCE],
    /// See [`Probe::weight`].
    pub weight: [f32; AT_ONCE],
    /// See [`Probe::conflict_weight`].
    pub conflict_weight: [f32; AT_ONCE],
    /// See [`Probe::direction`].
    pub direction: [u16; AT_ONCE],
}

/// Samples that stand for all of a map's. However many of the first are taken, they lie all over the map: they come in
/// the order of a van der Corput sequence.
pub fn samples(probes: &[Probe]) -> Vec<Samples> {
    let kept = probes.len().min(MOST);
    let bits = kept.next_power_of_two().trailing_zeros();
    let reversed = |k: u32| k.reverse_bits().checked_shr(u32::BITS - bits).unwrap_or(0) as usize;
    let order: Vec<usize> = (0..1u32 << bits).map(reversed).filter(|k| *k < kept).collect();
    let scale = probes.len() as f32 / kept.max(1) as f32;
    let group = |some: &[usize]| {
        let mut group = Samples::default();
        for (lane, k) in some.iter().enumerate() {
            let p = &probes[k * probes.len() / kept];
            (group.x[lane], group.y[lane]) = (p.x, p.y);
            group.weight[lane] = scale * p.weight;
            group.conflict_weight[lane] = scale * p.conflict_weight;
            group.direction[lane] = p.direction;
        }
        group
    };
    order.chunks(AT_ONCE).map(group).collect()
}

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
    /// Groups of samples of each map that were asked.
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
        self.look(&mut look, MOST / AT_ONCE);
        look.score
    }

    /// Before the first look.
    pub fn at(&self, t_a_b: &Se2) -> Look {
        let axes = self.axes(t_a_b);
        Look { axes: [axes, axes.inverse()], said: [0.0; 2], asked: 0, score: 0.0 }
    }

    /// Looks until about so many samples of each map are asked, and keeps the best, in their order.
    pub fn narrow<T>(&self, looks: &mut Vec<(Look, T)>, samples: usize, keep: usize) {
        let groups = samples.div_ceil(AT_ONCE);
        looks.iter_mut().for_each(|(look, _)| self.look(look, groups));
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

    fn look(&self, look: &mut Look, groups: usize) {
        let sides = [(self.b, self.a, &look.axes[1]), (self.a, self.b, &look.axes[0])];
        let groups = groups.max(look.asked);
        look.score = 0.0;
        for ((to, of, axes), said) in sides.into_iter().zip(&mut look.said) {
            let samples = &of.glimpses;
            let (from, until) = (look.asked.min(samples.len()), groups.min(samples.len()));
            *said += to.coarse.score(&samples[from..until], axes);
            // What was asked stands for all.
            let all = of.probes.len().min(MOST);
            look.score += *said * all as f32 / all.min(until * AT_ONCE).max(1) as f32;
        }
        look.asked = groups;
    }

    /// What `probe::axes_of` tells, with the sine and cosine of the pose alone.
    fn axes(&self, t_a_b: &Se2) -> Axes {
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
    use crate::probe::axes_of;

    #[test]
    fn poses_of_axes_are_those_of_the_grids() {
        let config = Config::default();
        let map = |origin: Se2| {
            let cells = (0..900).map(|k| if k % 30 == 4 { 100 } else { 0 }).collect();
            LocalMap::new(OccupancyGrid::new("g", 30, 30, 0.1, origin, cells).unwrap(), &config)
        };
        let (a, b) = (map(Se2::new(40.0, 4.0, 0.7)), map(Se2::new(-3.0, 2.0, -1.2)));
        let t_a_b = Se2::new(44.0, 5.0, 2.0);
        let (got, expected) =
            (Glance::new(&a, &b).axes(&t_a_b), Axes::new(&axes_of(&a.grid, &b.grid, &t_a_b)));
        for (x, y) in [(0.0, 0.0), (3.0, 0.0), (0.0, 2.0)] {
            let ((gx, gy), (ex, ey)) = (got.apply(x, y), expected.apply(x, y));
            assert!((gx - ex).abs() < 1e-4 && (gy - ey).abs() < 1e-4, "{got:?} {expected:?}");
        }
        assert_eq!(got.octant(700), expected.octant(700));
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
    fn the_first_samples_lie_all_over_the_map() {
        let (map, _) = walls();
        assert!(map.probes.len() > MOST);
        assert_eq!(map.glimpses.len(), MOST / AT_ONCE);
        let first = &map.glimpses[..2];
        let weight: f32 = map.glimpses.iter().flat_map(|s| s.weight).sum();
        let whole: f32 = map.probes.iter().map(|p| p.weight).sum();
        assert!((weight / whole - 1.0).abs() < 0.1, "{weight} {whole}");
        for side in 0..4 {
            let is_there = |x: f32, y: f32| (x > 3.5) == (side % 2 == 0) && (y > 3.0) == (side < 2);
            let there = |s: &Samples| (0..AT_ONCE).filter(|k| is_there(s.x[*k], s.y[*k])).count();
            assert!(first.iter().map(there).sum::<usize>() >= 2, "{side}");
        }
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

    #[test]
    fn few_samples_are_all_asked() {
        let (map, _) = walls();
        for n in [0, 1, 2, 5, 9, 100] {
            let some = samples(&map.probes[..n]);
            let weighty = some.iter().flat_map(|s| s.weight).filter(|w| *w > 0.0).count();
            assert_eq!((some.len(), weighty), (n.div_ceil(AT_ONCE), n));
        }
    }
}
