//! A Rao-Blackwellized particle filter with a multi-modal improved proposal. It knows nothing of maps.
//!
//! A particle is a state with a weight. In every step each particle is offered the modes of its
//! proposal (places where the likelihood has a local maximum, each with a Gaussian around it). The
//! observation model weighs all modes of all particles at once, so that relative models can normalise
//! over the pool. Each particle draws one mode in proportion to its likelihood mass, draws inside it,
//! folds the observation into its state, and its weight grows by the sum over its modes: the predictive
//! likelihood (Stachniss, Grisetti, Burgard, Roy, "Analyzing Gaussian proposal distributions for mapping
//! with Rao-Blackwellized particle filters", IROS 2007). When the effective sample size falls under a
//! share of the particles, they are resampled with low variance. States that share their history
//! through shared pointers stay cheap to copy.

mod resample;
mod weight;

pub use resample::low_variance;
pub use weight::{effective_sample_size, log_sum, normalise, LogWeight};

use crate::parallel;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

/// Random numbers of one particle in one step.
pub type Stream = Pcg64;

/// The three conditional models of the filter.
pub trait Model: Sync {
    /// What a particle knows: its trajectory and, given that, the analytic rest. Cheap to clone.
    type State: Clone + Send + Sync;
    /// One mode of the proposal.
    type Mode: Send + Sync;

    /// Proposal: the modes that the state can go to next. None: the state stays as it is.
    fn propose(&self, state: &Self::State) -> Vec<Self::Mode>;

    /// Observation: the log-likelihood mass of every mode, `log of integral p(z | x) p(x | state) dx`
    /// over the mode, one vector a particle; all particles' modes are given together.
    fn log_masses(&self, pool: &[&[Self::Mode]]) -> Vec<Vec<LogWeight>>;

    /// Weight of staying, for a particle without a mode while others move on.
    fn log_mass_of_staying(&self, masses: &[Vec<LogWeight>]) -> LogWeight;

    /// Update: draws a successor inside the mode and folds the observation in.
    fn advance(&self, state: &Self::State, mode: &Self::Mode, rng: &mut Stream) -> Self::State;

    /// Whether a proposal makes use of what earlier ones worked out, so that their order counts: they are made one
    /// after the other then.
    fn learns(&self) -> bool {
        false
    }

    /// Whether it is time to settle a state.
    fn is_due(&self, _state: &Self::State) -> bool {
        false
    }

    /// The same story, led to where all that was observed fits best: the noise of many draws adds up, and so does what
    /// each of them did not know (resample and move: Gilks, Berzuini, "Following a moving target", 2001).
    fn settled(&self, state: &Self::State) -> Self::State {
        state.clone()
    }

    /// True when both states are one and the same, or so close that one's modes serve the other as well.
    fn is_same(&self, _a: &Self::State, _b: &Self::State) -> bool {
        false
    }
}

/// A weighted sample of the posterior.
#[derive(Debug, Clone)]
pub struct Particle<S> {
    /// The sample.
    pub state: S,
    /// Its weight; the weights of a filter sum to one.
    pub log_weight: LogWeight,
}

/// What a step did.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// Particles that had a mode to go to.
    pub advanced: usize,
    /// N_eff before resampling.
    pub effective_sample_size: f64,
    /// The particles' weights before resampling; they sum to one.
    pub weights: Vec<f64>,
    /// Whether particles were resampled.
    pub resampled: bool,
    /// Log of the estimated p(z_t | z_1..t-1).
    pub log_evidence: f64,
}

/// What a step has to tell to a listener, before it resamples.
pub struct Told<'a, M: Model> {
    /// Which step, from 1.
    pub step: u64,
    /// The particles before the step.
    pub before: &'a [Particle<M::State>],
    /// Of each group of particles in the same state, one of them.
    pub leaders: &'a [usize],
    /// The modes that each group was offered.
    pub modes: &'a [Vec<M::Mode>],
    /// Their masses.
    pub masses: &'a [Vec<LogWeight>],
    /// The particles after the step, their weights not yet normalised.
    pub after: &'a [Particle<M::State>],
}

/// See the module's text.
#[derive(Debug, Clone)]
pub struct ParticleFilter<S> {
    particles: Vec<Particle<S>>,
    resample_below: f64,
    seed: u64,
    step: u64,
}

impl<S: Clone + Send + Sync> ParticleFilter<S> {
    /// So many equal particles. They are resampled when N_eff falls under `resample_below` times their
    /// number.
    pub fn new(initial: S, particles: usize, resample_below: f64, seed: u64) -> Self {
        let log_weight = LogWeight(-(particles as f64).ln());
        Self {
            particles: vec![Particle { state: initial, log_weight }; particles],
            resample_below,
            seed,
            step: 0,
        }
    }

    /// The particles; their weights sum to one.
    pub fn particles(&self) -> &[Particle<S>] {
        &self.particles
    }

    /// One step: propose, weigh, draw and update, normalise, resample.
    pub fn step<M: Model<State = S>>(&mut self, model: &M) -> Step {
        self.step_told(model, None::<&fn(&Told<M>, &Step)>)
    }

