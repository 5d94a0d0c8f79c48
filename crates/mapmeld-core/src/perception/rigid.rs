//! The log-likelihood ratio of a pair of rigid maps, and nothing else: what ranks thousands of poses.
//!
//! The model is that of [`crate::perception::likelihood`]; a wall's distance is taken in single precision.

use crate::blocks::LANES;
use crate::config::PerceptionConfig;
use crate::local_map::LocalMap;
use crate::perception::likelihood::noise_of;
use crate::probe::Axes;
use crate::se2::Se2;

/// Log-likelihood ratio of `T_a_b` under each of some models, nats, from so many samples of each map at most. The models
/// may differ in how far walls may lie from each other.
pub fn log_likelihoods(
    a: &LocalMap,
    b: &LocalMap,
    t_a_b: &Se2,
    samples: usize,
    models: &[PerceptionConfig],
) -> Vec<f64> {
    let axes = Axes::between(&a.grid, &b.grid, t_a_b);
    let mut sums = vec![Sum::default(); models.len()];
    one_way(a, b, axes, samples, models, &mut sums);
    let mut total: Vec<f64> =
        sums.iter().map(|s| 0.5 * b.blocks.share(samples) * s.total()).collect();
    one_way(b, a, axes.inverse(), samples, models, &mut sums);
    for (total, s) in total.iter_mut().zip(&sums) {
        *total += 0.5 * a.blocks.share(samples) * s.total();
    }
    total
}

/// What the samples say under one model.
#[derive(Clone, Copy, Default)]
struct Sum {
    value: [f32; LANES],
    /// Squared distance up to which a wall is in place.
    radius: f32,
    scale: f32,
}

impl Sum {
    fn total(&self) -> f64 {
        self.value.iter().copied().map(f64::from).sum()
    }
}

/// What so many samples of `from` say of `to`.
#[multiversion::multiversion(targets("x86_64+avx2"))]
fn one_way(
    to: &LocalMap,
    from: &LocalMap,
    axes: Axes,
    samples: usize,
    models: &[PerceptionConfig],
    sums: &mut [Sum],
) {
    let Some(common) = models.first() else { return };
    for (sum, model) in sums.iter_mut().zip(models) {
        let noise = noise_of(to, from, model);
        *sum = Sum {
            value: [0.0; LANES],
            radius: (noise.hit_radius * noise.hit_radius) as f32,
            scale: noise.inv_two_sigma_squared as f32,
        };
    }
    let slack = noise_of(to, from, common).slack as f32;
    let (hit, miss, opposed) = (common.hit as f32, common.miss as f32, common.opposed as f32);
    let conflicts = [common.conflict as f32, common.straight_conflict as f32];
    let view = to.probe_view(axes);
    for block in from.blocks.first(samples) {
        let seen = view.see(block);
        let nearest = view.walls(&seen, 0).squared(&seen, slack);
        let against = view.walls(&seen, 1).squared(&seen, slack);
        // What is said where no wall is in place.
        let (shares, misses) = to.ground.conflicts_and_misses(&seen.cell);
        let mut otherwise = [0.0; LANES];
        for (k, otherwise) in otherwise.iter_mut().enumerate() {
            let excuse = if block.straight[k] { conflicts[1] } else { conflicts[0] };
            *otherwise =
                misses[k] * block.weight[k] * miss + shares[k] * block.conflict_weight[k] * excuse;
        }
        for sum in sums.iter_mut() {
            for k in 0..LANES {
                let agrees = block.weight[k] * (hit - nearest[k] * sum.scale);
                let is_opposed = against[k] <= 0.25 * sum.radius;
                let other = if is_opposed { block.weight[k] * opposed } else { otherwise[k] };
                sum.value[k] += if nearest[k] <= sum.radius { agrees } else { other };
            }
        }
    }
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
            let slow = likelihood::pair(&a, &b, &t, usize::MAX, &p).log_likelihood;
            let fast = log_likelihoods(&a, &b, &t, usize::MAX, std::slice::from_ref(&p))[0];
            // Softer walls and sharp ones are told of in one go.
            let soft = PerceptionConfig { wall_sigma: 0.3, ..p.clone() };
            let both = log_likelihoods(&a, &b, &t, 90, &[p.clone(), soft.clone()]);
            let alone = |q| log_likelihoods(&a, &b, &t, 90, std::slice::from_ref(q))[0];
            assert_eq!(both, [alone(&p), alone(&soft)]);
            // A sample on the edge of a cell, or of an octant, may fall to either side.
            assert!((slow - fast).abs() <= 0.5 + 0.02 * slow.abs(), "{k}: {slow} {fast}");
        }
    }
}
