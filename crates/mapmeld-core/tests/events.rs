//! What a merge tells a listener, and that telling changes nothing.

mod common;

use common::{any_frame, office, rng};
use mapmeld_core::config::{Config, PerceptionModel};
use mapmeld_core::events::{Event, Stepped};
use mapmeld_core::filter::Model;
use mapmeld_core::grid::OccupancyGrid;
use mapmeld_core::local_map::LocalMap;
use mapmeld_core::memory::Memory;
use mapmeld_core::merge::{merge, merge_told};
use mapmeld_core::pair_table::PairTable;
use mapmeld_core::registration::pair::register;
use mapmeld_core::result::{Known, Merge};
use mapmeld_core::se2::Vec2;
use mapmeld_core::verdict;
use mapmeld_core::virtual_robot::VirtualRobot;
use std::sync::Mutex;

const CELL: f64 = 0.1;

fn robots() -> Vec<OccupancyGrid> {
    let mut rng = rng(5);
    let spans = [(6.3, 19.0), (-1.0, 10.7), (3.0, 14.2)];
    let draw = |(k, (from, to)): (usize, (f64, f64))| {
        let frame = any_frame(&mut rng);
        office().draw(&format!("robot {k}"), &frame, CELL, |p| p.x > from && p.x < to)
    };
    spans.into_iter().enumerate().map(draw).collect()
}

fn told(grids: &[OccupancyGrid], config: &Config) -> (Merge, Vec<Event>) {
    let heard = Mutex::new(Vec::new());
    let listener = |e: Event| heard.lock().unwrap().push(e);
    let known = Known::default();
    let found =
        merge_told(grids.to_vec(), &known, config, None, (&|_, _, _| true, Some(&listener)))
            .unwrap();
    (found, heard.into_inner().unwrap())
}

fn steps(events: &[Event]) -> Vec<&Stepped> {
    let mut found = Vec::new();
    for e in events {
        if let Event::Stepped(s) = e {
            found.push(s);
        }
    }
    found
}

#[test]
fn events_come_in_order_and_tell_of_the_maps_as_given() {
    let grids = robots();
    let (found, events) = told(&grids, &Config::default());
    let [Event::Prepared(maps), Event::Registered(pairs), rest @ .., Event::Refined(refined)] =
        &events[..]
    else {
        panic!("{} events", events.len());
    };
    for (k, m) in maps.iter().enumerate() {
        assert_eq!(m.map, k);
        assert!(m.boundary.len() > 100 && m.corners.len() > 3);
        // Boundary points are occupied cells of the map of that index, and of no other.
        let on_wall = |p: &Vec2, g: &OccupancyGrid| {
            let local = g.origin().inverse().apply(*p) / CELL;
            let (row, col) = (local.y.floor(), local.x.floor());
            row >= 0.0
                && col >= 0.0
                && (row as usize) < g.height()
                && (col as usize) < g.width()
                && g.cells()[row as usize * g.width() + col as usize] >= 65
        };
        assert!(m.boundary.iter().all(|p| on_wall(p, &grids[k])), "map {k}");
        assert!(!m.boundary.iter().all(|p| on_wall(p, &grids[(k + 1) % 3])), "map {k}");
    }
    let ends = |p: &[mapmeld_core::registration::PairModes]| -> Vec<_> {
        p.iter().map(|p| (p.a, p.b, p.found.modes.len())).collect()
    };
    assert_eq!(ends(pairs), ends(&found.pairs));
    assert_eq!(rest.len(), 2, "two more maps are merged");
    let [c] = &refined[..] else { panic!("one component") };
    assert_eq!(c.maps, found.components[0].order);
    for (k, t) in c.maps.iter().zip(&c.after) {
        assert_eq!(found.placements[*k].t_component_map.unwrap().to_array(), t.to_array());
    }
    assert!(c.before.iter().zip(&c.after).any(|(b, a)| b.to_array() != a.to_array()));
}

