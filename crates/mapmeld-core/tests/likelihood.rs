//! The evidence of oriented walls: the same from either side, and in no need of any frame.

mod common;

use common::{any_frame, office, rng, Plan};
use mapmeld_core::config::Config;
use mapmeld_core::local_map::LocalMap;
use mapmeld_core::perception::placed::Placed;
use mapmeld_core::perception::{ceiling, placed, Overlay, WallEvidence};
use mapmeld_core::se2::Se2;
use rand::Rng;

const CELL: f64 = 0.1;

/// West and east of the office in frames of their own, and `T_a_b`.
fn two(seed: u64) -> ([LocalMap; 2], Se2) {
    let mut rng = rng(seed);
    let (ta, tb) = (any_frame(&mut rng), any_frame(&mut rng));
    let config = Config::default();
    let maps = [
        LocalMap::new(office().draw("a", &ta, CELL, |p| p.x < 10.7), &config),
        LocalMap::new(office().draw("b", &tb, CELL, |p| p.x > 6.3), &config),
    ];
    (maps, ta.between(&tb))
}

fn assert_same(x: &WallEvidence, y: &WallEvidence) {
    let numbers = |e: &WallEvidence| {
        let second = e.second_direction();
        [e.log_likelihood, e.hits, e.misses, e.opposed, e.conflicts, e.shared_length, second]
    };
    for (k, (a, b)) in numbers(x).into_iter().zip(numbers(y)).enumerate() {
        assert!((a - b).abs() < 1e-6 * a.abs().max(1.0), "number {k}: {a} and {b}");
    }
}

#[test]
fn it_does_not_matter_which_map_is_laid_on_which() {
    let p = Config::default().perception;
    for seed in 0..5 {
        let ([a, b], t) = two(seed);
        // At the truth, and where much is contradicted.
        for t in [t, t.compose(&Se2::new(0.7, -0.4, 0.3))] {
            let forth = placed::pair(&a, &b, &t, &p);
            assert!(forth.hits > 1.0);
            assert_same(&forth, &placed::pair(&b, &a, &t.inverse(), &p));
        }
    }
}

#[test]
fn a_merged_map_of_one_map_is_that_map() {
    let mut p = Config::default().perception;
    p.max_samples = 1_000_000; // None left out.
    for seed in 10..13 {
        let (maps, t) = two(seed);
        let world = any_frame(&mut rng(seed + 100));
        let merged = Overlay::default().with(&maps, 0, world, 1.0, false);
        let against = placed::against(&maps, &merged, 1, &world.compose(&t), &p);
        assert_same(&placed::pair(&maps[0], &maps[1], &t, &p), &against);
    }
}

#[test]
fn the_truth_is_better_than_nothing_and_than_its_neighbours() {
    let p = Config::default().perception;
    for seed in 20..25 {
        let ([a, b], t) = two(seed);
        let at = |t: &Se2| placed::pair(&a, &b, t, &p);
        let truth = at(&t);
        assert!(truth.log_likelihood > 20.0 && truth.agreement() > 0.9, "{truth:?}");
        let center = Se2::from_parts(b.center.unwrap(), 0.0);
        for off in [[0.5, 0.0, 0.0], [0.0, -0.5, 0.0], [0.0, 0.0, 0.1], [0.0, 0.0, 3.1]] {
            let moved = center.compose(&Se2::from(off)).compose(&center.inverse());
            assert!(at(&t.compose(&moved)).log_likelihood < truth.log_likelihood - 10.0);
        }
    }
}

/// What a corridor shows lies in one direction, in whatever frames it was drawn.
#[test]
fn a_bare_corridor_has_no_second_direction() {
    let config = Config::default();
    let plan = Plan { half: 0.1, ..Plan::default() }
        .floor([0.0, 0.0, 12.0, 2.0])
        .wall(&[(-1.0, 0.0), (13.0, 0.0)])
        .wall(&[(-1.0, 2.0), (13.0, 2.0)]);
    let draw =
        |t: &Se2| LocalMap::new(plan.draw("c", t, CELL, |p| p.x > 0.0 && p.x < 12.0), &config);
    let mut rng = rng(30);
    for _ in 0..5 {
        let (ta, tb) = (any_frame(&mut rng), any_frame(&mut rng));
        let maps = [draw(&ta), draw(&tb)];
        let e = placed::pair(&maps[0], &maps[1], &ta.between(&tb), &config.perception);
        assert!(e.hits > 5.0, "{e:?}");
        let second = e.second_direction();
        assert!(second < 0.05 * e.hits, "{second:.2} of {:.2} in a second direction", e.hits);
        let merged = Overlay::default().with(&maps, 0, ta, 1.0, false);
        let second = placed::against(&maps, &merged, 1, &tb, &config.perception);
        assert!(second.second_direction() < 0.05 * e.hits, "{second:?}");
    }
    // Rooms have one.
    let ([a, b], t) = two(31);
    let e = placed::pair(&a, &b, &t, &config.perception);
    assert!(e.second_direction() > 0.2 * e.hits, "{e:?}");
}

/// Poses that the walls speak for are not told hopeless, and most of those that they speak against clearly are.
#[test]
fn the_ceiling_tells_hopeless_poses() {
    let p = Config::default().perception;
    let (mut spoken_for, mut hopeless, mut told) = (0, 0, 0);
    for seed in 0..6 {
        let ([a, b], truth) = two(seed);
        let mut rng = rng(seed + 50);
        for k in 0..120 {
            // About the truth, and anywhere.
            let far = if k % 2 == 0 { 0.4 } else { 8.0 };
            let mut by = |far: f64| rng.random_range(-far..far);
            let t = truth.compose(&Se2::new(by(far), by(far), by(0.4 * far)));
            let at = |map, t_world_map| [Placed { map, t_world_map, samples: None }];
            let (a, b) = (at(&a, Se2::IDENTITY), at(&b, t));
            let most = ceiling::between(&a, &b, &p);
            let of_one = ceiling::of(&b[0], &a, &p);
            let said = placed::between(&a, &b, &p).log_likelihood;
            if said > 0.0 {
                spoken_for += 1;
                assert!(most > -5.0, "the walls say {said}, their ceiling is {most}");
                assert!(of_one > -20.0, "the walls say {said}, those of one map {of_one}");
            }
            if said < -60.0 {
                hopeless += 1;
                told += usize::from(most < -20.0 && of_one < -20.0);
            }
        }
    }
    assert!(spoken_for > 50 && hopeless > 50, "{spoken_for} spoken for, {hopeless} hopeless");
    assert!(2 * told > hopeless, "{told} of {hopeless} hopeless poses are told");
}
