//! Maps that are bent: unbent where they belong together, and not made to fit where they do not.

mod common;

use common::office;
use mapmeld_core::config::{Config, PerceptionConfig};
use mapmeld_core::grid::OccupancyGrid;
use mapmeld_core::local_map::LocalMap;
use mapmeld_core::perception::bend::unbend;
use mapmeld_core::perception::ceiling;
use mapmeld_core::perception::likelihood;
use mapmeld_core::perception::placed::{self, Placed};
use mapmeld_core::se2::{Se2, Vec2};

const CELL: f64 = 0.05;

/// The office as a robot sees it whose odometry runs off sideways, by so many metres at the far end.
fn office_off_by(most: f64) -> OccupancyGrid {
    let (w, h) = ((19.0 / CELL) as usize, (11.0 / CELL) as usize);
    let cells = (0..w * h)
        .map(|k| {
            let p = Vec2::new((k % w) as f64 + 0.5, (k / w) as f64 + 0.5) * CELL;
            let p = p - Vec2::new(0.5, 0.5);
            office().value(p - Vec2::new(0.0, most * (p.x / 18.0).powi(2)))
        })
        .collect();
    OccupancyGrid::new("bent", w, h, CELL, Se2::new(-0.5, -0.5, 0.0), cells).unwrap()
}

fn rungs() -> (Config, Vec<PerceptionConfig>) {
    let config = Config::default();
    let rungs = config.perception.rungs();
    (config, rungs)
}

#[test]
fn the_walls_of_a_bent_map_are_found_where_it_is_unbent() {
    let (config, rungs) = rungs();
    let straight = LocalMap::new(office_off_by(0.0), &config);
    let bent = LocalMap::new(office_off_by(0.5), &config);
    let middle = Se2::new(0.0, -0.15, -0.02);
    let p = &rungs[1];
    let rigid = likelihood::pair(&straight, &bent, &middle, usize::MAX, p);
    let unbent = placed::pair(&straight, &bent, &middle, p);
    assert!(unbent.hits > rigid.hits && unbent.spread < 0.1 * rigid.spread, "{unbent:?}");
    assert!(unbent.log_likelihood > rigid.log_likelihood + 10.0, "{rigid:?} {unbent:?}");
    assert!(unbent.bending > 0.0 && unbent.conflicts < 0.1 * unbent.hits, "{unbent:?}");
}

#[test]
fn a_straight_map_stays_as_it_is() {
    let (config, rungs) = rungs();
    let map = LocalMap::new(office_off_by(0.0), &config);
    let others = [Placed { map: &map, t_world_map: Se2::IDENTITY, samples: None }];
    for p in &rungs {
        let samples: Vec<_> = map.patches.iter().map(|p| p.blocks.as_slice()).collect();
        let found = unbend(&map, &Se2::IDENTITY, &others, (&samples, 1), p);
        assert_eq!(found.poses.len(), map.patches.len());
        for (pose, patch) in found.poses.iter().zip(&map.patches) {
            let moved = (pose.apply(patch.center) - patch.center).norm();
            assert!(moved < 0.2 * CELL && pose.theta.abs() < 0.01, "{pose:?}");
        }
        assert!(found.cost < 0.5, "{}", found.cost);
    }
}

/// A map whose far end lies a metre off is right still, once it is unbent.
#[test]
fn what_bending_mends_is_not_hopeless() {
    let (config, rungs) = rungs();
    let straight = LocalMap::new(office_off_by(0.0), &config);
    let softest = rungs.last().unwrap();
    for most in [0.5, 1.0] {
        let bent = LocalMap::new(office_off_by(most), &config);
        let [a, b] = [&straight, &bent]
            .map(|map| [Placed { map, t_world_map: Se2::IDENTITY, samples: None }]);
        let said = placed::between(&a, &b, softest).log_likelihood;
        let ceiling = ceiling::between(&a, &b, softest);
        assert!(said > 0.0 && ceiling > 0.9 * said, "off by {most} m: {said} under {ceiling}");
    }
}

#[test]
fn bending_costs_more_the_stiffer_a_map_is() {
    let (config, rungs) = rungs();
    let straight = LocalMap::new(office_off_by(0.0), &config);
    let bent = LocalMap::new(office_off_by(0.5), &config);
    let cost = |p: &PerceptionConfig| placed::pair(&straight, &bent, &Se2::IDENTITY, p);
    let stiff = PerceptionConfig { bend_shift: 0.1, bend_turn: 0.03, ..rungs[1].clone() };
    let soft = PerceptionConfig { bend_shift: 0.4, bend_turn: 0.12, ..rungs[1].clone() };
    assert!(cost(&stiff).bending > cost(&soft).bending, "{:?}", cost(&stiff));
}

#[test]
fn patches_hold_all_samples_once_and_hold_on_to_others() {
    let (config, _) = rungs();
    let map = LocalMap::new(office_off_by(0.2), &config);
    let mut seen: Vec<u32> = map.patches.iter().flat_map(|p| p.samples.clone()).collect();
    seen.sort_unstable();
    assert_eq!(seen, (0..map.samples.len() as u32).collect::<Vec<_>>());
    assert!(map.patches.len() > 4);
    for (k, p) in map.patches.iter().enumerate() {
        assert!(p.neighbours.len() >= 4);
        for (q, d) in &p.neighbours {
            assert!(*q as usize != k && *d >= 1.0);
            // What one patch holds on to holds on to it.
            assert!(map.patches[*q as usize].neighbours.contains(&(k as u32, *d)));
        }
    }
}

/// Thinned samples stand for those left out: a large map is no stiffer, and no less sure, than a small one.
#[test]
fn evidence_hardly_depends_on_how_many_samples_are_asked() {
    let (config, rungs) = rungs();
    let straight = LocalMap::new(office_off_by(0.0), &config);
    let bent = LocalMap::new(office_off_by(0.5), &config);
    let at = |max_samples: usize| {
        let p = PerceptionConfig { max_samples, ..rungs[1].clone() };
        placed::pair(&straight, &bent, &Se2::new(0.0, -0.15, -0.02), &p)
    };
    let (all, few) = (at(1_000_000), at(bent.samples.len() / 4));
    assert!((all.hits - few.hits).abs() < 0.1 * all.hits, "{all:?} {few:?}");
    assert!((all.bending - few.bending).abs() < 0.3 * all.bending + 0.5, "{all:?} {few:?}");
    assert!((all.log_likelihood - few.log_likelihood).abs() < 0.1 * all.log_likelihood);
}
