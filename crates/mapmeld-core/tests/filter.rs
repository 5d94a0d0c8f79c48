//! The generic filter on a problem whose posterior is known exactly.
//!
//! A point moves along a line: every step it goes one of two ways with Gaussian noise, and is seen
//! through a sensor that has one of two biases. Given the ways and the biases everything is linear
//! and Gaussian, so the posterior is a Gaussian mixture that can be enumerated: one Kalman filter for
//! every sequence of choices.

use mapmeld_core::filter::{log_sum, LogWeight, Model, ParticleFilter, Step, Stream};
use mapmeld_core::parallel::with_threads;
use rand_distr::{Distribution, StandardNormal};
use std::collections::HashSet;
use std::f64::consts::TAU;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::Arc;

/// Ways to go: probability and direction.
const WAYS: [(f64, f64); 2] = [(0.4, -1.0), (0.6, 1.0)];
/// Biases of the sensor: probability and shift.
const BIASES: [(f64, f64); 2] = [(0.7, 0.0), (0.3, 2.5)];
/// Variance of the motion.
const MOTION: f64 = 0.3;
/// Every step: length of the way, reading, and its variance. The first two readings hardly tell the
/// ways apart, the third does, so that weights become uneven late.
const STEPS: [[f64; 3]; 5] =
    [[3.0, 0.4, 20.0], [2.0, 0.9, 20.0], [0.5, 1.0, 0.2], [1.0, 1.9, 0.8], [1.0, 2.6, 1.0]];

/// One step of a trajectory; successors share what lies behind them.
struct Node {
    x: f64,
    way: usize,
    parent: Option<Arc<Node>>,
}
type State = Arc<Node>;

fn start() -> State {
    Arc::new(Node { x: 0.0, way: usize::MAX, parent: None })
}

/// The ways of a trajectory, latest first.
fn ways(state: &State) -> Vec<usize> {
    std::iter::successors(Some(state), |n| n.parent.as_ref())
        .filter(|n| n.parent.is_some())
        .map(|n| n.way)
        .collect()
}

struct Toy {
    step: [f64; 3],
    shares: bool,
    settles: bool,
    nowhere: bool,
    proposals: AtomicUsize,
}

impl Toy {
    fn new(step: [f64; 3], shares: bool) -> Self {
        Self { step, shares, settles: false, nowhere: false, proposals: AtomicUsize::new(0) }
    }
}

fn log_normal(d: f64, variance: f64) -> f64 {
    -0.5 * (d * d / variance + (TAU * variance).ln())
}

struct Way {
    way: usize,
    mean: f64,
    variance: f64,
    log_mass: f64,
}

impl Model for Toy {
    type State = State;
    type Mode = Way;

    /// The optimal proposal, p(x_t | x_t-1, z_t): one mode for every way and bias.
    fn propose(&self, state: &State) -> Vec<Way> {
        self.proposals.fetch_add(1, Ordering::Relaxed);
        let [length, z, noise] = self.step;
        let mut modes = Vec::new();
        if self.nowhere {
            return modes;
        }
        for (way, (p_way, side)) in WAYS.iter().enumerate() {
            for (p_bias, bias) in BIASES {
                let (predicted, innovation) = (state.x + side * length, MOTION + noise);
                let d = z - bias - predicted;
                let gain = MOTION / innovation;
                modes.push(Way {
                    way,
                    mean: predicted + gain * d,
                    variance: (1.0 - gain) * MOTION,
                    log_mass: (p_way * p_bias).ln() + log_normal(d, innovation),
                });
            }
        }
        modes
    }

    fn log_masses(&self, pool: &[&[Way]]) -> Vec<Vec<LogWeight>> {
        pool.iter().map(|m| m.iter().map(|m| LogWeight(m.log_mass)).collect()).collect()
    }

    fn log_mass_of_staying(&self, _: &[Vec<LogWeight>]) -> LogWeight {
        if self.nowhere {
            LogWeight::ONE
        } else {
            LogWeight::ZERO
        }
    }

    fn advance(&self, state: &State, mode: &Way, rng: &mut Stream) -> State {
        let noise: f64 = StandardNormal.sample(rng);
        let x = mode.mean + mode.variance.sqrt() * noise;
        Arc::new(Node { x, way: mode.way, parent: Some(state.clone()) })
    }

    fn is_same(&self, a: &State, b: &State) -> bool {
        self.shares && Arc::ptr_eq(a, b)
    }

    fn is_due(&self, state: &State) -> bool {
        self.settles && ways(state).len() == 2
    }

    /// Where the way alone would have led.
    fn settled(&self, state: &State) -> State {
        let way = ways(state).into_iter().zip(STEPS.iter().take(2).rev());
        let x = way.map(|(way, [length, ..])| WAYS[way].1 * length).sum();
        Arc::new(Node { x, way: state.way, parent: state.parent.clone() })
    }
}

/// What is compared: evidence, mean, second moment, and the probability of the first way at the
/// first, the second and the last step.
type Answer = [f64; 6];

