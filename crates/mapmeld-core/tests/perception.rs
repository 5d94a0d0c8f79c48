//! Psi, D, gamma and their normalisation against sums over all pairs of cells.
//!
//! The maps lie in each other's frames at whole cells and quarter turns, so that every cell of one
//! falls on a cell of the other and the brute force can work on integers.

mod common;

use common::office;
use mapmeld_core::config::{Config, PsiClasses};
use mapmeld_core::distance::MAX_SQUARED;
use mapmeld_core::grid::{Class, OccupancyGrid, UNKNOWN};
use mapmeld_core::local_map::LocalMap;
use mapmeld_core::perception::psi::Comparison;
use mapmeld_core::perception::{gamma, pool, psi, Overlay};
use mapmeld_core::se2::{Se2, Vec2};
use proptest::prelude::*;
use rand::Rng;
use rand_pcg::Pcg64Mcg;
use std::collections::BTreeSet;
use std::f64::consts::FRAC_PI_2;

/// Side of a cell: a power of two, so that metres are exact.
const CELL: f64 = 0.25;
/// Unknown cells around the content; how many must not matter.
const MARGIN: usize = 3;

type Cells = BTreeSet<(i64, i64)>;

/// Noise of the given density in the middle of a grid.
fn noise(rng: &mut Pcg64Mcg, w: usize, h: usize, occupied: f64, free: f64) -> OccupancyGrid {
    let (width, height) = (w + 2 * MARGIN, h + 2 * MARGIN);
    let mut cells = vec![UNKNOWN; width * height];
    for row in MARGIN..MARGIN + h {
        for col in MARGIN..MARGIN + w {
            let u: f64 = rng.random();
            cells[row * width + col] = match u {
                u if u < occupied => 100,
                u if u < occupied + free => 0,
                _ => UNKNOWN,
            };
        }
    }
    // The frame's origin lies in the middle, so that turned maps still overlap.
    let corner = |n: usize| -CELL * (n / 2) as f64;
    let origin = Se2::new(corner(width), corner(height), 0.0);
    OccupancyGrid::new("noise", width, height, CELL, origin, cells).unwrap()
}

/// A placement at whole cells.
fn placement(rng: &mut Pcg64Mcg, cells: i64) -> Se2 {
    let mut shift = || rng.random_range(-cells..=cells) as f64 * CELL;
    let (x, y) = (shift(), shift());
    Se2::new(x, y, rng.random_range(0..4) as f64 * FRAC_PI_2)
}

/// Cells of a class in the world, numbered by their lower left corners.
fn drawn(map: &LocalMap, t_world_map: &Se2, class: Class) -> Cells {
    let g = &map.grid;
    (0..g.height())
        .flat_map(|row| (0..g.width()).map(move |col| (row, col)))
        .filter(|(row, col)| g.class(*row, *col) == class)
        .map(|(row, col)| cell_of(t_world_map.apply(g.cell_center(row, col))))
        .collect()
}

fn cell_of(p: Vec2) -> (i64, i64) {
    ((p.x / CELL).floor() as i64, (p.y / CELL).floor() as i64)
}

/// Sum over the cells of `from` of the kernel of the distance to the nearest cell of `to`.
fn one_way(from: &Cells, to: &Cells, sigma: f64) -> f64 {
    let nearest = |p: &(i64, i64)| {
        to.iter().map(|q| (p.0 - q.0).pow(2) + (p.1 - q.1).pow(2)).min().unwrap_or(i64::MAX)
    };
    from.iter()
        .map(nearest)
        .filter(|d2| *d2 <= i64::from(MAX_SQUARED))
        .map(|d2| (-(d2 as f64) / (2.0 * sigma * sigma)).exp())
        .sum()
}

/// Maps, those but the last merged at poses, and the last one's pose.
struct Scene {
    maps: Vec<LocalMap>,
    merged: Overlay,
    poses: Vec<Se2>,
}

impl Scene {
    fn new(rng: &mut Pcg64Mcg, layers: usize, size: (usize, usize), config: &Config) -> Self {
        let (occupied, free) = (rng.random_range(0.04..0.2), rng.random_range(0.1..0.6));
        let maps: Vec<LocalMap> = (0..=layers)
            .map(|_| LocalMap::new(noise(rng, size.0, size.1, occupied, free), config))
            .collect();
        let poses: Vec<Se2> = (0..=layers).map(|_| placement(rng, 8)).collect();
        let merged =
            (0..layers).fold(Overlay::default(), |m, k| m.with(&maps, k, poses[k], 1.0, true));
        Self { maps, merged, poses }
    }

