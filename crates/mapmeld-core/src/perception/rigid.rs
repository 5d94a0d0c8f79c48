//! The log-likelihood ratio of a pair of rigid maps, and nothing else: what ranks thousands of poses.
//!
//! The model is that of [`crate::perception::likelihood`]; a wall's distance is taken in single precision.

use crate::config::PerceptionConfig;
use crate::grid::{class_of, Class};
use crate::local_map::LocalMap;
use crate::perception::likelihood::noise_of;
use crate::probe::axes_of;
use crate::se2::Se2;

/// Log-likelihood ratio of `T_a_b`, nats, from about so many samples of each map.
pub fn log_likelihood(
    a: &LocalMap,
    b: &LocalMap,
    t_a_b: &Se2,
    samples: usize,
    config: &PerceptionConfig,
) -> f64 {
    let axes = axes_of(&a.grid, &b.grid, t_a_b);
    let (stride_a, stride_b) = (a.stride(samples), b.stride(samples));
    let of_b = stride_b as f64 * one_way(a, b, &axes, stride_b, config);
    let of_a = stride_a as f64 * one_way(b, a, &axes.inverse(), stride_a, config);
    0.5 * (of_a + of_b)
}

/// What the samples of `from` say of `to`.
fn one_way(
    to: &LocalMap,
    from: &LocalMap,
    axes: &Se2,
    stride: usize,
    config: &PerceptionConfig,
) -> f64 {
    let noise = noise_of(to, from, config);
    let (slack, radius) = (noise.slack as f32, (noise.hit_radius * noise.hit_radius) as f32);
    let scale = noise.inv_two_sigma_squared as f32;
    let (hit, miss, opposed) = (config.hit as f32, config.miss as f32, config.opposed as f32);
    let conflicts = [config.conflict as f32, config.straight_conflict as f32];
    let view = to.probe_view(axes);
    let mut sum = 0.0;
    for p in from.probes.iter().step_by(stride) {
        let Some(s) = view.see(p) else { continue };
        let squared = |w: &crate::likelihood_field::Wall| {
            let (dx, dy) = (s.x - w.x, s.y - w.y);
            let across = dx * w.nx + dy * w.ny;
            let along = ((dx * w.ny - dy * w.nx).abs() - slack).max(0.0);
            across * across + along * along
        };
        let nearest = view.wall(&s, 0).map_or(f32::INFINITY, squared);
        if nearest <= radius {
            sum += p.weight * (hit - nearest * scale);
            continue;
        }
        if view.wall(&s, 1).is_some_and(|w| squared(w) <= 0.25 * radius) {
            sum += p.weight * opposed;
            continue;
        }
        let depth = to.depth.squared(s.cell);
        if depth == 0 && class_of(to.grid.cells()[s.cell]) == Class::Unknown {
            continue;
        }
        let share = to.conflict_shares[usize::from(depth)] as f32;
        sum += match depth {
            0 => p.weight * miss,
            _ if share == 0.0 => p.weight * miss,
            _ => share * p.conflict_weight * conflicts[usize::from(p.straight)],
        };
    }
    f64::from(sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use crate::grid::{OccupancyGrid, UNKNOWN};
    use crate::perception::likelihood;
    use rand::{Rng, SeedableRng};

    #[test]
    fn is_the_likelihood_of_rigid_maps() {
        let config = Config::default();
        let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(5);
        let mut room = |name: &str, origin: Se2| {
            let (w, h) = (90, 70);
            let mut cells = vec![UNKNOWN; w * h];
            for row in 10..60 {
                for col in 10..80 {
                    let is_wall = !(12..58).contains(&row)
                        || !(12..78).contains(&col)
                        || (col == 40 && row > 30);
                    let is_clutter = rng.random_range(0..200) == 0;
                    cells[row * w + col] = if is_wall || is_clutter { 100 } else { 0 };
                }
            }
            LocalMap::new(OccupancyGrid::new(name, w, h, 0.05, origin, cells).unwrap(), &config)
        };
        let a = room("a", Se2::new(4.0, -2.0, 0.3));
        let b = room("b", Se2::new(-7.0, 1.0, -2.0));
        let t_same = a.grid.origin().compose(&b.grid.origin().inverse());
        let p = config.perception.rigid();
        for k in 0..200 {
            let far = if k % 2 == 0 { 0.05 } else { 2.0 };
            let mut off = || rng.random_range(-far..far);
            let t = t_same.compose(&Se2::new(off(), off(), 0.3 * off()));
            let slow = likelihood::pair(&a, &b, &t, 1, &p).log_likelihood;
            let fast = log_likelihood(&a, &b, &t, usize::MAX, &p);
            // A sample on the edge of a cell, or of an octant, may fall to either side.
            assert!((slow - fast).abs() <= 0.5 + 0.02 * slow.abs(), "{k}: {slow} {fast}");
        }
    }
}