/// Enumerates all sequences of ways and biases. The evidence comes as a logarithm.
fn exact() -> Answer {
    // (log weight, mean, variance, ways)
    let mut sequences = vec![(0.0, 0.0, 0.0, Vec::<usize>::new())];
    for [length, z, noise] in STEPS {
        let mut next = Vec::new();
        for (w, mean, variance, ways) in &sequences {
            for (way, (p_way, side)) in WAYS.iter().enumerate() {
                for (p_bias, bias) in BIASES {
                    let (predicted, spread) = (mean + side * length, variance + MOTION);
                    let d = z - bias - predicted;
                    let gain = spread / (spread + noise);
                    let w = w + (p_way * p_bias).ln() + log_normal(d, spread + noise);
                    let ways = [ways.as_slice(), &[way]].concat();
                    next.push((w, predicted + gain * d, (1.0 - gain) * spread, ways));
                }
            }
        }
        sequences = next;
    }
    let evidence = log_sum(sequences.iter().map(|s| LogWeight(s.0))).0;
    let mut out = [0.0; 6];
    for (w, mean, variance, ways) in &sequences {
        let p = (w - evidence).exp();
        out[1] += p * mean;
        out[2] += p * (variance + mean * mean);
        for (k, step) in [0, 1, STEPS.len() - 1].into_iter().enumerate() {
            out[3 + k] += if ways[step] == 0 { p } else { 0.0 };
        }
    }
    out[0] = evidence;
    out
}

struct Run {
    steps: Vec<Step>,
    particles: Vec<(State, f64)>,
    proposals: usize,
}

fn run(particles: usize, resample_below: f64, seed: u64, shares: bool) -> Run {
    let mut filter = ParticleFilter::new(start(), particles, resample_below, seed);
    let (mut steps, mut proposals) = (Vec::new(), 0);
    for step in STEPS {
        let model = Toy::new(step, shares);
        steps.push(filter.step(&model));
        proposals += model.proposals.into_inner();
    }
    let particles = filter.particles().iter().map(|p| (p.state.clone(), p.log_weight.0)).collect();
    Run { steps, particles, proposals }
}

/// The filter's answer; the evidence as a logarithm.
fn answer(run: &Run) -> Answer {
    let mut out = [0.0; 6];
    out[0] = run.steps.iter().map(|s| s.log_evidence).sum();
    for (state, log_weight) in &run.particles {
        let (w, ways) = (log_weight.exp(), ways(state));
        out[1] += w * state.x;
        out[2] += w * state.x * state.x;
        for (k, step) in [0, 1, STEPS.len() - 1].into_iter().enumerate() {
            out[3 + k] += if ways[STEPS.len() - 1 - step] == 0 { w } else { 0.0 };
        }
    }
    out
}

/// Bits of everything that a run ended in.
fn bits(run: &Run) -> Vec<u64> {
    let steps = run.steps.iter().flat_map(|s| [s.log_evidence, s.effective_sample_size]);
    let particles = run.particles.iter().flat_map(|(s, w)| [s.x, *w]);
    steps.chain(particles).map(f64::to_bits).collect()
}

/// The mean over many seeds lies within four standard errors of the exact value, and the standard
/// error is small enough to tell. The evidence (not its logarithm) is the unbiased quantity.
#[test]
fn moments_mode_probabilities_and_evidence_are_exact() {
    let exact = exact();
    // Both ways of every step must be likely, or there is nothing to get wrong.
    assert!(exact[3..].iter().all(|p| (0.1..0.9).contains(p)), "{exact:?}");
    let largest_error = [0.01, 0.02, 0.05, 0.01, 0.01, 0.01];
    for resample_below in [0.0, 0.5, 1.0] {
        let runs: Vec<Run> = (0..40).map(|seed| run(1000, resample_below, seed, true)).collect();
        let resampled = runs.iter().flat_map(|r| &r.steps).filter(|s| s.resampled).count();
        match resample_below {
            0.0 => assert_eq!(resampled, 0),
            0.5 => assert!((40..160).contains(&resampled), "in {resampled} steps of 200"),
            _ => assert!(resampled >= 160, "in {resampled} steps of 200"),
        }
        let answers: Vec<Answer> = runs
            .iter()
            .map(|r| {
                let mut a = answer(r);
                a[0] = (a[0] - exact[0]).exp();
                a
            })
            .collect();
        for k in 0..exact.len() {
            let expected = if k == 0 { 1.0 } else { exact[k] };
            let n = answers.len() as f64;
            let mean = answers.iter().map(|a| a[k]).sum::<f64>() / n;
            let variance = answers.iter().map(|a| (a[k] - mean).powi(2)).sum::<f64>() / (n - 1.0);
            let error = (variance / n).sqrt();
            assert!(error < largest_error[k], "answer {k}: too noisy to tell ({error})");
            assert!(
                (mean - expected).abs() < 4.0 * error,
                "resample below {resample_below}, answer {k}: {mean} +- {error}, exact {expected}"
            );
        }
    }
}

