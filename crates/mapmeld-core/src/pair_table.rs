//! The modes of the registered pairs: the virtual robot's odometry.

use crate::evidence::Status;
use crate::registration::pair::inverse;
use crate::registration::{Mode, PairModes, SAME_WORLD};
use crate::se2::{Se2, Vec2};
use nalgebra::Matrix3;

/// The modes of the registered pairs, found by either order of their maps.
#[derive(Debug, Clone)]
pub struct PairTable {
    pairs: Vec<PairModes>,
    /// For each map the maps it was registered with, ascending, and where in `pairs`.
    at: Vec<Vec<(u32, u32)>>,
}

impl PairTable {
    /// From registered pairs of `n` maps, each with `a < b`.
    pub fn new(n: usize, pairs: Vec<PairModes>) -> Self {
        let mut at = vec![Vec::new(); n];
        for (k, p) in pairs.iter().enumerate() {
            at[p.a].push((p.b as u32, k as u32));
            at[p.b].push((p.a as u32, k as u32));
        }
        at.iter_mut().for_each(|of_map| of_map.sort_unstable());
        Self { pairs, at }
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

    /// The maps that a map was registered with, ascending.
    pub fn partners(&self, map: usize) -> impl Iterator<Item = usize> + '_ {
        self.at[map].iter().map(|(other, _)| *other as usize)
    }

    fn find(&self, a: usize, b: usize) -> Option<&PairModes> {
        let k = self.at[a].binary_search_by_key(&(b as u32), |(other, _)| *other).ok()?;
        Some(&self.pairs[self.at[a][k].1 as usize])
    }

    fn allowed(&self, a: usize, b: usize) -> Option<&PairModes> {
        self.find(a, b).filter(|p| p.status != Status::Forbidden)
    }

    /// Whether `T_a_b` is where the walls of a forbidden pair match best. `center` is that of map b.
    pub fn is_refused(&self, a: usize, b: usize, t_a_b: &Se2, center: Vec2) -> bool {
        let Some(p) = self.find(a, b) else { return false };
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
        let turned = |m: &Mode| if a == pair.a { (m.t_a_b, m.covariance) } else { inverse(m) };
        let modes = pair.found.modes.iter();
        modes
            .map(|m| {
                let (t, covariance) = turned(m);
                (t, covariance, m.evidence.log_likelihood)
            })
            .collect()
    }

    /// The pairs of a map that alone would be merged: the other map, `T_map_other` of the best mode, and its
    /// probability.
    pub fn carried(&self, map: usize) -> impl Iterator<Item = (usize, Se2, f64)> + '_ {
        self.at[map].iter().filter_map(move |(other, k)| {
            let p = &self.pairs[*k as usize];
            let t_a_b = p.found.modes.first().filter(|_| p.status == Status::Merged)?.t_a_b;
            let t = if p.a == map { t_a_b } else { t_a_b.inverse() };
            Some((*other as usize, t, p.probability))
        })
    }

    /// Whether two maps belong together by what their pair says alone, wherever they lie.
    pub fn is_carried(&self, a: usize, b: usize) -> bool {
        self.find(a, b).is_some_and(|p| matches!(p.status, Status::Merged | Status::Ambiguous))
    }

    /// The best log-likelihood that the mirror image of one of the maps reaches on the other; where it was not
    /// tried, what the modes reach, none of which stands: that is chance as well. Zero of pairs not registered.
    pub fn decoy(&self, a: usize, b: usize) -> f64 {
        let chance = |p: &PairModes| match (p.found.decoy, p.found.modes.first()) {
            (None, Some(best)) => best.evidence.log_likelihood.max(0.0),
            _ => p.found.decoy(),
        };
        self.find(a, b).map_or(0.0, chance)
    }

    /// Log-likelihood of the best mode of a pair; none without a mode.
    pub fn best(&self, a: usize, b: usize) -> Option<f64> {
        self.allowed(a, b)?.found.modes.first().map(|m| m.evidence.log_likelihood)
    }
}
