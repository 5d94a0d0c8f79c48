//! Verdicts: what stands alone is merged, what stands in two places is ambiguous, the rest is neither.

use mapmeld_core::config::EvidenceConfig;
use mapmeld_core::perception::WallEvidence;
use mapmeld_core::verdict::{probability, weigh, Background};

fn evidence(log_likelihood: f64) -> WallEvidence {
    WallEvidence {
        log_likelihood,
        hits: 0.55 * log_likelihood,
        distinct_hits: 0.4 * log_likelihood,
        spread: 0.1 * log_likelihood,
        misses: 0.05 * log_likelihood,
        shared_floor: 0.7 * log_likelihood,
        shared_length: 0.4 * log_likelihood,
        directions: [0.25 * log_likelihood, 0.0, 0.3 * log_likelihood],
        ..WallEvidence::default()
    }
}

fn background() -> Background {
    Background {
        walls: 100.0,
        straight: 0.6,
        smear: 0.0,
        openness: 1.0,
        rung: 0,
        sigma: 0.07,
        decoy: 8.0,
        pairs: 1,
    }
}

#[test]
fn one_good_pose_is_merged_two_are_ambiguous_none_is_neither() {
    let config = EvidenceConfig::default();
    let (good, poor) = (evidence(150.0), evidence(10.0));
    let one = weigh(&[&good, &poor], &background(), &config);
    assert!(one.is_carried && one.probabilities[0] >= config.min_probability, "{one:?}");
    let two = weigh(&[&good, &good, &poor], &background(), &config);
    assert!(two.is_carried, "{two:?}");
    assert!(two.probabilities[0] < config.min_probability, "{two:?}");
    assert!((two.probabilities[0] - two.probabilities[1]).abs() < 0.3, "{two:?}");
    let none = weigh(&[&poor, &poor], &background(), &config);
    assert!(!none.is_carried, "{none:?}");
    let nothing = weigh(&[], &background(), &config);
    assert!(!nothing.is_carried && nothing.probabilities.is_empty());
}

#[test]
fn probabilities_of_poses_that_exclude_each_other_sum_to_one_at_most() {
    let config = EvidenceConfig::default();
    for tops in [[150.0, 149.0, 30.0], [90.0, 20.0, 19.0], [40.0, 39.0, 38.0], [5.0, 4.0, 3.0]] {
        let all = tops.map(evidence);
        let v = weigh(&all.iter().collect::<Vec<_>>(), &background(), &config);
        let sum: f64 = v.probabilities.iter().sum();
        assert!(sum <= 1.0 + 1e-9 && v.probabilities.iter().all(|p| (0.0..=1.0).contains(p)));
        assert!(v.probabilities.windows(2).all(|w| w[0] >= w[1] - 1e-12), "{v:?}");
    }
}

/// Parts of four and of two maps lie next to each other in eight ways, each of which may agree by chance.
#[test]
fn what_many_pairs_may_reach_by_chance_is_less_sure() {
    let config = EvidenceConfig::default();
    let among = |pairs: usize, e: &WallEvidence| {
        probability(e, 0.0, &Background { pairs, walls: 30.0, ..background() }, &config)
    };
    let weak = WallEvidence { log_likelihood: 12.0, ..evidence(30.0) };
    assert!(among(1, &weak) > config.min_probability, "{}", among(1, &weak));
    assert!(among(8, &weak) < config.min_probability, "{}", among(8, &weak));
    let strong = evidence(60.0);
    assert_eq!(among(1, &strong), among(8, &strong), "nothing that chance reaches");
}

#[test]
fn what_speaks_against_a_pose_lowers_its_probability() {
    let config = EvidenceConfig::default();
    let at = |e: &WallEvidence, chance: f64| probability(e, chance, &background(), &config);
    let plain = evidence(60.0);
    let p = at(&plain, 8.0);
    assert!(at(&plain, 50.0) < p, "what chance reaches");
    assert!(at(&WallEvidence { conflicts: 8.0, ..plain }, 8.0) < p, "walls in free space");
    assert!(at(&WallEvidence { straight_conflicts: 4.0, conflicts: 4.0, ..plain }, 8.0) < p);
    assert!(at(&WallEvidence { distinct_hits: 1.0, ..plain }, 8.0) < p, "straight walls alone");
    assert!(at(&WallEvidence { bending: 60.0, ..plain }, 8.0) < p, "dear bending");
    assert!(at(&WallEvidence { log_likelihood: 4.0, ..plain }, 0.0) < 0.5, "less than six nats");
    assert!(at(&WallEvidence { shared_floor: 2.0, ..plain }, 8.0) < p, "walls glued back to back");
}

#[test]
fn what_chance_reaches_in_long_corridors_does_not_hide_what_the_rest_adds() {
    let config = EvidenceConfig::default();
    let corridor = WallEvidence { conflicts: 1.5, ..evidence(180.0) };
    let at = |chance: f64| probability(&corridor, chance, &background(), &config);
    assert!(at(110.0) > config.min_probability, "{}", at(110.0));
    assert!(at(175.0) < config.min_probability, "{}", at(175.0));
}

#[test]
fn as_much_floor_is_shared_as_lies_beside_the_walls() {
    let config = EvidenceConfig::default();
    let e = evidence(40.0);
    let of =
        |openness: f64| probability(&e, 8.0, &Background { openness, ..background() }, &config);
    assert!(of(6.0) < of(1.0) && of(1.0) < of(0.5), "{} {} {}", of(6.0), of(1.0), of(0.5));
}

#[test]
fn walls_too_thick_to_be_seen_from_both_sides_are_no_worse() {
    let config = EvidenceConfig::default();
    let of = |opposed: f64| {
        probability(&WallEvidence { opposed, ..evidence(40.0) }, 8.0, &background(), &config)
    };
    assert_eq!(of(0.0), of(1.0));
    assert!(of(12.0) > of(1.0), "thin ones, seen by both from their own side");
}

#[test]
fn what_walls_leave_free_along_an_axis_is_ambiguous() {
    let config = EvidenceConfig::default();
    let at = |angle: f64, along: f64, sigma: f64| {
        // So much is told along the walls, and 15 across them.
        let (s, c) = angle.sin_cos();
        let directions =
            [15.0 * c * c + along * s * s, (15.0 - along) * s * c, 15.0 * s * s + along * c * c];
        let e = WallEvidence { directions, ..evidence(60.0) };
        weigh(&[&e], &Background { sigma, ..background() }, &config)
    };
    let plain = weigh(&[&evidence(60.0)], &background(), &config);
    for angle in [0.0, 0.7, 1.5, 2.9] {
        // Of an end wall two observations hold it to five centimetres.
        assert_eq!(at(angle, 2.0, 0.07).probabilities, plain.probabilities);
        // None leave it two metres to slide: it belongs there, and nobody can tell where.
        let corridor = at(angle, 0.001, 0.07);
        assert!(corridor.is_carried && corridor.probabilities[0] < 0.25, "{corridor:?}");
        assert!(at(angle, 0.1, 0.25).probabilities[0] < 0.6 && at(angle, 0.1, 0.07).is_carried);
    }
}
