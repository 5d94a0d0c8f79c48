//! Whole merges of drawn floors: poses come back, and what must not matter does not.

mod common;

use common::{any_frame, apart, office, rng, Plan};
use mapmeld_core::config::Config;
use mapmeld_core::error::Error;
use mapmeld_core::evidence::Status;
use mapmeld_core::grid::{OccupancyGrid, UNKNOWN};
use mapmeld_core::merge::merge;
use mapmeld_core::result::{Known, Merge, Stage};
use mapmeld_core::se2::{Se2, Vec2};
use rand_pcg::Pcg64Mcg;

const CELL: f64 = 0.1;

/// Maps of robots that each saw a part of the office, and their frames.
struct Robots {
    grids: Vec<OccupancyGrid>,
    frames: Vec<Se2>,
}

/// West, east and middle: each shares some 4 m of the 18 m, or more, with the next.
fn robots(rng: &mut Pcg64Mcg, n: usize) -> Robots {
    let spans = [(-1.0, 10.7), (6.3, 19.0), (3.0, 14.2)];
    let frames: Vec<Se2> = (0..n).map(|_| any_frame(rng)).collect();
    let grids = frames
        .iter()
        .zip(spans)
        .enumerate()
        .map(|(k, (t, (from, to)))| {
            office().draw(&format!("robot {k}"), t, CELL, |p| p.x > from && p.x < to)
        })
        .collect();
    Robots { grids, frames }
}

fn merged(grids: &[OccupancyGrid], known: &Known) -> Merge {
    merge(grids.to_vec(), known, &Config::default(), &|_, _, _| true).unwrap()
}

/// The middle of what all three robots share, in the frame of a map.
fn shared_place(frame: &Se2) -> Vec2 {
    frame.inverse().apply(Vec2::new(8.5, 5.0))
}

/// All maps are in one component and lie to each other as in truth.
fn assert_true_poses(m: &Merge, r: &Robots) {
    let at = |k: usize| {
        let p = &m.placements[k];
        assert_eq!((p.component, &p.status), (Some(0), &Status::Merged), "map {k}");
        p.t_component_map.unwrap()
    };
    for k in 1..r.grids.len() {
        let (found, truth) = (at(0).between(&at(k)), r.frames[0].between(&r.frames[k]));
        let (metres, degrees) = apart(&found, &truth, shared_place(&r.frames[k]));
        assert!(metres < 2.0 * CELL, "map {k} is {:.1} cells off", metres / CELL);
        assert!(degrees < 1.0, "map {k} is {degrees:.2} degrees off");
    }
}

/// Both merges tell of the same world: every pair of maps lies alike to within half a cell.
fn assert_same_world(x: &Merge, y: &Merge, map_of_y: &[usize], r: &Robots) {
    for i in 0..r.grids.len() {
        for j in 0..i {
            let between = |m: &Merge, i: usize, j: usize| {
                let (a, b) = (&m.placements[i], &m.placements[j]);
                assert_eq!(a.component, b.component);
                a.t_component_map.unwrap().between(&b.t_component_map.unwrap())
            };
            let (a, b) = (between(x, i, j), between(y, map_of_y[i], map_of_y[j]));
            let (metres, degrees) = apart(&a, &b, shared_place(&r.frames[j]));
            assert!(metres < 0.5 * CELL && degrees < 0.2, "{metres:.3} m, {degrees:.2} degrees");
        }
    }
}

#[test]
fn poses_come_back_from_any_frames() {
    for seed in 0..20 {
        let mut rng = rng(seed);
        let r = robots(&mut rng, if seed % 3 == 0 { 2 } else { 3 });
        let m = merged(&r.grids, &Known::default());
        assert_true_poses(&m, &r);
        assert_eq!(m.components.len(), 1);
        let c = &m.components[0];
        assert_eq!(c.order[0], c.reference);
        assert_eq!(m.placements[c.reference].t_component_map, Some(Se2::IDENTITY));
        assert_eq!(c.steps.len() + 1, r.grids.len(), "one step a map");
        // Half a cell is what drawing at an angle costs.
        assert!(c.rms.unwrap() < CELL, "{:?}", c.rms);
        assert!(c.fused.as_ref().is_ok_and(|f| f.shared > 1000 && f.conflicts < f.shared / 10));
    }
}

