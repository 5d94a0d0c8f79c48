//! Fusion of placed maps: rules, resolutions, walls that survive any rotation.

use mapmeld_core::config::{FuseConfig, FuseRule};
use mapmeld_core::error::Error;
use mapmeld_core::fuse::{fuse, Fused};
use mapmeld_core::grid::{class_of, Class, OccupancyGrid, UNKNOWN};
use mapmeld_core::se2::{Se2, Vec2};
use proptest::prelude::*;

fn grid(w: usize, resolution: f64, origin: Se2, cells: Vec<i8>) -> OccupancyGrid {
    OccupancyGrid::new("g", w, cells.len() / w, resolution, origin, cells).unwrap()
}

fn rule(rule: FuseRule) -> FuseConfig {
    FuseConfig { rule, ..FuseConfig::default() }
}

/// Value of the merged map at a point of its frame.
fn at(fused: &Fused, x: f64, y: f64) -> i8 {
    fused.grid.locator().index(Vec2::new(x, y)).map_or(UNKNOWN, |k| fused.grid.cells()[k])
}

/// Cells far from each other, each map with its own view of them: F free, O occupied, . unknown.
fn views(maps: &[&str], config: &FuseConfig) -> (String, Fused) {
    let grids: Vec<OccupancyGrid> = maps
        .iter()
        .map(|m| {
            let value = |c| match c {
                'F' => 0,
                'O' => 100,
                _ => UNKNOWN,
            };
            let cells = m.chars().flat_map(|c| [UNKNOWN, value(c), UNKNOWN]).collect();
            grid(3 * m.len(), 0.5, Se2::IDENTITY, cells)
        })
        .collect();
    let placed: Vec<_> = grids.iter().map(|g| (g, Se2::IDENTITY)).collect();
    let fused = fuse("m", &placed, config).unwrap();
    let letter = |k: usize| match class_of(at(&fused, 0.5 * (3 * k + 1) as f64 + 0.25, 0.25)) {
        Class::Free => 'F',
        Class::Occupied => 'O',
        Class::Unknown => '.',
    };
    ((0..maps[0].len()).map(letter).collect(), fused)
}

/// The middle row of maps of columns of walls, fused by log-odds.
fn columns(maps: &[&str]) -> (String, Fused) {
    let grids: Vec<OccupancyGrid> = maps
        .iter()
        .map(|m| {
            let row = || m.chars().map(|c| if c == 'O' { 100 } else { 0 });
            let cells = (0..3).flat_map(|_| row().collect::<Vec<i8>>()).collect();
            grid(m.len(), 0.5, Se2::IDENTITY, cells)
        })
        .collect();
    let placed: Vec<_> = grids.iter().map(|g| (g, Se2::IDENTITY)).collect();
    let fused = fuse("m", &placed, &FuseConfig::default()).unwrap();
    let letter = |k: usize| if at(&fused, 0.5 * k as f64 + 0.25, 0.75) == 100 { 'O' } else { 'F' };
    ((0..maps[0].len()).map(letter).collect(), fused)
}

#[test]
fn walls_within_a_cell_of_each_other_are_one() {
    let (row, fused) = columns(&["FFOFFFF", "FFFOFFF"]);
    assert_eq!((row.as_str(), fused.conflicts), ("FFOFFFF", 0), "where the first has it");
    let (row, fused) = columns(&["FFOFFFF", "FFFOFFF", "FOFFFFF"]);
    assert_eq!((row.as_str(), fused.conflicts), ("FFOFFFF", 0));
    // Two cells apart they are two walls, and each is disputed.
    let (row, fused) = columns(&["FFOFFFF", "FFFFOFF"]);
    assert_eq!((row.as_str(), fused.conflicts), ("FFOFOFF", 6));
    // A wall that one map alone shows stays, and so do the two sides of a thick one.
    assert_eq!(columns(&["FFOOFFF", "FFOOFFF"]).0, "FFOOFFF");
}

#[test]
fn a_gap_in_a_wall_is_closed_by_a_map_that_has_none() {
    let wall = |gap: Option<usize>| {
        let cells =
            (0..35).map(|k| if k / 7 == 2 && Some(k % 7) != gap { 100 } else { 0 }).collect();
        grid(7, 0.5, Se2::IDENTITY, cells)
    };
    let (broken, whole) = (wall(Some(3)), wall(None));
    let placed = [(&broken, Se2::IDENTITY), (&whole, Se2::IDENTITY)];
    let fused = fuse("m", &placed, &FuseConfig::default()).unwrap();
    assert!((0..7).all(|k| at(&fused, 0.5 * k as f64 + 0.25, 1.25) == 100));
}