    fn comparison(&self, sigma: f64) -> Comparison<'_> {
        let k = self.maps.len() - 1;
        Comparison::new(&self.maps, &self.merged, &self.maps[k], self.poses[k], sigma)
    }

    /// Cells of a class in the merged map and in the local one.
    fn drawn(&self, class: Class) -> (Cells, Cells) {
        let mut all = self.maps.iter().zip(&self.poses).map(|(m, t)| drawn(m, t, class));
        let local = all.next_back().unwrap();
        (all.flatten().collect(), local)
    }
}

/// All cells count.
fn unthinned() -> Config {
    let mut config = Config::default();
    config.perception.max_cells = usize::MAX;
    config
}

fn close(got: f64, expected: f64) -> bool {
    (got - expected).abs() <= 1e-9 * expected.abs().max(1.0)
}

#[test]
fn psi_and_gamma_equal_brute_force() {
    let mut rng = common::rng(1);
    let (config, mut total) = (unthinned(), [0.0; 3]);
    for layers in 1..=3 {
        for _ in 0..6 {
            let scene = Scene::new(&mut rng, layers, (22, 15), &config);
            let (occupied, free) = (scene.drawn(Class::Occupied), scene.drawn(Class::Free));
            for sigma in [0.7, 1.5, 2.0, 6.0] {
                let both = |of: &(Cells, Cells), to: &(Cells, Cells)| {
                    one_way(&of.0, &to.1, sigma) + one_way(&of.1, &to.0, sigma)
                };
                let like = (both(&occupied, &occupied), both(&free, &free));
                let unlike = both(&occupied, &free) + both(&free, &occupied);
                [like.0, like.1, unlike].iter().zip(&mut total).for_each(|(v, sum)| *sum += v);
                let c = scene.comparison(sigma);
                let got = psi::psi(&c, PsiClasses::Occupied);
                assert!(close(got, like.0), "{layers} layers, sigma {sigma}: {got}, {}", like.0);
                let got = psi::psi(&c, PsiClasses::All);
                assert!(close(got, like.0 + like.1), "{layers} layers, sigma {sigma}");
                let got = gamma::gamma(&c);
                assert!(close(got, -unlike), "{layers} layers, sigma {sigma}: {got}, {unlike}");
            }
        }
    }
    assert!(total.iter().all(|sum| *sum > 500.0), "empty scenes: {total:?}");
}

#[test]
fn layers_hold_the_union_of_the_drawn_maps_once() {
    let mut rng = common::rng(2);
    for _ in 0..20 {
        let scene = Scene::new(&mut rng, 3, (20, 14), &unthinned());
        for class in [Class::Occupied, Class::Free] {
            let of = |l: &mapmeld_core::perception::Layer| {
                if class == Class::Occupied {
                    l.new_occupied.clone()
                } else {
                    l.new_free.clone()
                }
            };
            let cells: Vec<(i64, i64)> = scene.merged.layers().flat_map(of).map(cell_of).collect();
            let set: Cells = cells.iter().copied().collect();
            assert_eq!(cells.len(), set.len(), "a cell is counted twice");
            assert_eq!(set, scene.drawn(class).0);
        }
    }
}

#[test]
fn a_map_laid_on_itself_agrees_wholly_and_far_off_not_at_all() {
    let mut rng = common::rng(3);
    let grid = noise(&mut rng, 25, 25, 0.1, 0.5);
    let map = LocalMap::new(grid, &unthinned());
    let count = map.grid.count(Class::Occupied) as f64;
    let maps = [map.clone(), map];
    for t in [Se2::IDENTITY, placement(&mut rng, 30)] {
        let merged = Overlay::default().with(&maps, 0, t, 1.0, true);
        let at = |x: &Se2| Comparison::new(&maps, &merged, &maps[1], *x, 1.5);
        assert!(close(psi::psi(&at(&t), PsiClasses::Occupied), 2.0 * count));
        let shifted = t.compose(&Se2::new(3.0 * CELL, 0.0, 0.0));
        assert!(psi::psi(&at(&shifted), PsiClasses::Occupied) < 1.9 * count);
        // Far beyond the kernel's reach there is neither agreement nor contradiction.
        let far = t.compose(&Se2::new(60.0 * CELL, 0.0, 0.0));
        assert_eq!(psi::psi(&at(&far), PsiClasses::All), 0.0);
        assert_eq!(gamma::gamma(&at(&far)), 0.0);
    }
}

