//! Which pairs of many maps are registered.

mod common;

use mapmeld_core::config::Config;
use mapmeld_core::result::Known;
use mapmeld_core::{partners, LocalMap, OccupancyGrid, Se2};
use rand::{Rng, SeedableRng};

/// A window of 12 m of one long building of rooms of random widths, in a frame of its own.
fn window(k: usize, walls: &[f64], from: f64, turn: f64) -> LocalMap {
    let t_map_world = Se2::new(0.3 * k as f64, -0.2, turn);
    let t_world_map = t_map_world.inverse();
    let (side, r) = (160, 0.1);
    let origin = Se2::new(-0.5 * side as f64 * r, -0.5 * side as f64 * r, 0.0);
    let middle = t_map_world.apply([from + 6.0, 3.0].into());
    let cells = (0..side * side).map(|i| {
        let at = [
            (i % side) as f64 * r + origin.x + middle.x,
            (i / side) as f64 * r + origin.y + middle.y,
        ];
        let p = t_world_map.apply(at.into());
        let is_near = |a: f64, b: f64| (a - b).abs() < 0.1;
        if p.x < from || p.x > from + 12.0 || p.y < -0.1 || p.y > 6.1 {
            -1
        } else if is_near(p.y, 0.0)
            || is_near(p.y, 6.0)
            || walls.iter().any(|x| is_near(p.x, *x) && (p.y - *x % 4.0 - 1.0).abs() > 0.5)
        {
            100
        } else {
            0
        }
    });
    let origin = Se2::new(origin.x + middle.x, origin.y + middle.y, 0.0);
    let grid = OccupancyGrid::new(format!("{k}"), side, side, r, origin, cells.collect()).unwrap();
    LocalMap::new(grid, &Config::default())
}

fn building(n: usize) -> Vec<LocalMap> {
    let mut rng = rand_pcg::Pcg64Mcg::seed_from_u64(4);
    let mut walls = vec![0.0];
    while walls[walls.len() - 1] < 5.0 * n as f64 + 10.0 {
        walls.push(walls[walls.len() - 1] + rng.random_range(1.4..3.6));
    }
    (0..n).map(|k| window(k, &walls, 4.0 * k as f64, rng.random_range(-3.0..3.0))).collect()
}

fn with_partners(partners: Option<usize>) -> Config {
    let mut config = Config::default();
    config.registration.partners = partners;
    config
}

#[test]
fn few_maps_are_all_partners_and_so_are_many_when_asked() {
    let maps = building(6);
    let all: Vec<(usize, usize)> = (0..6).flat_map(|a| (a + 1..6).map(move |b| (a, b))).collect();
    assert_eq!(partners::pairs(&maps, &Known::default(), &with_partners(None)), all);
    assert_eq!(partners::pairs(&maps, &Known::default(), &with_partners(Some(5))), all);
}

#[test]
fn neighbours_of_a_long_building_are_among_few_partners() {
    let maps = building(24);
    let pairs = partners::pairs(&maps, &Known::default(), &with_partners(Some(4)));
    assert!(pairs.len() <= 4 * 24 && pairs.iter().all(|(a, b)| a < b));
    let found = (0..23).filter(|k| pairs.contains(&(*k, k + 1))).count();
    assert!(found >= 21, "{found} of 23");
}

#[test]
fn the_choice_does_not_depend_on_the_order_of_the_maps() {
    let maps = building(16);
    let backwards: Vec<LocalMap> = maps.iter().rev().cloned().collect();
    let config = with_partners(Some(3));
    let one = partners::pairs(&maps, &Known::default(), &config);
    let mut other: Vec<(usize, usize)> = partners::pairs(&backwards, &Known::default(), &config)
        .into_iter()
        .map(|(a, b)| (15 - b, 15 - a))
        .collect();
    other.sort_unstable();
    assert_eq!(one, other);
}

#[test]
fn a_known_order_and_priors_add_pairs() {
    use mapmeld_core::prior::Prior;
    let maps = building(16);
    let config = with_partners(Some(1));
    let before = partners::pairs(&maps, &Known::default(), &config);
    let order: Vec<usize> = (0..16).map(|k| k * 5 % 16).collect();
    let known = Known { order: Some(order.clone()), ..Known::default() };
    let pairs = partners::pairs(&maps, &known, &config);
    assert!(order.windows(2).all(|w| pairs.contains(&(w[0].min(w[1]), w[0].max(w[1])))));
    let mut priors = vec![None; 16];
    let at = |m: usize, x: f64| {
        let c = maps[m].center.unwrap();
        Prior::new(Se2::new(x - c.x, -c.y, 0.0), [0.1, 0.1, 0.1])
    };
    (priors[2], priors[9], priors[13]) = (Some(at(2, 0.0)), Some(at(9, 2.0)), Some(at(13, 500.0)));
    let known = Known { priors, ..Known::default() };
    let pairs = partners::pairs(&maps, &known, &config);
    assert!(pairs.contains(&(2, 9)));
    let new: Vec<_> = pairs.iter().filter(|p| !before.contains(p)).collect();
    assert!(new.iter().all(|p| **p == (2, 9)), "{new:?}");
}