#[test]
fn rules_differ_where_maps_do() {
    let two = ["FOFO.F.", "FOOF..."];
    for r in [FuseRule::LogOdds, FuseRule::Max, FuseRule::Latest] {
        let (_, fused) = views(&two, &rule(r));
        assert_eq!((fused.conflicts, fused.shared), (2, 4), "{r:?}");
    }
    assert_eq!(views(&two, &rule(FuseRule::Max)).0, "FOOO.F.");
    assert_eq!(views(&two, &rule(FuseRule::Latest)).0, "FOOF.F.");
    // One hit outweighs one or two misses, not three.
    assert_eq!(views(&two, &rule(FuseRule::LogOdds)).0, "FOOO.F.");
    let many = ["OFFO", "FOFO", "F.FF", ".FOF", "..F."];
    assert_eq!(views(&many, &rule(FuseRule::LogOdds)).0, "OOFO");
    assert_eq!(views(&many, &rule(FuseRule::Max)).0, "OOOO");
    assert_eq!(views(&many, &rule(FuseRule::Latest)).0, "FFFF");
}

#[test]
fn the_order_matters_to_the_latest_only() {
    let (forth, back) = (["FOF.O", "OF.FF", "OOFFF"], ["OOFFF", "OF.FF", "FOF.O"]);
    for r in [FuseRule::LogOdds, FuseRule::Max] {
        let (a, b) = (views(&forth, &rule(r)).1, views(&back, &rule(r)).1);
        assert_eq!(a.grid, b.grid);
        assert_eq!((a.conflicts, a.shared), (b.conflicts, b.shared));
    }
    assert_ne!(views(&forth, &rule(FuseRule::Latest)).0, views(&back, &rule(FuseRule::Latest)).0);
}

#[test]
fn the_finest_resolution_wins_unless_one_is_asked_for() {
    // A room of 3 m x 2 m with a wall along x = 2, at two resolutions.
    let room = |r: f64| {
        let (w, h) = ((3.0 / r) as usize, (2.0 / r) as usize);
        let wall = |k: usize| ((k % w) as f64 + 0.5) * r;
        let value = |k| if (1.8..2.2).contains(&wall(k)) { 100 } else { 0 };
        grid(w, r, Se2::IDENTITY, (0..w * h).map(value).collect())
    };
    let (coarse, fine) = (room(0.2), room(0.05));
    // The fine one lies 1 m further up: half of it shared.
    let placed = [(&coarse, Se2::IDENTITY), (&fine, Se2::new(0.0, 1.0, 0.0))];
    for (asked, expected) in [(None, 0.05), (Some(0.1), 0.1), (Some(0.4), 0.4)] {
        let fused = fuse("m", &placed, &FuseConfig { resolution: asked, ..FuseConfig::default() });
        let fused = fused.unwrap();
        assert_eq!(fused.grid.resolution(), expected);
        for y in [0.4, 1.4, 2.6] {
            assert_eq!(class_of(at(&fused, 1.0, y)), Class::Free);
            assert_eq!(class_of(at(&fused, 2.05, y)), Class::Occupied);
            assert_eq!(class_of(at(&fused, 2.8, y)), Class::Free);
        }
        assert_eq!(at(&fused, 3.5, 1.0), UNKNOWN);
        // 3 m x 1 m is shared.
        let shared = fused.shared as f64 * expected * expected;
        assert!((shared - 3.0).abs() < 6.0 * expected, "{shared} square metres");
    }
}

/// Origins that are turned belong to the map, not to its pose.
#[test]
fn a_turned_origin_and_a_turned_pose_are_the_same() {
    let cells = || (0..30 * 20).map(|k| [0, 100, UNKNOWN, 0, 0][k * 7 % 11 % 5]).collect();
    let origin = Se2::new(3.0, -1.0, 0.7);
    let turned = grid(30, 0.1, origin, cells());
    let plain = grid(30, 0.1, Se2::IDENTITY, cells());
    let pose = Se2::new(-2.0, 4.0, -1.9);
    let a = fuse("m", &[(&turned, pose)], &FuseConfig::default()).unwrap();
    let b = fuse("m", &[(&plain, pose.compose(&origin))], &FuseConfig::default()).unwrap();
    assert_eq!(a.grid, b.grid);
}

#[test]
fn one_map_in_place_is_itself() {
    let cells: Vec<i8> = (0..40 * 30).map(|k| [0, 100, UNKNOWN, 0][k * 13 % 17 % 4]).collect();
    let g = grid(40, 0.1, Se2::new(-1.2, 0.7, 0.0), cells);
    let fused = fuse("m", &[(&g, Se2::IDENTITY)], &FuseConfig::default()).unwrap();
    for row in 0..30 {
        for col in 0..40 {
            let p = g.cell_center(row, col);
            assert_eq!(class_of(at(&fused, p.x, p.y)), g.class(row, col), "({row}, {col})");
        }
    }
    assert_eq!((fused.conflicts, fused.shared), (0, 0));
}

