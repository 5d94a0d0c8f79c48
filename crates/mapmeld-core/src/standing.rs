//! How an arrangement that was found earlier stands under the maps as they are now.
//!
//! Maps that lie together are weighed against others that lie together, as the robot does it when it travels among
//! merged maps: at the places in question, and at those that their pairs propose.

use crate::cache::{Cache, Noted};
use crate::canonical::Canonical;
use crate::config::Config;
use crate::error::Result;
use crate::local_map::LocalMap;
use crate::merge;
use crate::pair_table::PairTable;
use crate::parallel;
use crate::perception::{placed, Overlay, WallEvidence};
use crate::prior::{self, Prior};
use crate::registration::pair::log_search_volume;
use crate::registration::{climb, SAME_WORLD};
use crate::result::{Known, Observer, Stage};
use crate::se2::{Se2, Vec2};
use crate::verdict::{self, Background};
use nalgebra::Matrix3;

/// Most places that the pairs propose beside those in question.
const MOST_RIVALS: usize = 8;

/// Where do some maps lie to others?
#[derive(Debug, Clone)]
pub struct Question {
    /// Maps, by index, and `T_base_map`.
    pub base: Vec<(usize, Se2)>,
    /// Others, and `T_moved_map`.
    pub moved: Vec<(usize, Se2)>,
    /// The places in question, `T_base_moved`.
    pub places: Vec<Se2>,
}

/// What the maps say of it.
#[derive(Debug, Clone)]
pub struct Answer {
    /// Probability of each place, and the first place, by its index, that is the same one: places from which walls
    /// lead to one pose are one.
    pub places: Vec<(f64, usize)>,
    /// The most probable of all other places; zero without one.
    pub rival: f64,
}

/// Answers questions from registered pairs and walls; nothing of it changes a merge.
pub(crate) fn answers(
    cache: &mut Cache,
    grids: &[Noted],
    known: &Known,
    config: &Config,
    questions: &[Question],
    observer: Observer,
) -> Result<Vec<Answer>> {
    let canonical = Canonical::of(grids.iter().map(|(g, _)| *g));
    let (grids, known) = (canonical.arranged(grids), canonical.known(known));
    let arranged = |placed: &[(usize, Se2)]| -> Vec<(usize, Se2)> {
        placed.iter().map(|(m, t)| (canonical.place(*m), *t)).collect()
    };
    parallel::with_threads(config.threads, || {
        let lent = cache.take(&grids, Stage::Prepare, config, observer)?;
        let found = merge::registered(&lent, cache, &known, config, observer);
        let answers = found.map(|found| {
            let config = &found.config;
            let answer = |q: &Question| {
                let (base, moved) = (arranged(&q.base), arranged(&q.moved));
                let of = Weighing { maps: &lent.maps, pairs: &found.pairs, known: &known, config };
                of.answer(&base, &moved, &q.places, found.rung)
            };
            questions.iter().map(answer).collect()
        });
        cache.give_back(lent);
        answers
    })?
}

struct Weighing<'a> {
    maps: &'a [LocalMap],
    pairs: &'a PairTable,
    known: &'a Known,
    config: &'a Config,
}

