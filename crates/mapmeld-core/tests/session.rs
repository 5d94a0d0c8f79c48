//! A session's answers are those of a merge from scratch, and it registers no more than it must.

mod common;

use common::{any_frame, office, rng};
use mapmeld_core::config::Config;
use mapmeld_core::error::Error;
use mapmeld_core::grid::OccupancyGrid;
use mapmeld_core::merge::merge;
use mapmeld_core::prior::Prior;
use mapmeld_core::result::{Known, Merge, Stage};
use mapmeld_core::se2::Se2;
use mapmeld_core::standing::Question;
use mapmeld_core::Session;
use rand_pcg::Pcg64Mcg;

const CELL: f64 = 0.1;

/// What a robot in its own frame knows of the office between two x.
fn seen(name: &str, frame: &Se2, from: f64, to: f64) -> OccupancyGrid {
    office().draw(name, frame, CELL, |p| p.x > from && p.x < to)
}

fn frames(rng: &mut Pcg64Mcg) -> Vec<Se2> {
    (0..4).map(|_| any_frame(rng)).collect()
}

/// All that a merge tells, to the last bit, but for times and what was registered anew.
fn bits(m: &Merge) -> String {
    format!(
        "{:?}",
        (
            &m.placements,
            m.components
                .iter()
                .map(|c| (
                    c.reference,
                    &c.order,
                    &c.steps,
                    c.rms,
                    c.fused.as_ref().map(|f| &f.grid)
                ))
                .collect::<Vec<_>>(),
            m.probability,
            &m.hypotheses,
            &m.pairs
        )
    )
}

fn scratch(maps: &[OccupancyGrid]) -> Merge {
    merge(maps.to_vec(), &Known::default(), &Config::default(), &|_, _, _| true).unwrap()
}

fn again(s: &mut Session) -> Merge {
    s.merge(&Known::default(), &|_, _, _| true).unwrap()
}

#[test]
fn a_session_answers_as_a_merge_from_scratch() {
    let f = frames(&mut rng(301));
    let mut session = Session::new(Config::default()).unwrap();
    let mut maps: Vec<OccupancyGrid> = Vec::new();
    // Maps come, grow, go and come back; each step with the pairs that had to be registered.
    type Change<'a> = (&'a str, Option<(f64, f64)>, usize);
    let steps: [Change; 8] = [
        ("a", Some((-1.0, 10.7)), 0),
        ("b", Some((6.3, 12.0)), 1),
        ("b", Some((6.3, 19.0)), 1),
        ("c", Some((3.0, 14.2)), 2),
        ("c", Some((3.0, 14.2)), 0),
        ("d", Some((5.0, 9.0)), 3),
        ("a", None, 0),
        ("a", Some((-1.0, 10.7)), 3),
    ];
    for (k, (name, span, fresh)) in steps.into_iter().enumerate() {
        let frame = &f["abcd".find(name).unwrap()];
        match span {
            Some((from, to)) => {
                let grid = seen(name, frame, from, to);
                let at = maps.iter().position(|m| m.name() == name);
                let changed = at.is_none_or(|at| maps[at] != grid);
                match at {
                    Some(at) => maps[at] = grid.clone(),
                    None => maps.push(grid.clone()),
                }
                assert_eq!(session.update(grid), changed, "step {k}");
            }
            None => {
                maps.retain(|m| m.name() != name);
                assert!(session.remove(name));
            }
        }
        let m = again(&mut session);
        assert_eq!(bits(&m), bits(&scratch(&maps)), "step {k}");
        assert_eq!(m.registered_pairs, fresh, "step {k}");
        // What is kept is what the maps at hand need, joins of merged maps included.
        assert!(session.kept_pairs() <= maps.len() * maps.len(), "step {k}");
    }
    assert!(!session.remove("nobody"));
}

#[test]
fn maps_that_show_the_same_are_told_apart() {
    let f = any_frame(&mut rng(302));
    let (a, b) = (seen("a", &f, -1.0, 12.0), seen("b", &f, -1.0, 12.0));
    let mut session = Session::new(Config::default()).unwrap();
    for grid in [&a, &b] {
        session.update(grid.clone());
    }
    let m = again(&mut session);
    assert_eq!(bits(&m), bits(&scratch(&[a, b])));
    assert_eq!(bits(&again(&mut session)), bits(&m));
}

#[test]
fn pairs_that_were_registered_before_an_interrupt_are_kept() {
    let f = frames(&mut rng(303));
    let spans = [(-1.0, 10.7), (6.3, 19.0), (3.0, 14.2), (5.0, 9.0)];
    let maps: Vec<OccupancyGrid> = f
        .iter()
        .zip(spans)
        .enumerate()
        .map(|(k, (t, (from, to)))| seen(&format!("{k}"), t, from, to))
        .collect();
    let mut session = Session::new(Config { threads: Some(1), ..Config::default() }).unwrap();
    for m in &maps {
        session.update(m.clone());
    }
    let stopped = session.merge(&Known::default(), &|stage, done, total| {
        !(stage == Stage::Register && total == 6 && done == 4)
    });
    assert_eq!(stopped.unwrap_err(), Error::Interrupted);
    let m = again(&mut session);
    assert_eq!(m.registered_pairs, 2);
    assert_eq!(bits(&m), bits(&scratch(&maps)));
}