    /// A step that is told to a listener, if there is one.
    pub fn step_told<M: Model<State = S>>(
        &mut self,
        model: &M,
        listener: Option<&impl Fn(&Told<M>, &Step)>,
    ) -> Step {
        let n = self.particles.len();
        self.step += 1;

        // Propose. One turn serves all particles whose states are the same.
        let mut group_of = Vec::with_capacity(n);
        let mut leaders: Vec<usize> = Vec::new();
        for (i, p) in self.particles.iter().enumerate() {
            let is_led = |l: &usize| model.is_same(&self.particles[*l].state, &p.state);
            let group = leaders.iter().position(is_led).unwrap_or_else(|| {
                leaders.push(i);
                leaders.len() - 1
            });
            group_of.push(group);
        }
        let propose = |l: &usize| model.propose(&self.particles[*l].state);
        let modes = match model.learns() {
            true => leaders.iter().map(propose).collect(),
            false => parallel::map(&leaders, propose),
        };

        // Weigh: the predictive likelihood of a particle is the sum over its modes.
        let pool: Vec<&[M::Mode]> = modes.iter().map(Vec::as_slice).collect();
        let masses = model.log_masses(&pool);
        let totals: Vec<LogWeight> = masses.iter().map(|m| log_sum(m.iter().copied())).collect();
        let staying = model.log_mass_of_staying(&masses);

        // Draw and update, each particle from its own stream.
        let indices: Vec<usize> = (0..n).collect();
        let (seed, step) = (self.seed, self.step);
        let advanced = parallel::map(&indices, |i| {
            let (p, g) = (&self.particles[*i], group_of[*i]);
            if totals[g].is_zero() {
                return (
                    Particle { state: p.state.clone(), log_weight: p.log_weight * staying },
                    0,
                );
            }
            let mut rng = stream(seed, step, *i as u64);
            let chosen = draw(&normalise(&masses[g]), rng.random());
            let state = model.advance(&p.state, &modes[g][chosen], &mut rng);
            (Particle { state, log_weight: p.log_weight * totals[g] }, 1)
        });
        let (after, moved): (Vec<Particle<S>>, Vec<usize>) = advanced.into_iter().unzip();
        let before = std::mem::replace(&mut self.particles, after);

        // Normalise; resample when few particles carry the weight.
        let weights: Vec<LogWeight> = self.particles.iter().map(|p| p.log_weight).collect();
        let log_evidence = log_sum(weights.iter().copied()).0;
        let normalised = normalise(&weights);
        let effective_sample_size = effective_sample_size(&normalised);
        let resampled = effective_sample_size < self.resample_below * n as f64;
        let fared = Step {
            advanced: moved.iter().sum(),
            effective_sample_size,
            weights: normalised,
            resampled,
            log_evidence,
        };
        if let Some(tell) = listener {
            let (leaders, modes, masses) = (&leaders, &modes, &masses);
            let (before, after) = (&before, &self.particles);
            tell(&Told { step, before, leaders, modes, masses, after }, &fared);
        }
        // Those that stayed have been settled, or will be at the end.
        let went = self.particles.iter_mut().zip(&moved).filter(|(_, moved)| **moved > 0);
        settle(model, went.map(|(p, _)| p).filter(|p| model.is_due(&p.state)));
        if resampled {
            let start = stream(seed, step, u64::MAX).random();
            let log_weight = LogWeight(-(n as f64).ln());
            self.particles = low_variance(&fared.weights, n, start)
                .into_iter()
                .map(|i| Particle { state: self.particles[i].state.clone(), log_weight })
                .collect();
        } else {
            for (p, w) in self.particles.iter_mut().zip(&fared.weights) {
                p.log_weight = LogWeight(w.ln());
            }
        }
        // A step that leads nowhere is none.
        self.step -= u64::from(fared.advanced == 0);
        fared
    }

    /// Settles all states, whether they are due or not.
    pub fn settle<M: Model<State = S>>(&mut self, model: &M) {
        settle(model, self.particles.iter_mut());
    }
}

/// Settles some states, those that are the same as one.
fn settle<'p, M: Model>(model: &M, particles: impl Iterator<Item = &'p mut Particle<M::State>>)
where
    M::State: 'p,
{
    let mut settled: Vec<(M::State, M::State)> = Vec::new();
    for p in particles {
        let known = settled.iter().position(|(before, _)| model.is_same(before, &p.state));
        let k = known.unwrap_or_else(|| {
            settled.push((p.state.clone(), model.settled(&p.state)));
            settled.len() - 1
        });
        p.state = settled[k].1.clone();
    }
}

/// The random stream of (seed, step, index).
pub fn stream(seed: u64, step: u64, index: u64) -> Stream {
    // Odd multipliers keep neighbouring (step, index) pairs far apart in the seed space.
    let mixed = seed
        ^ step.wrapping_mul(0x9E37_79B9_7F4A_7C15)
        ^ index.wrapping_mul(0xD1B5_4A32_D192_ED03).rotate_left(23);
    Pcg64::seed_from_u64(mixed)
}

/// Index drawn with the given probabilities; `u` in [0, 1).
fn draw(probabilities: &[f64], u: f64) -> usize {
    let mut upto = 0.0;
    for (i, p) in probabilities.iter().enumerate() {
        upto += p;
        if u < upto {
            return i;
        }
    }
    // Rounding left a sliver: the last index that can be drawn at all.
    probabilities.iter().rposition(|p| *p > 0.0).unwrap_or(0)
}