#[test]
fn the_order_of_the_maps_changes_nothing() {
    let r = robots(&mut rng(50), 3);
    let m = merged(&r.grids, &Known::default());
    for order in [[1, 0, 2], [2, 1, 0], [1, 2, 0]] {
        let grids: Vec<OccupancyGrid> = order.iter().map(|k| r.grids[*k].clone()).collect();
        let mut place = [0; 3];
        order.iter().enumerate().for_each(|(at, k)| place[*k] = at);
        let x = merged(&grids, &Known::default());
        for (k, at) in place.iter().enumerate() {
            let (a, b) = (&m.placements[k], &x.placements[*at]);
            assert_eq!(a.t_component_map, b.t_component_map);
            assert_eq!(a.covariance, b.covariance);
            assert_eq!(a.probability, b.probability);
        }
        assert_eq!(place[m.components[0].reference], x.components[0].reference);
        assert!(x.pairs.iter().all(|p| p.a < p.b));
        for p in &m.pairs {
            let (a, b) = (place[p.a], place[p.b]);
            let q = x.pairs.iter().find(|q| (q.a, q.b) == (a.min(b), a.max(b))).unwrap();
            let (t, u) = (p.found.modes[0].t_a_b, q.found.modes[0].t_a_b);
            let u = if a < b { u } else { u.inverse() };
            assert!(t.is_close_at(&u, Vec2::zeros(), 1e-9, 1e-9), "{t:?} {u:?}");
        }
    }
}

#[test]
fn a_known_order_and_a_named_reference_tell_of_the_same_world() {
    let r = robots(&mut rng(51), 3);
    let m = merged(&r.grids, &Known::default());
    for order in [vec![0, 1, 2], vec![1, 2, 0], vec![2]] {
        let known = Known { order: Some(order.clone()), ..Known::default() };
        let x = merged(&r.grids, &known);
        assert!(x.components[0].order.starts_with(&order), "{:?}", x.components[0].order);
        assert_same_world(&m, &x, &[0, 1, 2], &r);
    }
    for reference in 0..3 {
        let known = Known { references: vec![reference], ..Known::default() };
        let x = merged(&r.grids, &known);
        assert_eq!(x.components[0].reference, reference);
        assert_eq!(x.placements[reference].t_component_map, Some(Se2::IDENTITY));
        let pose = |m: &Merge, k: usize| m.placements[k].t_component_map.unwrap();
        for k in 0..3 {
            let (a, b) = (pose(&m, reference).between(&pose(&m, k)), pose(&x, k));
            assert!(a.is_close_at(&b, Vec2::zeros(), 1e-9, 1e-9), "{a:?} {b:?}");
        }
        assert_eq!(x.placements[reference].covariance.norm(), 0.0);
    }
}

#[test]
fn threads_do_not_change_a_bit() {
    let r = robots(&mut rng(52), 3);
    let with = |threads| {
        let config = Config { threads: Some(threads), ..Config::default() };
        let m = merge(r.grids.clone(), &Known::default(), &config, &|_, _, _| true).unwrap();
        let poses: Vec<[f64; 3]> =
            m.placements.iter().map(|p| p.t_component_map.unwrap().to_array()).collect();
        let covariances: Vec<_> = m.placements.iter().map(|p| p.covariance).collect();
        let steps = m.components[0].steps.clone();
        (poses, covariances, steps, m.components[0].fused.clone().map(|f| f.grid))
    };
    assert_eq!(with(1), with(2));
}

/// A round hall with three pillars shares nothing with the office.
#[test]
fn unrelated_maps_stay_apart() {
    let ring: Vec<(f64, f64)> = (0..=40)
        .map(|k| (k as f64 * std::f64::consts::TAU / 40.0).sin_cos())
        .map(|(s, c)| (5.0 + 4.0 * c, 5.0 + 4.0 * s))
        .collect();
    let hall = Plan { half: 0.1, ..Plan::default() }
        .floor([1.0, 1.0, 9.0, 9.0])
        .wall(&ring)
        .wall(&[(4.0, 4.0), (4.2, 4.1)])
        .wall(&[(6.1, 4.7), (6.1, 4.9)])
        .wall(&[(4.9, 6.6), (5.2, 6.4)]);
    for seed in 60..64 {
        let mut rng = rng(seed);
        let mut grids = robots(&mut rng, 2).grids;
        let in_hall = |p: Vec2| (p - Vec2::new(5.0, 5.0)).norm() < 4.2;
        grids.push(hall.draw("hall", &any_frame(&mut rng), CELL, in_hall));
        let m = merged(&grids, &Known::default());
        assert_eq!(m.components.len(), 2);
        assert_eq!(m.placements[0].component, m.placements[1].component);
        assert_eq!(m.placements[2].component, Some(1));
        assert_eq!(m.placements[2].status, Status::NoEvidence);
    }
}