#[test]
fn what_is_kept_does_not_pile_up() {
    let f = frames(&mut rng(304));
    let mut session = Session::new(Config::default()).unwrap();
    session.update(seen("still", &f[0], -1.0, 10.7));
    for k in 0..12 {
        session.update(seen("grows", &f[1], 6.3, 10.0 + 0.5 * f64::from(k)));
        if k % 2 == 0 {
            let stopped = session.merge(&Known::default(), &|stage, _, _| stage != Stage::Filter);
            assert!(stopped.is_err());
        } else {
            again(&mut session);
        }
        assert!(session.kept_pairs() <= 6, "{} pairs after {k}", session.kept_pairs());
    }
}

#[test]
fn a_true_place_stands_and_a_wrong_one_does_not() {
    let f = frames(&mut rng(305));
    let mut session = Session::new(Config::default()).unwrap();
    session.update(seen("a", &f[0], -1.0, 12.0));
    session.update(seen("b", &f[1], 5.0, 19.0));
    again(&mut session);
    let truth = f[0].between(&f[1]);
    let wrong = truth.compose(&Se2::new(2.0, 1.0, 0.4));
    let near = truth.compose(&Se2::new(0.05, 0.0, 0.01));
    let ask = Question {
        base: vec![(0, Se2::IDENTITY)],
        moved: vec![(1, Se2::IDENTITY)],
        places: vec![truth, wrong, near],
    };
    let told = session.weigh(&Known::default(), &[ask], &|_, _, _| true).unwrap().remove(0);
    let [(right, 0), (off, 1), (close, 0)] = told.places[..] else { panic!("{told:?}") };
    assert!(right > 0.9 && close == right && off < 0.05, "{told:?}");
    assert!(told.rival < 0.05, "{told:?}");
}

/// Both maps known to within half a metre, the second one where `t_world_b` says.
fn with_priors(f: &[Se2], t_world_b: Se2) -> Known {
    let sigma = [0.5, 0.5, 0.1];
    let priors = vec![Some(Prior::new(f[0], sigma)), Some(Prior::new(t_world_b, sigma))];
    Known { priors, ..Known::default() }
}

#[test]
fn pairs_of_priors_that_move_do_not_pile_up() {
    let f = frames(&mut rng(306));
    let mut session = Session::new(Config::default()).unwrap();
    session.update(seen("a", &f[0], -1.0, 12.0));
    session.update(seen("b", &f[1], 5.0, 19.0));
    for k in 0..12 {
        let moved = Se2::new(f[1].x + 0.001 * f64::from(k), f[1].y, f[1].theta);
        let known = with_priors(&f, moved);
        // Many are superseded after the pairs were looked at.
        let found = session.merge(&known, &|stage, _, _| k % 6 == 5 || stage != Stage::Filter);
        assert_eq!(found.is_ok(), k % 6 == 5);
        assert!(session.kept_pairs() <= 6, "{} pairs after {k}", session.kept_pairs());
    }
    assert!(session.kept_pairs() <= 2, "{} pairs", session.kept_pairs());
}

#[test]
fn registered_pairs_outlive_many_interrupts() {
    let f = frames(&mut rng(307));
    let mut session = Session::new(Config::default()).unwrap();
    session.update(seen("a", &f[0], -1.0, 12.0));
    session.update(seen("b", &f[1], 5.0, 19.0));
    again(&mut session);
    for last in [Stage::Prepare, Stage::Register, Stage::Filter] {
        for _ in 0..8 {
            let stopped = session.merge(&Known::default(), &|stage, _, _| stage != last);
            assert_eq!(stopped.unwrap_err(), Error::Interrupted);
        }
    }
    assert_eq!(again(&mut session).registered_pairs, 0);
}

#[test]
fn priors_hold_no_place_that_walls_speak_against() {
    let f = frames(&mut rng(308));
    let mut session = Session::new(Config::default()).unwrap();
    session.update(seen("a", &f[0], -1.0, 12.0));
    session.update(seen("b", &f[1], 5.0, 19.0));
    // One metre off, the walls of one lie amid the free space of the other.
    let off = f[1].compose(&Se2::new(0.9, 0.7, 0.0));
    let ask = Question {
        base: vec![(0, Se2::IDENTITY)],
        moved: vec![(1, Se2::IDENTITY)],
        places: vec![f[0].between(&off)],
    };
    let told = session.weigh(&with_priors(&f, off), &[ask], &|_, _, _| true).unwrap().remove(0);
    assert!(told.places[0].0 < 1e-6, "{told:?}");
}
