//! The generic filter with choices only: shares of the doors, those who have none, few particles.

use mapmeld_core::filter::{LogWeight, Model, ParticleFilter, Stream};
use mapmeld_core::parallel::with_threads;
use proptest::prelude::*;
use std::sync::Arc;

/// A walker that has some doors to choose from, or none. Its state is the list of doors taken.
struct Doors<F> {
    /// Linear masses of the doors that a state has.
    doors: F,
    staying: f64,
}

type State = Arc<Vec<usize>>;

impl<F: Fn(&[usize]) -> Vec<f64> + Sync> Model for Doors<F> {
    type State = State;
    type Mode = (usize, f64);

    fn propose(&self, state: &State) -> Vec<(usize, f64)> {
        (self.doors)(state).into_iter().enumerate().collect()
    }
    fn log_masses(&self, pool: &[&[(usize, f64)]]) -> Vec<Vec<LogWeight>> {
        pool.iter().map(|m| m.iter().map(|(_, p)| LogWeight(p.ln())).collect()).collect()
    }
    fn log_mass_of_staying(&self, _: &[Vec<LogWeight>]) -> LogWeight {
        LogWeight(self.staying.ln())
    }
    fn advance(&self, state: &State, (door, _): &(usize, f64), _: &mut Stream) -> State {
        Arc::new([state.as_slice(), &[*door]].concat())
    }
}

/// Share of the weight held by particles whose state passes.
fn share(filter: &ParticleFilter<State>, passes: impl Fn(&[usize]) -> bool) -> f64 {
    let of = |p: &&mapmeld_core::filter::Particle<State>| passes(&p.state);
    filter.particles().iter().filter(of).map(|p| p.log_weight.0.exp()).sum()
}

#[test]
fn those_without_a_door_stay_and_are_weighed_against_those_that_went_on() {
    let n = 4000;
    let mut filter = ParticleFilter::new(State::default(), n, 0.0, 1);
    // Behind door 0 there is no further door.
    let first = filter.step(&Doors { doors: |_: &[usize]| vec![0.3, 0.9], staying: 1.0 });
    assert_eq!(first.advanced, n);
    assert!((first.log_evidence - 1.2f64.ln()).abs() < 1e-9);
    let stuck = share(&filter, |s| s == [0]);
    assert!((stuck - 0.25).abs() < 0.03, "{stuck}");

    let before: Vec<State> = filter.particles().iter().map(|p| p.state.clone()).collect();
    let model =
        Doors { doors: |s: &[usize]| if s == [0] { vec![] } else { vec![0.1, 0.3] }, staying: 2.0 };
    let second = filter.step(&model);
    let moved = before.iter().filter(|s| s.as_slice() == [1]).count();
    assert_eq!(second.advanced, moved);
    for (p, before) in filter.particles().iter().zip(&before) {
        assert_eq!(before.as_slice() == [0], Arc::ptr_eq(&p.state, before), "stays as it is");
    }
    // Exactly, given who went where in the first step.
    let evidence = stuck * 2.0 + (1.0 - stuck) * 0.4;
    assert!((second.log_evidence - evidence.ln()).abs() < 1e-9);
    assert!((share(&filter, |s| s == [0]) - stuck * 2.0 / evidence).abs() < 1e-9);
}

#[test]
fn when_nobody_can_go_anywhere_nothing_changes() {
    // No door at all, and doors that nothing speaks for, are the same.
    for doors in [vec![], vec![0.0, 0.0]] {
        let mut filter = ParticleFilter::new(State::new(vec![7]), 50, 0.9, 1);
        let step = filter.step(&Doors { doors: |_: &[usize]| doors.clone(), staying: 0.5 });
        assert_eq!((step.advanced, step.resampled), (0, false));
        assert!((step.log_evidence - 0.5f64.ln()).abs() < 1e-9);
        assert!((step.effective_sample_size - 50.0).abs() < 1e-6);
        assert!(filter.particles().iter().all(|p| p.state.as_slice() == [7]));
        let total: f64 = filter.particles().iter().map(|p| p.log_weight.0.exp()).sum();
        assert!((total - 1.0).abs() < 1e-9);
    }
}

/// The estimate of the evidence is unbiased for any number of particles; with two of them even a small
/// bias of the resampling shows.
#[test]
fn two_particles_are_unbiased_too() {
    let run = |seed| {
        let mut filter = ParticleFilter::new(State::default(), 2, 1.0, seed);
        let mut step = |doors: fn(&[usize]) -> Vec<f64>| {
            filter.step(&Doors { doors, staying: 0.0 }).log_evidence
        };
        let both = step(|_| vec![0.5, 0.5]);
        let uneven = step(|s| vec![if s[0] == 0 { 0.2 } else { 0.8 }]);
        let first_only = step(|s| vec![if s[0] == 0 { 1.0 } else { 0.0 }]);
        (both + uneven + first_only).exp()
    };
    let all: Vec<f64> = with_threads(Some(1), || (0..10_000).map(run).collect()).unwrap();
    let n = all.len() as f64;
    let mean = all.iter().sum::<f64>() / n;
    let error = (all.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n / n).sqrt();
    let exact = 0.5 * 0.2;
    assert!(error < 0.002 && (mean - exact).abs() < 4.0 * error, "{mean} +- {error}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    /// Whatever the masses, in two steps: each door gets its share, a door of mass zero nobody.
    #[test]
    fn doors_are_taken_in_proportion_to_their_mass(
        masses in prop::collection::vec(prop_oneof![Just(0.0), 0.01..1.0f64], 1..6),
        scale in -300.0..300.0f64, seed in 0u64..1000, resample_below in 0.0..1.0f64,
    ) {
        let total: f64 = masses.iter().sum();
        prop_assume!(total > 0.0);
        let n = 3000;
        let mut filter = ParticleFilter::new(State::default(), n, resample_below, seed);
        // Scaled far from one: only ratios count.
        let scaled: Vec<f64> = masses.iter().map(|m| m * scale.exp()).collect();
        let model = Doors { doors: |_: &[usize]| scaled.clone(), staying: 0.0 };
        for depth in 0..2 {
            let step = filter.step(&model);
            prop_assert!((step.log_evidence - total.ln() - scale).abs() < 1e-6);
            prop_assert!(!step.resampled, "all weights are equal");
            for (door, mass) in masses.iter().enumerate() {
                let (p, got) = (mass / total, share(&filter, |s| s[depth] == door));
                let error = (p * (1.0 - p) / n as f64).sqrt();
                prop_assert!((got - p).abs() <= 5.0 * error + 1e-9, "{got} of {p}");
            }
        }
    }
}
