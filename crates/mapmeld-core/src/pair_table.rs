//! The modes of all pairs: the virtual robot's odometry.

use crate::registration::pair::inverse;
use crate::registration::PairModes;
use crate::se2::Se2;
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

    /// Modes of `T_a_b`: transform, covariance, log-likelihood. Most likely first.
    pub fn modes(&self, a: usize, b: usize) -> Vec<(Se2, Matrix3<f64>, f64)> {
        let (lo, hi) = (a.min(b), a.max(b));
        let Some(k) = self.at[lo * self.n + hi] else { return Vec::new() };
        let modes = self.pairs[k as usize].found.modes.iter();
        modes
            .map(|m| {
                let (t, covariance) = if a == lo { (m.t_a_b, m.covariance) } else { inverse(m) };
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
        let k = self.at[a.min(b) * self.n + a.max(b)]?;
        self.pairs[k as usize].found.modes.first().map(|m| m.evidence.log_likelihood)
    }
}