#[test]
fn one_map_blank_maps_and_none() {
    let blank =
        OccupancyGrid::new("blank", 30, 20, CELL, Se2::IDENTITY, vec![UNKNOWN; 600]).unwrap();
    let r = robots(&mut rng(70), 2);

    let one = merged(&r.grids[..1], &Known::default());
    assert_eq!(one.components.len(), 1);
    assert_eq!(one.placements[0].t_component_map, Some(Se2::IDENTITY));
    assert_eq!(one.placements[0].status, Status::NoEvidence);
    assert_eq!(one.components[0].rms, None);

    let with_blank =
        merged(&[blank.clone(), r.grids[0].clone(), r.grids[1].clone()], &Known::default());
    assert_eq!(with_blank.components.len(), 1);
    let b = &with_blank.placements[0];
    assert_eq!((&b.status, b.component, b.t_component_map), (&Status::Blank, None, None));
    assert_eq!(with_blank.placements[1].component, with_blank.placements[2].component);

    let only_blank = merged(&[blank.clone(), blank], &Known::default());
    assert!(only_blank.components.is_empty());
    assert!(only_blank.placements.iter().all(|p| p.status == Status::Blank));

    let nothing = merged(&[], &Known::default());
    assert!(nothing.components.is_empty() && nothing.placements.is_empty());
}

#[test]
fn the_same_map_twice_lies_on_itself() {
    let grid = robots(&mut rng(71), 1).grids.remove(0);
    let m = merged(&[grid.clone(), grid], &Known { references: vec![0], ..Known::default() });
    let t = m.placements[1].t_component_map.unwrap();
    let (metres, degrees) = apart(&t, &Se2::IDENTITY, Vec2::new(0.0, 0.0));
    assert!(metres < 0.2 * CELL && degrees < 0.1, "{t:?}");
    assert_eq!(m.placements[1].component, Some(0));
    assert_eq!(m.components[0].fused.as_ref().map(|f| f.conflicts), Ok(0));
}

#[test]
fn an_observer_hears_all_stages_and_stops_any() {
    let r = robots(&mut rng(72), 2);
    let run = |observer: &(dyn Fn(Stage, usize, usize) -> bool + Sync)| {
        merge(r.grids.clone(), &Known::default(), &Config::default(), observer)
    };
    let heard = std::sync::Mutex::new(Vec::new());
    run(&|stage, done, total| {
        assert!(done <= total, "{stage:?}: {done} of {total}");
        let mut heard = heard.lock().unwrap();
        if !heard.contains(&stage) {
            heard.push(stage);
        }
        true
    })
    .unwrap();
    let heard = heard.into_inner().unwrap();
    assert!(heard.starts_with(&[Stage::Prepare, Stage::Register, Stage::Filter]), "{heard:?}");
    assert!(heard.len() >= 4, "{heard:?}");
    for stage in heard {
        let stopped = run(&|s, _, _| s != stage);
        assert_eq!(stopped.unwrap_err(), Error::Interrupted, "{stage:?} cannot be stopped");
    }
}

#[test]
fn what_is_known_is_checked() {
    let grids = robots(&mut rng(73), 2).grids;
    let fails = |order: Option<Vec<usize>>, reference: Option<usize>, key: &str| {
        let e = merge(
            grids.clone(),
            &Known { order, references: reference.into_iter().collect(), ..Known::default() },
            &Config::default(),
            &|_, _, _| true,
        );
        match e.unwrap_err() {
            Error::Config { key: k, .. } => assert_eq!(k, key),
            other => panic!("{other:?}"),
        }
    };
    fails(None, Some(2), "reference");
    fails(Some(vec![0, 2]), None, "order");
    fails(Some(vec![1, 1]), None, "order");
    fails(Some(vec![0, 1]), Some(1), "order");
}

/// Registering a on b and b on a finds inverse motions, with covariances to match.
#[test]
fn registration_is_symmetrical() {
    for seed in 80..84 {
        let mut r = robots(&mut rng(seed), 2);
        let place = shared_place(&r.frames[1]);
        let ab = merged(&r.grids, &Known::default()).pairs.remove(0);
        r.grids.reverse();
        let ba = merged(&r.grids, &Known::default()).pairs.remove(0);
        let (x, y) = (&ab.found.modes[0], &ba.found.modes[0]);
        let (metres, degrees) = apart(&x.t_a_b, &y.t_a_b.inverse(), place);
        assert!(metres < CELL && degrees < 0.5, "{metres:.3} m, {degrees:.2} degrees");
        assert!((x.evidence.log_likelihood / y.evidence.log_likelihood - 1.0).abs() < 0.1);
        let turned = y.t_a_b.inverse_covariance(&y.covariance);
        for k in 0..3 {
            let ratio = turned[(k, k)] / x.covariance[(k, k)];
            assert!((0.5..2.0).contains(&ratio), "variance {k}: {ratio}");
        }
    }
}
