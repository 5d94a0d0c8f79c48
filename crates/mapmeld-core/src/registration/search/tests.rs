use super::*;
use crate::grid::OccupancyGrid;

fn map(config: &Config) -> LocalMap {
    let cells = (0..900).map(|k| if k % 30 == 4 { 100 } else { 0 }).collect();
    LocalMap::new(OccupancyGrid::new("g", 30, 30, 0.1, Se2::IDENTITY, cells).unwrap(), config)
}

/// Two rooms of unlike size with a door between.
fn rooms(config: &Config) -> LocalMap {
    let (w, h) = (90, 60);
    let cell = |k: usize| {
        let (row, col) = (k / w, k % w);
        let is_outside = !(5..55).contains(&row) || !(5..85).contains(&col);
        let is_edge = row == 5 || row == 54 || col == 5 || col == 84;
        let is_between = col == 36 && !(20..28).contains(&row) || row == 40 && col > 60;
        match (is_outside, is_edge || is_between) {
            (true, _) => -1,
            (_, true) => 100,
            _ => 0,
        }
    };
    let cells = (0..w * h).map(cell).collect();
    LocalMap::new(OccupancyGrid::new("g", w, h, 0.1, Se2::IDENTITY, cells).unwrap(), config)
}

/// With so much spent on correlation.
fn effort(correlation: correlation::Effort, config: &Config) -> Effort {
    Effort {
        shortlist: config.registration.shortlist,
        modes: 6,
        stories: 2,
        correlation,
        has_structures: true,
        least: vec![f64::NEG_INFINITY; 2],
        least_look: f64::NEG_INFINITY,
    }
}

/// What a search of a map in itself finds.
fn found_in_itself(correlation: correlation::Effort) -> Found {
    let config = Config::default();
    let map = rooms(&config);
    tops(&map, &map, &[], &effort(correlation, &config), &config)
}

#[test]
fn what_begins_near_another_is_not_led_uphill_again() {
    let config = Config::default();
    let (map, effort) = (rooms(&config), effort(correlation::THOROUGH, &config));
    let search = Search::new(&map, &map, &effort, &config).unwrap();
    let shifted = |x: f64, theta: f64| {
        let t_a_b = Se2::from_parts(Vec2::zeros(), theta);
        let to = map.center.unwrap() - t_a_b.apply(map.center.unwrap()) + Vec2::new(x, 0.0);
        (1.0, Candidate { t_a_b: Se2::from_parts(to, theta), source: Source::Corners })
    };
    let some = [(0.0, 0.0), (0.25, 0.0), (0.0, 0.04), (1.2, 0.0), (0.0, 0.3)];
    let some = some.map(|(x, theta)| shifted(x, theta));
    let mut begun = Begun::default();
    search.begin(&some, &mut begun);
    assert_eq!(begun.from, [some[0].1.t_a_b, some[3].1.t_a_b, some[4].1.t_a_b]);
    assert_eq!(begun.poses.len(), begun.from.len());
}

#[test]
fn corners_and_walls_are_asked_where_correlation_finds_too_little() {
    let config = Config::default();
    let map = rooms(&config);
    let thorough = correlation::THOROUGH;
    let blind = found_in_itself(correlation::Effort { promising: 0, further: 0, ..thorough });
    assert_eq!(blind.candidates, of_structures(&map, &map, &config.registration).len());
    for tops in &blind.tops {
        let best = tops[0];
        assert_ne!(best.source, Source::Correlation);
        assert!(best.t_a_b.is_close_at(&Se2::IDENTITY, map.center.unwrap(), 0.05, 0.01));
    }
    // A map lies in itself as well as any: correlation alone is enough.
    let seeing = found_in_itself(thorough);
    let rotations = Proposed::new(&map.turns, &map.turns, thorough.promising).promising();
    let correlated = correlation::candidates(&map, &map, &rotations, thorough);
    assert_eq!(seeing.candidates, correlated.len());
    assert_eq!(seeing.tops[0][0].source, Source::Correlation);
}

/// Shifts along x of the rivals of some, shifts and log-likelihoods given, with so many stories at least.
fn rivals(some: &[(f64, f64)], keep: usize, stories: usize, least: f64) -> Vec<f64> {
    rivals_of(some, Source::Corners, keep, stories, least)
}

fn rivals_of(
    some: &[(f64, f64)],
    source: Source,
    keep: usize,
    stories: usize,
    least: f64,
) -> Vec<f64> {
    let config = Config::default();
    let (a, b) = (map(&config), map(&config));
    let effort = Effort {
        shortlist: 9,
        modes: 6,
        stories,
        correlation: correlation::THOROUGH,
        has_structures: false,
        least: vec![least; 2],
        least_look: f64::NEG_INFINITY,
    };
    let search = Search::new(&a, &b, &effort, &config).unwrap();
    let scored = some.iter().map(|(x, l)| {
        let t_a_b = Se2::new(*x, 0.0, 0.0);
        (*l, Candidate { t_a_b, source })
    });
    let kept = search.rivals(scored.collect(), 0, keep, stories);
    kept.iter().map(|(_, c)| c.t_a_b.x).collect()
}

#[test]
fn what_lies_far_behind_is_left_except_for_another_story() {
    let none = f64::NEG_INFINITY;
    // 0.02 m apart is the same pose, 0.3 m the same story.
    let some = [(9.0, 10.0), (0.0, 100.0), (0.02, 99.0), (0.3, 40.0), (5.0, 60.0), (7.0, 20.0)];
    assert_eq!(rivals(&some, 6, 1, none), [0.0, 5.0]);
    assert_eq!(rivals(&some, 6, 3, none), [0.0, 5.0, 0.3, 7.0]);
    assert_eq!(rivals(&some, 1, 1, none), [0.0]);
    assert_eq!(rivals(&some, 1, 2, none), [0.0, 5.0]);
    // Behind a low best, which chance may reach, lie ten nats, not half of it.
    let low = [(0.0, 15.0), (5.0, 6.0), (9.0, 4.0), (13.0, -30.0)];
    assert_eq!(rivals(&low, 6, 1, none), [0.0, 5.0]);
    assert_eq!(rivals(&low, 6, 4, none), [0.0, 5.0, 9.0, 13.0]);
    assert_eq!(rivals(&[(0.0, 15.0), (5.0, 1.0)], 6, 1, 4.0), [0.0]);
    // Of one story no more than are asked for.
    let one_story = [0.0, 0.21, -0.21, 0.42, -0.42].map(|x| (x, 9.0));
    assert_eq!(rivals(&one_story, 1, 2, none).len(), 3);
    // What is known to be worth a climb stays however far it lies behind.
    assert_eq!(rivals_of(&some, Source::Members, 6, 1, none).len(), 5);
}
