//! Joint refinement: poses come back, and what the walls leave open is said to be open.

mod common;

use common::{any_frame, apart, office, rng, Plan};
use mapmeld_core::config::Config;
use mapmeld_core::grid::OccupancyGrid;
use mapmeld_core::local_map::LocalMap;
use mapmeld_core::pair_table::PairTable;
use mapmeld_core::prior::Prior;
use mapmeld_core::refine::{self, Refined};
use mapmeld_core::registration::pair;
use mapmeld_core::result::Known;
use mapmeld_core::se2::{Se2, Vec2};
use mapmeld_core::verdict;
use nalgebra::{Matrix3, Vector3};
use rand::Rng;
use rand_pcg::Pcg64Mcg;

const CELL: f64 = 0.05;

/// Maps of overlapping parts of the office, and their frames.
fn robots(rng: &mut Pcg64Mcg, n: usize) -> (Vec<LocalMap>, Vec<Se2>) {
    let spans = [(-1.0, 8.0), (4.5, 12.8), (9.0, 19.0), (2.0, 15.0)];
    let frames: Vec<Se2> = (0..n).map(|_| any_frame(rng)).collect();
    let maps = frames
        .iter()
        .zip(spans)
        .map(|(t, (from, to))| {
            let grid = office().draw("robot", t, CELL, |p| p.x > from && p.x < to);
            LocalMap::new(grid, &Config::default())
        })
        .collect();
    (maps, frames)
}

/// True poses in the frame of the anchor, and the same a little off: up to 10 cm and 1.5 degrees
/// at the middle of each map. The anchor's is exact.
fn perturbed(
    rng: &mut Pcg64Mcg,
    maps: &[LocalMap],
    frames: &[Se2],
    anchor: usize,
) -> (Vec<Se2>, Vec<Se2>) {
    let truth: Vec<Se2> = frames.iter().map(|t| frames[anchor].between(t)).collect();
    let off = truth
        .iter()
        .enumerate()
        .map(|(k, t)| {
            if k == anchor {
                return *t;
            }
            let mut r = |most: f64| rng.random_range(-most..most);
            let (dx, dy, turn) = (r(0.1), r(0.1), r(1.5f64.to_radians()));
            let center = maps[k].center.unwrap();
            let turned = Se2::from_parts(center, turn).compose(&Se2::from_parts(-center, 0.0));
            let moved = t.compose(&turned);
            Se2::new(moved.x + dx, moved.y + dy, moved.theta)
        })
        .collect();
    (truth, off)
}

/// Refined without modes of pairs: as their own walls lead them.
fn refine(
    maps: &[LocalMap],
    members: &[usize],
    poses: &[Se2],
    held: &[usize],
    known: &Known,
    config: &Config,
) -> Refined {
    refine::refine(
        maps,
        members,
        poses,
        held,
        &PairTable::new(maps.len(), Vec::new()),
        known,
        config,
    )
}

fn is_covariance(c: &Matrix3<f64>) -> bool {
    let symmetric = (c - c.transpose()).norm() <= 1e-9 * c.norm();
    c.iter().all(|v| v.is_finite()) && symmetric && c.symmetric_eigenvalues().min() > 0.0
}

fn worst(maps: &[LocalMap], poses: &[Se2], truth: &[Se2]) -> (f64, f64) {
    let off = |k: usize| apart(&poses[k], &truth[k], maps[k].center.unwrap());
    (0..maps.len()).map(off).fold((0.0, 0.0), |m, o| (m.0.max(o.0), m.1.max(o.1)))
}

