//! A first look at a pose of two maps: cheap, and fair to both.

use crate::local_map::LocalMap;
use crate::probe::{axes_of, Axes};
use crate::se2::Se2;

/// How well the walls of each map fit the other's coarse table at `T_a_b`, from about so many samples of both
/// together. Either map alone may mistake much: where people crossed it, or where it shows little.
pub fn glance(a: &LocalMap, b: &LocalMap, t_a_b: &Se2, samples: usize) -> f32 {
    let axes = Axes::new(&axes_of(&a.grid, &b.grid, t_a_b));
    let one_way = |to: &LocalMap, from: &LocalMap, axes: &Axes| {
        let stride = from.stride(samples / 2);
        stride as f32 * to.coarse.score(from.probes.iter().step_by(stride), axes)
    };
    one_way(a, b, &axes) + one_way(b, a, &axes.inverse())
}
