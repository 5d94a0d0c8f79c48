//! Whether one map of a pair would fit the other better if it were larger or smaller: as where a saved map states a wrong
//! resolution, or wheels slipped. Registration itself takes maps for true to scale.

use crate::blocks::LANES;
use crate::config::PerceptionConfig;
use crate::evidence::Status;
use crate::local_map::LocalMap;
use crate::parallel;
use crate::probe::{axes_of, Axes};
use crate::registration::climb::robust_weight;
use crate::registration::PairModes;
use crate::se2::{Se2, Vec2};
use nalgebra::{Matrix4, Vector4};

/// Samples of a map that are asked, at most.
const SAMPLES: usize = 256;
/// Most steps.
const STEPS: usize = 20;
/// A step that changes the scale by less than this is the last.
const STILL: f64 = 1e-4;
/// Largest change of scale that is believed.
const MOST: f64 = 0.25;

/// How many times as large one of two maps would fit best.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stretch {
    /// Times that map b would have to be as large, about the middle of what it knows.
    pub scale: f64,
    /// Its standard deviation, from the curvature there.
    pub deviation: f64,
}

impl Stretch {
    /// How many times as large map a would fit b best.
    pub fn inverse(&self) -> Self {
        Self { scale: 1.0 / self.scale, deviation: self.deviation / (self.scale * self.scale) }
    }
}

/// Tells of the pairs that alone would be merged how many times as large the second map would fit best.
pub fn tell(pairs: &mut [PairModes], maps: &[LocalMap], perception: &PerceptionConfig) {
    let stretch = |p: &PairModes| {
        let best = p.found.modes.first().filter(|_| p.status == Status::Merged)?;
        of(&maps[p.a], &maps[p.b], &best.t_a_b, perception)
    };
    let stretches = parallel::map(pairs, stretch);
    pairs.iter_mut().zip(stretches).for_each(|(p, stretch)| p.stretch = stretch);
}

/// From the pose where two maps fit as they are; none where walls do not tell.
fn of(a: &LocalMap, b: &LocalMap, t_a_b: &Se2, perception: &PerceptionConfig) -> Option<Stretch> {
    let resolution = a.grid.resolution().max(b.grid.resolution());
    let finest = perception.climb_sigma.max(resolution);
    let middle = b.grid.origin().inverse().apply(b.center?);
    let t = axes_of(&a.grid, &b.grid, t_a_b);
    let (mut center, mut theta, mut scale) = (t.apply(middle), t.theta, 1.0f64);
    let mut kernel = (0.5 * a.reach()).max(finest);
    let (mut information, mut is_still) = (Matrix4::zeros(), false);
    for _ in 0..STEPS {
        let (h, g) = normal_equations(a, b, (center, middle), theta, scale, kernel);
        let damping = Matrix4::from_diagonal(&h.diagonal()) * 1e-3;
        let step = -(h + damping).cholesky()?.solve(&g);
        center += Vec2::new(step[0], step[1]);
        theta += step[2];
        scale *= 1.0 + step[3];
        information = h;
        if (scale - 1.0).abs() > MOST {
            return None;
        }
        if kernel > finest {
            kernel = (0.7 * kernel).max(finest);
        } else if step[3].abs() < STILL {
            is_still = true;
            break;
        }
    }
    // Neighbouring samples tell of one wall; those that were asked stand for all.
    let discount = b.blocks.share(SAMPLES) * b.spacing / perception.correlation_length;
    // What walls leave open stays finite: 10 m, 1 radian, a quarter of the size.
    let prior = Matrix4::from_diagonal(&Vector4::new(0.01, 0.01, 1.0, 1.0 / (MOST * MOST)));
    let covariance = (discount / (finest * finest) * information + prior).try_inverse()?;
    // The unknown is the logarithm of the size.
    is_still.then(|| Stretch { scale, deviation: scale * covariance[(3, 3)].sqrt() })
}