#[test]
fn perturbed_poses_come_back() {
    for seed in 0..12 {
        let mut rng = rng(seed);
        let n = 3 + (seed % 2) as usize;
        let (maps, frames) = robots(&mut rng, n);
        let anchor = seed as usize % n;
        let (truth, off) = perturbed(&mut rng, &maps, &frames, anchor);
        assert!(worst(&maps, &off, &truth).0 > 0.05, "nothing to refine");
        let members: Vec<usize> = (0..n).collect();
        let r = refine(&maps, &members, &off, &[anchor], &Known::default(), &Config::default());
        let (metres, degrees) = worst(&maps, &r.poses, &truth);
        assert!(metres < 0.3 * CELL, "seed {seed}: {:.2} cells off", metres / CELL);
        assert!(degrees < 0.15, "seed {seed}: {degrees:.3} degrees off");
        assert!(r.rms.unwrap() < 0.7 * CELL, "{:?}", r.rms);

        assert_eq!(r.poses[anchor], off[anchor], "the anchor moved");
        assert_eq!(r.covariances[anchor], Matrix3::zeros());
        for (k, c) in r.covariances.iter().enumerate().filter(|(k, _)| *k != anchor) {
            assert!(is_covariance(c), "seed {seed}, map {k}: {c}");
            // Walls in all directions: every axis is known to a few cells and degrees.
            assert!(c[(0, 0)].max(c[(1, 1)]).sqrt() < 0.5, "{c}");
        }
    }
}

/// As it is with bent maps, which are merged and do not fit once they are rigid.
#[test]
fn what_nothing_joins_is_held_by_the_walls_that_agree_most() {
    let mut config = Config::default();
    config.perception.hit = 0.1;
    config.perception.miss = -20.0;
    let mut rng = rng(7);
    let (maps, frames) = robots(&mut rng, 3);
    let (truth, off) = perturbed(&mut rng, &maps, &frames, 0);
    let refined = |known: &Known| refine(&maps, &[0, 1, 2], &off, &[0], known, &config);
    let r = refined(&Known::default());
    assert!(worst(&maps, &r.poses, &truth).0 < 0.3 * CELL);
    for c in &r.covariances[1..] {
        assert!(is_covariance(c) && c[(0, 0)].max(c[(1, 1)]).sqrt() < 0.5, "{c}");
    }
    // Of what was told, walls that do not agree say nothing.
    let covariance = Matrix3::from_diagonal(&Vector3::new(0.1, 0.1, 0.1));
    let prior = |t: &Se2| Some(Prior { t_world_map: *t, covariance, is_pinned: false });
    let told = refined(&Known { priors: off.iter().map(prior).collect(), ..Known::default() });
    assert_eq!(told.poses, off);
}

/// Which walls agree is known only once the maps lie right: the answer is where they pull at each other then.
#[test]
fn what_was_refined_stays() {
    // With one round nine of these end elsewhere when they are refined again.
    for seed in 0..26 {
        let mut rng = rng(seed);
        let (maps, frames) = robots(&mut rng, 4);
        let (_, mut off) = perturbed(&mut rng, &maps, &frames, 0);
        // So far off that some walls which belong together do not agree yet.
        for (k, t) in off.iter_mut().enumerate().skip(1) {
            let far = 0.12 * k as f64;
            let mut by = || rng.random_range(-far..far);
            *t = Se2::new(by(), by(), 0.05 * by()).compose(t);
        }
        let again = |poses: &[Se2]| {
            refine(&maps, &[0, 1, 2, 3], poses, &[0], &Known::default(), &Config::default())
        };
        let once = again(&off);
        let twice = again(&once.poses);
        let (metres, degrees) = worst(&maps, &twice.poses, &once.poses);
        assert!(metres < 0.05 * CELL && degrees < 0.02, "seed {seed}: {metres} m, {degrees}");
    }
}

/// A hall with rows of shelves: walls find their neighbours' places as well. Only pairs, which look for the place where
/// all fits, know better.
fn shelves(name: &str, below: f64, above: f64) -> LocalMap {
    let mut plan = Plan { half: 0.05, ..Plan::default() }.floor([0.0, 0.0, 14.0, 8.0]);
    plan = plan.wall(&[(0.0, 0.0), (14.0, 0.0), (14.0, 8.0), (0.0, 8.0), (0.0, 0.0)]);
    for k in 0..30 {
        let x = 1.0 + 0.4 * k as f64;
        plan = plan.wall(&[(x, 1.5), (x, 4.0 + 0.3 * (k % 5) as f64)]);
    }
    let grid = plan.draw(name, &Se2::IDENTITY, CELL, |p| p.y > below && p.y < above);
    LocalMap::new(grid, &Config::default())
}