#[test]
fn nothing_known_and_too_much_asked_are_errors() {
    let blank = grid(3, 0.1, Se2::IDENTITY, vec![UNKNOWN; 9]);
    assert!(matches!(
        fuse("m", &[(&blank, Se2::IDENTITY)], &FuseConfig::default()),
        Err(Error::Grid { field: "cells", .. })
    ));
    let g = grid(3, 0.1, Se2::IDENTITY, vec![0; 9]);
    let far = [(&g, Se2::IDENTITY), (&g, Se2::new(1e5, 1e5, 0.0))];
    match fuse("m", &far, &FuseConfig::default()) {
        Err(Error::Config { key, .. }) => assert_eq!(key, "fuse.resolution"),
        other => panic!("{other:?}"),
    }
}

/// True when a path of occupied cells (eight neighbours) leads from one point to the other.
fn connected(fused: &Fused, from: Vec2, to: Vec2) -> bool {
    let g = &fused.grid;
    let near = |p: Vec2, k: usize| {
        (g.cell_center(k / g.width(), k % g.width()) - p).norm() < 2.0 * g.resolution()
    };
    let walls: Vec<usize> =
        (0..g.cells().len()).filter(|k| class_of(g.cells()[*k]) == Class::Occupied).collect();
    let mut seen = vec![false; g.cells().len()];
    let mut todo: Vec<usize> = walls.into_iter().filter(|k| near(from, *k)).collect();
    while let Some(k) = todo.pop() {
        if std::mem::replace(&mut seen[k], true) {
            continue;
        }
        if near(to, k) {
            return true;
        }
        let (row, col) = ((k / g.width()) as isize, (k % g.width()) as isize);
        for (r, c) in (-1..=1).flat_map(|r| (-1..=1).map(move |c| (row + r, col + c))) {
            if g.class_or_unknown(r, c) == Class::Occupied {
                todo.push(r as usize * g.width() + c as usize);
            }
        }
    }
    false
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]

    /// A wall of one cell has no gap and no hole, however the map is turned and shifted.
    #[test]
    fn thin_walls_survive_every_rotation(
        x in -5.0..5.0f64, y in -5.0..5.0f64, theta in -3.2..3.2f64, yaw in -3.2..3.2f64,
    ) {
        let (w, h) = (60, 11);
        let cells = (0..w * h).map(|k| if k / w == 5 { 100 } else { 0 }).collect();
        let g = grid(w, 0.1, Se2::new(y, x, yaw), cells);
        let pose = Se2::new(x, y, theta);
        let fused = fuse("m", &[(&g, pose)], &FuseConfig::default()).unwrap();
        let ends = [0, w - 1].map(|col| pose.apply(g.cell_center(5, col)));
        prop_assert!(connected(&fused, ends[0], ends[1]), "the wall is cut");
        // It stays thin: at most the cells within one cell of its line.
        let walls = fused.grid.count(Class::Occupied);
        prop_assert!(walls <= 3 * w, "{walls} cells of wall");
    }

    /// The origin lies on whole multiples of the resolution, yaw 0, and a margin is unknown.
    #[test]
    fn the_frame_is_regular(
        x in -50.0..50.0f64, y in -50.0..50.0f64, theta in -3.2..3.2f64, cell in 0.02..0.5f64,
    ) {
        let g = grid(7, 0.1, Se2::new(0.3, -0.2, 0.1), vec![0; 35]);
        let asked = FuseConfig { resolution: Some(cell), ..FuseConfig::default() };
        let fused = fuse("m", &[(&g, Se2::new(x, y, theta))], &asked).unwrap().grid;
        let o = fused.origin();
        prop_assert_eq!(o.theta, 0.0);
        for v in [o.x / cell, o.y / cell] {
            prop_assert!((v - v.round()).abs() < 1e-6);
        }
        let (w, h) = (fused.width(), fused.height());
        for (k, v) in fused.cells().iter().enumerate() {
            let edge = k % w == 0 || k % w == w - 1 || k / w == 0 || k / w == h - 1;
            prop_assert!(!edge || *v == UNKNOWN);
        }
        // What is known keeps its area, 0.7 m x 0.5 m.
        let area = fused.count(Class::Free) as f64 * cell * cell;
        prop_assert!((area - 0.35).abs() <= 2.4 * cell + 2.0 * cell * cell, "{area}");
    }
}