/// Of a step of b's middle, its heading and the logarithm of its size.
fn normal_equations(
    a: &LocalMap,
    b: &LocalMap,
    (center, middle): (Vec2, Vec2),
    theta: f64,
    scale: f64,
    kernel: f64,
) -> (Matrix4<f64>, Vector4<f64>) {
    let (s, c) = theta.sin_cos();
    let (s, c) = (scale * s, scale * c);
    let corner = center - Vec2::new(c * middle.x - s * middle.y, s * middle.x + c * middle.y);
    let view = a.probe_view(Axes::from_parts(corner, theta, (s, c)));
    let (mut h, mut g) = (Matrix4::zeros(), Vector4::zeros());
    for block in b.blocks.first(SAMPLES) {
        let seen = view.see(block);
        let walls = view.walls(&seen, 0);
        let residual = walls.residuals(&seen);
        for k in (0..LANES).filter(|k| walls.is_there(*k)) {
            let arm = Vec2::new(f64::from(seen.x[k]), f64::from(seen.y[k])) - center;
            let normal = Vec2::new(f64::from(walls.nx[k]), f64::from(walls.ny[k]));
            let r = f64::from(residual[k]);
            let j = Vector4::new(
                normal.x,
                normal.y,
                normal.y * arm.x - normal.x * arm.y,
                normal.dot(&arm),
            );
            let w = robust_weight(r, kernel);
            h += w * j * j.transpose();
            g += w * r * j;
        }
    }
    (h, g)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use crate::grid::OccupancyGrid;

    /// Rooms of 60 by 70 cells, drawn in cells of some size; the map's frame lies off its corner.
    fn map(cell: f64) -> LocalMap {
        let is_wall = |row: usize, col: usize| {
            let rim = [4, 55].contains(&row) || [4, 65].contains(&col);
            rim || row == 25 && col % 60 > 12 || col == 40 && row > 33
        };
        let known = |k: usize| is_wall(k / 70, k % 70) && (4..66).contains(&(k % 70));
        let cells = (0..60 * 70).map(|k| if known(k) { 100 } else { 0 }).collect();
        let origin = Se2::new(300.0, -20.0, 0.4);
        LocalMap::new(
            OccupancyGrid::new("g", 70, 60, cell, origin, cells).unwrap(),
            &Config::default(),
        )
    }

    /// From a pose that fits as a whole: the middles of both maps on each other.
    fn stretch(a: &LocalMap, b: &LocalMap) -> Stretch {
        let (ca, cb) = (a.center.unwrap(), b.center.unwrap());
        let t = Se2::from_parts(ca - cb, 0.0);
        of(a, b, &t, &Config::default().perception).unwrap()
    }

    #[test]
    fn a_wrong_resolution_is_seen_from_either_map() {
        let a = map(0.1);
        for wrong in [0.94, 0.97, 1.0, 1.03, 1.06] {
            let b = map(0.1 * wrong);
            let (ab, ba) = (stretch(&a, &b), stretch(&b, &a));
            assert!((ab.scale * wrong - 1.0).abs() < 0.004, "{wrong}: {ab:?}");
            assert!((ba.scale / wrong - 1.0).abs() < 0.004, "{wrong}: {ba:?}");
            assert!((ba.inverse().scale - ab.scale).abs() < 0.008);
            assert!(ab.deviation > 0.0 && ab.deviation < 0.01, "{ab:?}");
        }
    }

    #[test]
    fn walls_of_one_direction_do_not_tell() {
        let cells = (0..60 * 70).map(|k| if k / 70 == 30 { 100 } else { 0 }).collect();
        let grid = OccupancyGrid::new("g", 70, 60, 0.1, Se2::IDENTITY, cells).unwrap();
        let bare = LocalMap::new(grid, &Config::default());
        let told = of(&bare, &bare, &Se2::IDENTITY, &Config::default().perception);
        assert!(told.is_none_or(|s| s.deviation > 0.02), "{told:?}");
    }
}