#[test]
fn a_map_leaves_an_optimum_that_its_pairs_contradict() {
    let config = Config::default();
    let maps = [shelves("a", -1.0, 6.0), shelves("b", 1.0, 9.0), shelves("c", -1.0, 9.0)];
    let judged = |(a, b): (usize, usize)| {
        let mirrored = maps[b].mirrored();
        let found = pair::register(&maps[a], &maps[b], Some(&mirrored), &[], (a, b), &config);
        verdict::of_pair(found, 0, [&maps[a], &maps[b]], &config)
    };
    let pairs = PairTable::new(3, [(0, 1), (0, 2), (1, 2)].map(judged).to_vec());
    for (k, off) in [(1, 0.37), (2, -0.37), (1, -0.37)] {
        let mut start = [Se2::IDENTITY; 3];
        start[k].x = off;
        let stuck = refine(&maps, &[0, 1, 2], &start, &[0], &Known::default(), &config);
        assert!(stuck.poses[k].x.abs() > 0.3, "nothing to leave: {:?}", stuck.poses);
        let refined = |known: &Known| {
            refine::refine(&maps, &[0, 1, 2], &start, &[0], &pairs, known, &config).poses
        };
        let free = refined(&Known::default());
        assert!(worst(&maps, &free, &[Se2::IDENTITY; 3]).0 < 0.3 * CELL, "{free:?}");
        // What was told stays as it would without pairs, and what is forbidden is not asked.
        let covariance = Matrix3::from_diagonal(&Vector3::new(0.1, 0.1, 0.1));
        let prior = |t: &Se2| Some(Prior { t_world_map: *t, covariance, is_pinned: false });
        let told = Known { priors: start.iter().map(prior).collect(), ..Known::default() };
        assert_eq!(refined(&told), stuck.poses);
        let forbidden = Known { forbidden: vec![(0, 1), (0, 2), (1, 2)], ..Known::default() };
        assert_eq!(refined(&forbidden), start);
    }
}

/// Frames may have their origins kilometres from the walls, as those of maps in map coordinates do.
#[test]
fn far_frames_are_refined_as_near_ones() {
    let mut rng = rng(7);
    let (near, frames) = robots(&mut rng, 3);
    let far_off = Se2::new(4000.0, -3000.0, 0.0);
    let far: Vec<LocalMap> = near
        .iter()
        .map(|m| {
            let g = &m.grid;
            let origin = far_off.inverse().compose(&g.origin());
            let grid =
                OccupancyGrid::new("far", g.width(), g.height(), CELL, origin, g.cells().to_vec());
            LocalMap::new(grid.unwrap(), &Config::default())
        })
        .collect();
    let (_, off) = perturbed(&mut rng, &near, &frames, 0);
    let refined = |maps: &[LocalMap], poses: &[Se2]| {
        refine(maps, &[0, 1, 2], poses, &[0], &Known::default(), &Config::default())
    };
    let far_poses: Vec<Se2> = off.iter().map(|t| t.compose(&far_off)).collect();
    let (near_by, far_away) = (refined(&near, &off), refined(&far, &far_poses));
    for (k, map) in near.iter().enumerate().skip(1) {
        let same = far_away.poses[k].compose(&far_off.inverse());
        let (metres, degrees) = apart(&same, &near_by.poses[k], map.center.unwrap());
        assert!(metres < 0.02 * CELL && degrees < 0.01, "{metres} {degrees}");
        let turn = |r: &Refined| r.covariances[k][(2, 2)].sqrt();
        let ratio = turn(&far_away) / turn(&near_by);
        assert!((ratio - 1.0).abs() < 0.05, "map {k}: {ratio}");
    }
}