#[test]
fn steps_tell_particles_and_candidates() {
    let config = Config::default();
    let (found, events) = told(&robots(), &config);
    for (k, s) in steps(&events).iter().enumerate() {
        assert_eq!((s.travel, s.step, s.joining), (0, k as u64 + 1, false));
        assert_eq!(s.particles.len(), config.filter.particles);
        assert_eq!(s.fared, found.components[0].steps[k]);
        let sum: f64 = s.particles.iter().map(|p| p.weight).sum();
        assert!((sum - 1.0).abs() < 1e-9);
        for p in &s.particles {
            assert_eq!(p.maps.len(), k + 2);
            assert_eq!(p.maps[0].0, found.components[0].order[0], "where the robot started");
        }
        assert!(!s.candidates.is_empty());
        for sum in [
            s.candidates.iter().map(|c| c.psi).sum::<f64>(),
            s.candidates.iter().map(|c| c.gamma).sum(),
        ] {
            assert!((sum - 1.0).abs() < 1e-9, "{sum}");
        }
    }
}

/// The terms that are worked out for the listener are those that the paper's model weighs with.
#[test]
fn psi_and_gamma_are_those_of_the_model() {
    let mut config = Config::default();
    config.perception.model = PerceptionModel::PsiGamma;
    let (_, weighed) = told(&robots(), &config);
    let weighed = steps(&weighed);
    for s in &weighed {
        let product: Vec<f64> = s.candidates.iter().map(|c| c.psi * c.gamma).collect();
        let sum: f64 = product.iter().sum();
        for (c, p) in s.candidates.iter().zip(&product) {
            assert!((c.log_mass.exp() - p / sum).abs() < 1e-9);
        }
    }
    // The walls' model keeps no cells and weighs poses without them: for the listener it works them out.
    let walls = Config::default();
    let maps: Vec<LocalMap> = robots().into_iter().map(|g| LocalMap::new(g, &walls)).collect();
    let mirrored: Vec<LocalMap> = maps.iter().map(LocalMap::mirrored).collect();
    let pair = |a: usize, b: usize| {
        let found = register(&maps[a], &maps[b], Some(&mirrored[b]), &[], (a, b), &walls);
        verdict::of_pair(found, 0, [&maps[a], &maps[b]], &walls)
    };
    let pairs = PairTable::new(3, vec![pair(0, 1), pair(0, 2), pair(1, 2)]);
    let known = Known::default();
    let robot = |config| VirtualRobot {
        maps: &maps,
        pairs: &pairs,
        open: vec![true; 3],
        order: None,
        rung: 0,
        known: &known,
        parts: None,
        memory: Memory::default(),
        config,
    };
    let (papers, walls) = (robot(&config), robot(&walls));
    let modes = papers.propose(&papers.start(0));
    let expected = papers.terms(&papers.start(0), &modes);
    assert!(modes.len() > 1 && expected.iter().all(|(psi, _)| *psi > 0.0), "{expected:?}");
    assert_eq!(walls.terms(&walls.start(0), &modes), expected);
    // The paper's model weighs the poses of all maps, that of the walls goes to the surest next.
    let next: Vec<usize> = walls.propose(&walls.start(0)).iter().map(|m| m.map).collect();
    let surest = modes.iter().max_by(|a, b| a.any.total_cmp(&b.any)).unwrap().map;
    assert!(next.iter().all(|m| *m == surest) && !next.is_empty(), "{next:?}");
    assert!(modes.iter().any(|m| m.map != surest));
}

#[test]
fn telling_changes_nothing() {
    let grids = robots();
    let (told, _) = told(&grids, &Config::default());
    let silent = merge(grids, &Known::default(), &Config::default(), &|_, _, _| true).unwrap();
    assert_eq!(told.probability.to_bits(), silent.probability.to_bits());
    for (a, b) in told.placements.iter().zip(&silent.placements) {
        assert_eq!(a.t_component_map.unwrap().to_array(), b.t_component_map.unwrap().to_array());
        assert_eq!(a.covariance, b.covariance);
    }
    assert_eq!(told.components[0].steps, silent.components[0].steps);
}