#[test]
fn resamples_exactly_when_few_particles_carry_the_weight() {
    for seed in 0..10 {
        for step in run(500, 0.5, seed, true).steps {
            assert!((1.0..=500.0 + 1e-6).contains(&step.effective_sample_size));
            assert_eq!(step.resampled, step.effective_sample_size < 250.0);
            assert_eq!(step.advanced, 500);
        }
    }
}

#[test]
fn weights_sum_to_one_whether_resampled_or_not() {
    for resample_below in [0.0, 0.5, 1.0] {
        let total: f64 =
            run(300, resample_below, 3, true).particles.iter().map(|p| p.1.exp()).sum();
        assert!((total - 1.0).abs() < 1e-9, "{total}");
    }
}

#[test]
fn sharing_the_proposals_of_copies_changes_nothing_but_the_work() {
    // Always resampling makes many copies.
    let (shared, alone) = (run(400, 1.0, 11, true), run(400, 1.0, 11, false));
    assert_eq!(bits(&shared), bits(&alone));
    assert_eq!(alone.proposals, 400 * STEPS.len());
    assert!(shared.proposals < alone.proposals * 9 / 10, "{} proposals", shared.proposals);
}

#[test]
fn threads_do_not_change_a_bit() {
    let with = |threads| bits(&with_threads(Some(threads), || run(200, 0.5, 5, true)).unwrap());
    let one = with(1);
    assert_eq!(one, with(2));
    assert_eq!(one, with(4));
}

#[test]
fn the_seed_alone_decides() {
    assert_eq!(bits(&run(100, 0.5, 8, true)), bits(&run(100, 0.5, 8, true)));
    assert_ne!(bits(&run(100, 0.5, 8, true)), bits(&run(100, 0.5, 9, true)));
}

#[test]
fn successors_share_their_ancestors() {
    let mut filter = ParticleFilter::new(start(), 200, 0.5, 2);
    for step in STEPS {
        let before: HashSet<*const Node> =
            filter.particles().iter().map(|p| Arc::as_ptr(&p.state)).collect();
        filter.step(&Toy::new(step, true));
        for p in filter.particles() {
            let parent = p.state.parent.as_ref().expect("everyone moved");
            assert!(before.contains(&Arc::as_ptr(parent)), "a history was copied");
        }
    }
    let roots: HashSet<*const Node> = filter
        .particles()
        .iter()
        .map(|p| std::iter::successors(Some(&p.state), |n| n.parent.as_ref()).last().unwrap())
        .map(Arc::as_ptr)
        .collect();
    assert_eq!(roots.len(), 1, "all stem from the one initial state");
}

#[test]
fn a_step_that_leads_nowhere_is_none() {
    let mut filter = ParticleFilter::new(start(), 50, 0.0, 3);
    let mut stuck = filter.clone();
    stuck.step(&Toy { nowhere: true, ..Toy::new(STEPS[0], true) });
    let (a, b) = (filter.step(&Toy::new(STEPS[0], true)), stuck.step(&Toy::new(STEPS[0], true)));
    assert_eq!(a, b);
    for (p, q) in filter.particles().iter().zip(stuck.particles()) {
        assert_eq!(p.state.x, q.state.x, "drawn from the same stream");
    }
}

#[test]
fn all_states_are_settled_when_they_are_told_to() {
    let mut filter = ParticleFilter::new(start(), 50, 0.0, 3);
    let models = STEPS.map(|step| Toy::new(step, true));
    models.iter().take(2).for_each(|model| drop(filter.step(model)));
    let before = filter.clone();
    filter.settle(&models[2]);
    for (p, q) in before.particles().iter().zip(filter.particles()) {
        assert_eq!((ways(&p.state), p.log_weight), (ways(&q.state), q.log_weight));
        assert!([1.0, 5.0].contains(&q.state.x.abs()), "at {}", q.state.x);
    }
}

#[test]
fn states_that_are_due_are_settled_once_and_keep_their_story_and_weight() {
    for resample_below in [0.0, 1.0] {
        let mut plain = ParticleFilter::new(start(), 200, resample_below, 3);
        let mut settling = plain.clone();
        for (k, step) in STEPS.iter().take(3).enumerate() {
            let model = Toy { settles: true, ..Toy::new(*step, true) };
            let (a, b) = (plain.step(&Toy::new(*step, true)), settling.step(&model));
            if k < 2 {
                assert_eq!(a, b);
            }
            for (p, q) in plain.particles().iter().zip(settling.particles()) {
                if k == 1 {
                    assert_eq!(ways(&p.state), ways(&q.state));
                    assert_eq!(p.log_weight, q.log_weight);
                    assert!([1.0, 5.0].contains(&q.state.x.abs()), "at {}", q.state.x);
                    assert_ne!(p.state.x, q.state.x);
                } else if k == 0 {
                    assert_eq!(p.state.x, q.state.x);
                }
            }
        }
    }
}