/// Members may come in any order and be some of the maps only.
#[test]
fn members_are_looked_up_in_the_list_of_maps() {
    let mut rng = rng(30);
    let (maps, frames) = robots(&mut rng, 4);
    let (truth, off) = perturbed(&mut rng, &maps, &frames, 1);
    let members = [3, 1, 2];
    let chosen = |poses: &[Se2]| members.map(|m| poses[m]).to_vec();
    let r = refine(&maps, &members, &chosen(&off), &[1], &Known::default(), &Config::default());
    let truth = chosen(&truth);
    for (k, m) in members.iter().enumerate() {
        let (metres, _) = apart(&r.poses[k], &truth[k], maps[*m].center.unwrap());
        assert!(metres < 0.3 * CELL, "map {m}: {:.2} cells off", metres / CELL);
    }
}

/// Two views of one bare corridor, 12 m long and open at both ends, along an axis at an angle; the
/// true pose to start from, and what refinement makes of it.
fn corridor(angle: f64) -> (Se2, Refined) {
    let plan = Plan { half: 0.1, ..Plan::default() }
        .floor([0.0, 0.0, 12.0, 2.0])
        .wall(&[(-1.0, 0.0), (13.0, 0.0)])
        .wall(&[(-1.0, 2.0), (13.0, 2.0)]);
    let draw = |t: Se2| {
        let grid = plan.draw("corridor", &t, CELL, |p| p.x > 0.0 && p.x < 12.0);
        LocalMap::new(grid, &Config::default())
    };
    let maps = [draw(Se2::new(0.0, 0.0, -angle)), draw(Se2::new(1.0, 0.5, 0.8))];
    let truth = Se2::new(0.0, 0.0, -angle).between(&Se2::new(1.0, 0.5, 0.8));
    (
        truth,
        refine(
            &maps,
            &[0, 1],
            &[Se2::IDENTITY, truth],
            &[0],
            &Known::default(),
            &Config::default(),
        ),
    )
}

#[test]
fn a_bare_corridor_leaves_its_axis_open() {
    for angle in [0.0, 0.6, 1.5] {
        let (start, r) = corridor(angle);
        let c = r.covariances[1];
        assert!(is_covariance(&c), "{c}");
        let moved = (r.poses[1].translation() - start.translation()).norm();
        assert!(moved < 0.05, "at {angle}: slid by {moved:.2} m");
        let axis = Vec2::new(angle.cos(), angle.sin());
        let across = Vec2::new(-axis.y, axis.x);
        let shift = c.fixed_view::<2, 2>(0, 0).into_owned();
        let along = axis.dot(&(shift * axis)).sqrt();
        let across = across.dot(&(shift * across)).sqrt();
        assert!(along > 3.0, "at {angle}: {along:.2} m along the corridor");
        assert!(across < 0.1, "at {angle}: {across:.2} m across it");
        assert!(c[(2, 2)].sqrt() < 0.05, "at {angle}: {:.3} rad", c[(2, 2)].sqrt());
    }
}

/// Maps that share no walls keep their poses, and their covariance says that nothing is known.
#[test]
fn without_common_walls_nothing_moves() {
    let mut rng = rng(40);
    let (maps, frames) = robots(&mut rng, 2);
    let far = [Se2::IDENTITY, frames[0].between(&frames[1]).compose(&Se2::new(70.0, 0.0, 0.0))];
    let r = refine(&maps, &[0, 1], &far, &[0], &Known::default(), &Config::default());
    assert_eq!(r.poses, far);
    assert!(r.rms.is_none());
    assert!(is_covariance(&r.covariances[1]) && r.covariances[1][(0, 0)] > 25.0);

    let alone = refine(
        &maps,
        &[1],
        &[Se2::new(1.0, 2.0, 3.0)],
        &[0],
        &Known::default(),
        &Config::default(),
    );
    assert_eq!(alone.poses, [Se2::new(1.0, 2.0, 3.0)]);
    assert_eq!(alone.covariances, [Matrix3::zeros()]);
}
