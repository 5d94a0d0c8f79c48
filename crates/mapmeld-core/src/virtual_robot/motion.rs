//! The motion model (paper, section 3): where the placed maps, and what is known, say that a map lies.

use super::{Here, VirtualRobot};
use crate::memory::Motion;
use crate::prior::{Fit, Prior};
use crate::registration::pair::log_search_volume;
use crate::registration::SAME_WORLD;
use crate::relation::Relation;
use crate::se2::Se2;
use nalgebra::Matrix3;
use std::sync::Arc;

impl VirtualRobot<'_> {
    /// How what is known of a map takes its poses in the frame of some placed maps; none where nothing is. Of
    /// several that tell of it the strongest counts, since they may tell the same; none may be contradicted.
    pub(super) fn prior_fit<'s>(
        &'s self,
        placed: &[(usize, Se2)],
        map: usize,
    ) -> Option<impl Fn(&Se2, &Matrix3<f64>) -> Option<Fit> + 's> {
        let known = placed.iter().filter_map(|(m, t)| Some((*t, self.prior(*m)?)));
        let of_prior = self
            .prior(map)
            .and_then(|prior| Some((prior, Prior::of_frame(&known.collect::<Vec<_>>())?)));
        let relations = &self.known.relations;
        let to_map = |(m, t): &(usize, Se2)| {
            let (m, t) = (*m, *t);
            relations.iter().filter_map(move |r| Some((t, r.between(m, map)?)))
        };
        let of_relations: Vec<(Se2, Relation)> = placed.iter().flat_map(to_map).collect();
        if of_prior.is_none() && of_relations.is_empty() {
            return None;
        }
        let volume = |(m, _): &(usize, Se2)| log_search_volume(&self.maps[*m], &self.maps[map]);
        let volume = placed.iter().map(volume).fold(0.0, f64::max);
        Some(move |t: &Se2, covariance: &Matrix3<f64>| {
            let mut best = Fit { log_odds: f64::NEG_INFINITY, pose: *t };
            if let Some((prior, frame)) = &of_prior {
                best = prior.fit(frame, t, covariance, volume)?;
            }
            for (x_i, relation) in &of_relations {
                let own = x_i.inverse().transport_covariance(covariance);
                let fit = relation.fit(&x_i.between(&best.pose), &own, volume)?;
                let log_odds = fit.log_odds.max(best.log_odds);
                best = Fit { log_odds, pose: x_i.compose(&fit.pose) };
            }
            Some(best)
        })
    }

    /// Motion model (paper, section 3): where the placed maps say that `map` lies. Modes of several
    /// placed maps that agree are one, and support each other.
    pub(super) fn motions(&self, placed: &[(usize, Se2)], map: usize) -> Vec<Motion> {
        let center = self.maps[map].center.unwrap_or_default();
        let mut found: Vec<Motion> = Vec::new();
        for (i, x_i) in placed {
            for (t, covariance, log_likelihood) in self.pairs.modes(*i, map) {
                found.push((
                    log_likelihood,
                    x_i.compose(&t),
                    x_i.transport_covariance(&covariance),
                ));
            }
        }
        if let Some(fit) = self.prior_fit(placed, map) {
            let near = |(support, x, covariance): Motion| {
                fit(&x, &covariance).map(|f| (support + f.log_odds, f.pose, covariance))
            };
            found = found.into_iter().filter_map(near).collect();
        } else {
            // What no pair speaks for no group of placed maps speaks for either.
            found.retain(|(support, ..)| *support > 0.0);
        }
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut kept: Vec<Motion> = Vec::new();
        for (support, x, covariance) in found {
            let same = |k: &&mut Motion| k.1.is_close_at(&x, center, SAME_WORLD.0, SAME_WORLD.1);
            match kept.iter_mut().find(same) {
                Some(k) => k.0 += support.max(0.0),
                None => kept.push((support, x, covariance)),
            }
        }
        kept.sort_by(|a, b| b.0.total_cmp(&a.0));
        kept.truncate(self.config.filter.candidates_per_map);
        kept
    }

    /// The motions of every open map that has any.
    pub(super) fn all_motions(&self, here: &Here) -> Vec<(usize, Arc<Vec<Motion>>)> {
        let open = (0..self.maps.len()).filter(|m| self.open[*m] && !here.is_placed[*m]);
        let found = if self.known.priors.is_empty() && self.known.relations.is_empty() {
            // What a map's partners say, and nothing else, tells where it lies.
            let mut partners: Vec<Vec<(usize, Se2)>> = vec![Vec::new(); self.maps.len()];
            for (i, x_i) in &here.placed {
                self.pairs.partners(*i).for_each(|m| partners[m].push((*i, *x_i)));
            }
            let known = |m: usize| {
                let placed = partners[m].as_slice();
                (m, self.memory.motions(m, placed, || self.motions(placed, m)))
            };
            open.filter(|m| !partners[*m].is_empty()).map(known).collect::<Vec<_>>()
        } else {
            open.map(|m| (m, Arc::new(self.motions(&here.placed, m)))).collect()
        };
        found.into_iter().filter(|(_, motions)| !motions.is_empty()).collect()
    }
}