impl Weighing<'_> {
    fn answer(
        &self,
        base: &[(usize, Se2)],
        moved: &[(usize, Se2)],
        places: &[Se2],
        rung: usize,
    ) -> Answer {
        let overlay = |placed: &[(usize, Se2)]| {
            let first = Overlay::default();
            placed.iter().fold(first, |o, (m, t)| o.with(self.maps, *m, *t, 1.0, false))
        };
        let (below, above) = (overlay(base), overlay(moved));
        let center = self.center(moved);
        let (distance, angle) = SAME_WORLD;
        let is_same = |x: &Se2, y: &Se2| x.is_close_at(y, center, distance, angle);

        // What is in question is weighed where it climbs to, as far as it stays the same place.
        let looked = parallel::map(places, |x| {
            let (top, evidence) = self.look(&below, &above, x, true);
            if is_same(&top, x) {
                (top, evidence)
            } else {
                self.look(&below, &above, x, false)
            }
        });
        // Which of those seen each place is; the likelier speaks for places that are one.
        let mut seen: Vec<(Se2, WallEvidence)> = Vec::new();
        let mut seen_as: Vec<usize> = Vec::new();
        for (top, evidence) in looked {
            match seen.iter().position(|(x, _)| is_same(x, &top)) {
                Some(k) => {
                    seen_as.push(k);
                    if evidence.log_likelihood > seen[k].1.log_likelihood {
                        seen[k] = (top, evidence);
                    }
                }
                None => {
                    seen_as.push(seen.len());
                    seen.push((top, evidence));
                }
            }
        }
        let asked = seen.len();
        let mut rivals: Vec<Se2> = Vec::new();
        for t in self.proposed(base, moved) {
            if !rivals.iter().chain(places).any(|x| is_same(x, &t)) {
                rivals.push(t);
                if rivals.len() == MOST_RIVALS {
                    break;
                }
            }
        }
        for (top, evidence) in parallel::map(&rivals, |x| self.look(&below, &above, x, true)) {
            if !seen.iter().any(|(x, _)| is_same(x, &top)) {
                seen.push((top, evidence));
            }
        }

        let mut order: Vec<usize> = (0..seen.len()).collect();
        let likelihood = |k: &usize| seen[*k].1.log_likelihood;
        order.sort_by(|a, b| likelihood(b).total_cmp(&likelihood(a)));
        let sorted: Vec<&WallEvidence> = order.iter().map(|k| &seen[*k].1).collect();
        let involved = base.iter().chain(moved).map(|(m, _)| &self.maps[*m]);
        // As where merged maps join; a single map is asked for as on the robot's way.
        let pairs = if base.len().min(moved.len()) > 1 { base.len() * moved.len() } else { 1 };
        let alone =
            Background::new(involved, (rung, &self.config.perception), self.decoy(base, moved));
        let background = Background { pairs, ..alone };
        let mut verdict = verdict::weigh(&sorted, &background, &self.config.evidence);
        if let Some(odds) = self.prior_odds(base, moved, order.iter().map(|k| &seen[*k])) {
            let least = self.config.evidence.min_probability;
            verdict = prior::weighed(&verdict, &odds, least);
        }
        let mut probabilities = vec![0.0; seen.len()];
        for (k, p) in order.iter().zip(verdict.probabilities) {
            probabilities[*k] = p;
        }
        let rival = probabilities[asked..].iter().copied().fold(0.0, f64::max);
        let first = |k: &usize| seen_as.iter().position(|other| other == k).unwrap_or(0);
        let places = seen_as.iter().map(|k| (probabilities[*k], first(k))).collect();
        Answer { places, rival }
    }

    /// What the walls say, at a place or where it leads uphill.
    fn look(&self, below: &Overlay, above: &Overlay, x: &Se2, climbs: bool) -> (Se2, WallEvidence) {
        let p = &self.config.perception;
        let placed = below.placed(self.maps, &Se2::IDENTITY);
        let most = self.config.registration.max_iterations;
        let own = above.placed(self.maps, &Se2::IDENTITY);
        let top = if climbs { climb::climb_group(&placed, &own, x, most, p) } else { None };
        let x = top.unwrap_or(*x);
        (x, placed::between(&placed, &above.placed(self.maps, &x), p))
    }

    /// `T_base_moved` by the modes of every pair across, the likeliest first.
    fn proposed(&self, base: &[(usize, Se2)], moved: &[(usize, Se2)]) -> Vec<Se2> {
        let mut found: Vec<(f64, Se2)> = Vec::new();
        for (i, x_i) in base {
            for (j, x_j) in moved {
                let modes = self.pairs.modes(*i, *j).into_iter().filter(|(.., l)| *l > 0.0);
                let inverse = x_j.inverse();
                found.extend(modes.map(|(t, _, l)| (l, x_i.compose(&t).compose(&inverse))));
            }
        }
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        found.into_iter().map(|(_, t)| t).collect()
    }

    fn decoy(&self, base: &[(usize, Se2)], moved: &[(usize, Se2)]) -> f64 {
        let across = base.iter().flat_map(|(i, _)| moved.iter().map(move |(j, _)| (*i, *j)));
        across.map(|(i, j)| self.pairs.decoy(i, j)).fold(0.0, f64::max)
    }

    /// What priors say of places, nats; none where they say nothing.
    fn prior_odds<'s>(
        &self,
        base: &[(usize, Se2)],
        moved: &[(usize, Se2)],
        places: impl Iterator<Item = &'s (Se2, WallEvidence)>,
    ) -> Option<Vec<f64>> {
        let frame = |placed: &[(usize, Se2)]| {
            let known =
                placed.iter().filter_map(|(m, t)| Some((*t, self.known.priors.get(*m)?.as_ref()?)));
            Prior::of_frame(&known.collect::<Vec<_>>())
        };
        let (t_world_base, t_world_moved) = (frame(base)?, frame(moved)?);
        let volume =
            |(m, _): &(usize, Se2)| log_search_volume(&self.maps[*m], &self.maps[moved[0].0]);
        let volume = base.iter().map(volume).fold(0.0, f64::max);
        // Walls that speak against a place do not hold it, wherever the priors would have it: as when the robot
        // travels.
        let odds = |(x, e): &(Se2, WallEvidence)| {
            let fit = t_world_moved.fit(&t_world_base, x, &Matrix3::zeros(), volume);
            fit.filter(|_| e.log_likelihood > 0.0).map_or(f64::NEG_INFINITY, |f| f.log_odds)
        };
        Some(places.map(odds).collect())
    }

    /// The middle of some maps in their common frame.
    fn center(&self, placed: &[(usize, Se2)]) -> Vec2 {
        let centers = placed.iter().filter_map(|(m, t)| Some(t.apply(self.maps[*m].center?)));
        let (sum, n) = centers.fold((Vec2::zeros(), 0.0), |(s, n), c| (s + c, n + 1.0));
        sum / f64::max(n, 1.0)
    }
}
