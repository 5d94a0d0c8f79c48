//! The modes of all pairs: the virtual robot's odometry.

use crate::evidence::Status;
use crate::registration::pair::inverse;
use crate::registration::{PairModes, SAME_WORLD};
use crate::se2::{Se2, Vec2};
use nalgebra::Matrix3;

/// The modes of all pairs, found by either order of their maps.
#[derive(Debug, Clone)]
pub struct PairTable {
    n: usize,
    pairs: Vec<PairModes>,
    /// Index into `pairs` of every ordered pair, `a * n + b`.
    at: Vec<Option<u32>>,
}

impl PairTable {
    /// From the registered pairs of `n` maps, each with `a < b`.
    pub fn new(n: usize, pairs: Vec<PairModes>) -> Self {
        let mut at = vec![None; n * n];
        for (k, p) in pairs.iter().enumerate() {
            at[p.a * n + p.b] = Some(k as u32);
        }
        Self { n, pairs, at }
    }

    /// The pairs.
    pub fn pairs(&self) -> &[PairModes] {
        &self.pairs
    }

    /// Takes the pairs out.
    pub fn into_pairs(self) -> Vec<PairModes> {
        self.pairs
    }

    /// Pairs whose match is wrong: their modes are told no more.
    pub fn forbid(&mut self, is_forbidden: impl Fn(usize, usize) -> bool) {
        for p in self.pairs.iter_mut().filter(|p| is_forbidden(p.a, p.b)) {
            (p.status, p.probability) = (Status::Forbidden, 0.0);
        }
    }

    fn allowed(&self, a: usize, b: usize) -> Option<&PairModes> {
        let k = self.at[a.min(b) * self.n + a.max(b)]?;
        Some(&self.pairs[k as usize]).filter(|p| p.status != Status::Forbidden)
    }

    /// Whether `T_a_b` is where the walls of a forbidden pair match best. `center` is that of map b.
    pub fn is_refused(&self, a: usize, b: usize, t_a_b: &Se2, center: Vec2) -> bool {
        let Some(k) = self.at[a.min(b) * self.n + a.max(b)] else { return false };
        let p = &self.pairs[k as usize];
        let best = p.found.modes.first().filter(|_| p.status == Status::Forbidden);
        best.is_some_and(|m| {
            let t = if a == p.a { m.t_a_b } else { m.t_a_b.inverse() };
            let (distance, angle) = SAME_WORLD;
            m.evidence.log_likelihood > 0.0 && t_a_b.is_close_at(&t, center, distance, angle)
        })
    }

    /// Modes of `T_a_b`: transform, covariance, log-likelihood. Most likely first.
    pub fn modes(&self, a: usize, b: usize) -> Vec<(Se2, Matrix3<f64>, f64)> {
        let Some(pair) = self.allowed(a, b) else { return Vec::new() };
        let modes = pair.found.modes.iter();
        modes
            .map(|m| {
                let (t, covariance) =
                    if a == pair.a { (m.t_a_b, m.covariance) } else { inverse(m) };
                (t, covariance, m.evidence.log_likelihood)
            })
            .collect()
    }

    /// The best log-likelihood that the mirror image of one of the maps reaches on the other; zero where
    /// none was tried.
    pub fn decoy(&self, a: usize, b: usize) -> f64 {
        let k = self.at[a.min(b) * self.n + a.max(b)];
        k.map_or(0.0, |k| self.pairs[k as usize].found.decoy())
    }

    /// Log-likelihood of the best mode of a pair; none without a mode.
    pub fn best(&self, a: usize, b: usize) -> Option<f64> {
        self.allowed(a, b)?.found.modes.first().map(|m| m.evidence.log_likelihood)
    }
}