/// Thinned sums stand for the full ones: right on the average, and never far off.
#[test]
fn thinned_sums_are_unbiased() {
    let mut thin = Config::default();
    thin.perception.max_cells = 300;
    let (mut ratios, full) = (vec![Vec::new(); 3], unthinned());
    for seed in 0..30 {
        let scenes = [&thin, &full]
            .map(|config| Scene::new(&mut common::rng(100 + seed), 2, (70, 50), config));
        // There is something to thin: the smallest class has twice the cells that are kept.
        if scenes[0].maps.iter().any(|m| m.class_table(true).cells.scale < 1.2) {
            continue;
        }
        assert!(scenes[0].maps.iter().all(|m| m.class_table(true).cells.centers.len() <= 300));
        let [thin, full] = scenes.map(|s| {
            let c = s.comparison(1.5);
            [psi::psi(&c, PsiClasses::Occupied), psi::psi(&c, PsiClasses::All), gamma::gamma(&c)]
        });
        for k in 0..3 {
            let ratio = thin[k] / full[k];
            assert!((ratio - 1.0).abs() < 0.25, "sum {k}: {ratio}");
            ratios[k].push(ratio);
        }
    }
    for r in ratios {
        let n = r.len() as f64;
        assert!(n >= 15.0, "only {n} scenes");
        let mean = r.iter().sum::<f64>() / n;
        let error = (r.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0) / n).sqrt();
        assert!(error < 0.02 && (mean - 1.0).abs() < 4.0 * error, "{mean} +- {error}");
    }
}

proptest! {
    /// The normalised likelihood is the paper's formula, but for the floor under the worst pose.
    #[test]
    fn pools_are_normalised_as_printed(
        pool in prop::collection::vec((0.0..1000.0f64, -500.0..0.0f64), 1..30),
        floor in prop_oneof![Just(0.0), 0.0..0.2f64],
    ) {
        let (psi, gamma): (Vec<f64>, Vec<f64>) = pool.iter().copied().unzip();
        let n = pool::normalise(&psi, &gamma, floor);
        let lowest = gamma.iter().copied().fold(f64::INFINITY, f64::min);
        let range = gamma.iter().copied().fold(f64::NEG_INFINITY, f64::max) - lowest;
        prop_assume!(psi.iter().sum::<f64>() > 1e-3 && (range > 1e-3 || pool.len() == 1));
        let raised: Vec<f64> = gamma
            .iter()
            .map(|g| if pool.len() == 1 { 1.0 } else { (g - lowest).max(floor * range) })
            .collect();
        let product: Vec<f64> = psi.iter().zip(&raised).map(|(p, g)| p * g).collect();
        for (got, raw) in [(&n.psi, &psi), (&n.gamma, &raised), (&n.product, &product)] {
            prop_assert_eq!(got.len(), pool.len());
            let sum: f64 = raw.iter().sum();
            prop_assume!(sum > 1e-9);
            for (g, r) in got.iter().zip(raw) {
                prop_assert!((g - r / sum).abs() < 1e-9, "{g} of {}", r / sum);
            }
        }
    }
}

#[test]
fn layers_speak_by_the_samples_that_none_below_them_shows() {
    let config = Config::default();
    let map = LocalMap::new(office().draw("a", &Se2::IDENTITY, 0.05, |_| true), &config);
    let half = office().draw("b", &Se2::IDENTITY, 0.05, |p| p.x < 9.0);
    let maps = [LocalMap::new(half, &config), map];
    let on = |below: &Overlay, map: usize, x: f64| {
        below.with(&maps, map, Se2::new(x, 0.0, 0.0), 1.0, false)
    };
    let new = |o: &Overlay| o.layers().next().unwrap().new_samples(&maps).to_vec();
    let first = on(&Overlay::default(), 0, 0.0);
    assert_eq!(new(&first), (0..maps[0].samples.len() as u32).collect::<Vec<_>>());
    assert!(new(&on(&first, 0, 0.0)).is_empty(), "it shows all of itself");
    assert_eq!(new(&on(&first, 0, 400.0)).len(), maps[0].samples.len());
    // What lies beyond the half that is there already, and next to nothing before.
    let rest = new(&on(&first, 1, 0.0));
    let beyond = |k: &u32| maps[1].samples[*k as usize].position.x > 8.5;
    assert!(rest.iter().all(beyond), "{} new", rest.len());
    let far =
        (0..maps[1].samples.len() as u32).filter(|k| maps[1].samples[*k as usize].position.x > 9.9);
    assert!(far.into_iter().all(|k| rest.contains(&k)));
}
