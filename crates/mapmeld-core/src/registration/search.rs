//! The search for the poses of a pair: thousands of candidates, narrowed down to the tops that they lead to.

mod begun;

use crate::config::{Config, PerceptionConfig, RegistrationConfig};
use crate::local_map::LocalMap;
use crate::perception::rigid;
use crate::registration::{
    self,
    climb::{self, Climb, STILL},
    corners, correlation,
    glance::{self, Glance, Look},
    rotations::Proposed,
    segments, Candidate, Source,
};
use crate::se2::{Se2, Vec2};
use begun::Begun;

/// Samples of each map that the very first look at a candidate takes.
const GLIMPSE_SAMPLES: usize = 16;
/// Samples that a second look takes.
const BRIEF_SAMPLES: usize = 32;
/// Samples of each map that the first steps uphill follow.
const FIRST_SAMPLES: usize = 128;
/// Samples of each map that a climb follows.
const CLIMB_SAMPLES: usize = 256;
/// Samples of each map that the last climb of a mode follows, and that tell what its top reaches.
const FINAL_SAMPLES: usize = 512;
/// Most steps of that climb, which begins at a top, of other samples or under another kernel. Along what holds bent maps
/// loosely it would go on for long, away from where more of the walls lie right.
const FINAL_STEPS: usize = 6;
/// Steps shorter than this, in cells, end all climbs but the last.
const NEAR: f64 = 0.1;
/// Share of what the best reaches that a pose needs to be followed further: what reaches less will not catch up, nor
/// does it make the best any less sure.
const RIVAL: f64 = 0.5;
/// Where the best reaches less than this, nats, others may lie as far behind it as if it reached this.
const TELLING: f64 = 20.0;
/// Share of the log-likelihood that matters at all which a pose must have for it to be followed any further.
const MAY_RISE: f64 = 0.5;
/// Log-likelihood from which the first looks at the others are held against a pose's, nats.
pub(super) const PROVEN: f64 = 60.0;
/// Share of all that the walls of a map can say, from which on corners and pairs of walls are not asked: they hardly ever
/// find a better pose then.
const PLENTY: f64 = 0.4;
/// Candidates that are led uphill however far their looks lie behind, before any others; what begins near another is none.
const FIRST_FOLLOWED: usize = 8;

/// What is spent on a search.
pub struct Effort {
    /// Candidates that climb to the top.
    pub shortlist: usize,
    /// Modes that are kept.
    pub modes: usize,
    /// Different stories that are told at least, however unlikely.
    pub stories: usize,
    /// What of it correlation takes.
    pub correlation: correlation::Effort,
    /// Whether corners and walls propose poses.
    pub has_structures: bool,
    /// Log-likelihood below which no pose matters, nats, at each standard deviation of the walls.
    pub least: Vec<f64>,
    /// How a candidate must look, see [`Glance::score`], for it to be led uphill.
    pub least_look: f64,
}

/// What a search found.
pub struct Found {
    /// Number of candidates that the sources proposed.
    pub candidates: usize,
    /// The local maxima that they lead to, at each standard deviation of the walls.
    pub tops: Vec<Vec<Candidate>>,
}

/// All that the sources propose for `T_a_b` if each is asked, unrefined: a search asks some of them only where others
/// find too little.
pub fn candidates(a: &LocalMap, b: &LocalMap, config: &RegistrationConfig) -> Vec<Candidate> {
    let mut found = of_structures(a, b, config);
    let thorough = correlation::THOROUGH;
    let rotations = Proposed::new(&a.turns, &b.turns, thorough.promising);
    for (some, effort) in [
        (rotations.promising(), thorough),
        (rotations.further(thorough.further), thorough.of_further()),
    ] {
        let correlated = correlation::candidates(a, b, &some, effort);
        found.extend(correlated.into_iter().map(|(_, c)| c));
    }
    found
}

/// What corners and walls propose, which says nothing yet of the rest of the maps.
fn of_structures(a: &LocalMap, b: &LocalMap, config: &RegistrationConfig) -> Vec<Candidate> {
    let mut found = corners::candidates(&a.corners, &b.corners, config);
    found.extend(segments::candidates(&a.lines, &b.lines));
    found
}

/// Searches for `T_a_b`. `hints` are transforms that are worth a climb whatever the sources say.
pub fn tops(a: &LocalMap, b: &LocalMap, hints: &[Se2], effort: &Effort, config: &Config) -> Found {
    let Some(search) = Search::new(a, b, effort, config) else {
        return Found { candidates: 0, tops: vec![Vec::new(); config.perception.rungs().len()] };
    };
    let (candidates, tops) = search.run(hints);
    let tops = (0..search.rungs.len()).map(|rung| search.final_tops(&tops, rung)).collect();
    Found { candidates, tops }
}

/// A pose and how well the maps fit there.
type Scored = (f64, Candidate);

/// A pose and its log-likelihood ratio at each standard deviation of the walls, nats.
type Weighed = (Candidate, Vec<f64>);

struct Search<'s> {
    a: &'s LocalMap,
    b: &'s LocalMap,
    /// Centre of b's known cells.
    center: Vec2,
    effort: &'s Effort,
    /// The model of rigid maps at each standard deviation of the walls.
    rungs: Vec<PerceptionConfig>,
    config: &'s RegistrationConfig,
}

impl<'s> Search<'s> {
    /// None when one of the maps is blank.
    fn new(
        a: &'s LocalMap,
        b: &'s LocalMap,
        effort: &'s Effort,
        config: &'s Config,
    ) -> Option<Self> {
        let (_, center) = (a.center?, b.center?);
        let rungs = config.perception.rungs().iter().map(PerceptionConfig::rigid).collect();
        Some(Self { a, b, center, effort, rungs, config: &config.registration })
    }

    /// Number of candidates, and the tops that they lead to.
    fn run(&self, hints: &[Se2]) -> (usize, Vec<Weighed>) {
        let (a, b) = (self.a, self.b);
        let hints: Vec<Candidate> =
            hints.iter().map(|t| Candidate { t_a_b: *t, source: Source::Members }).collect();
        let mut candidates = hints.len();
        let effort = self.effort.correlation;
        let rotations = Proposed::new(&a.turns, &b.turns, effort.promising);
        let mut look = |structures: Vec<Candidate>, rotations: &[f64], effort| {
            let found = correlation::candidates(a, b, rotations, effort);
            candidates += structures.len() + found.len();
            self.looked_at(structures, found.into_iter().map(|(_, c)| c).collect())
        };
        let looked_at = look(Vec::new(), &rotations.promising(), effort);
        let (few, rest) = looked_at.split_at(looked_at.len().min(FIRST_FOLLOWED));
        let mut begun = Begun::default();
        self.begin(few, &mut begun);
        let plenty = self.plenty();
        let has_plenty = begun.poses.iter().any(|(_, fits)| fits.iter().any(|l| *l > plenty));
        if has_plenty || (!self.effort.has_structures && effort.further == 0) {
            self.begin(rest, &mut begun);
        } else {
            let is_known = |c: &Candidate| is_proven(&self.weigh(*c, 2 * FIRST_SAMPLES));
            // Round columns and clutter have all directions: what the walls promise may be far from the truth.
            let is_found = begun.poses.iter().any(is_proven) || hints.iter().any(is_known);
            let others = rotations.further(if is_found { 0 } else { effort.further });
            let structures = match self.effort.has_structures {
                true => of_structures(a, b, self.config),
                false => Vec::new(),
            };
            let mut more = look(structures, &others, effort.of_further());
            more.extend(rest);
            self.begin(&self.distinct(more, self.followed()), &mut begun);
        }
        // The finest standard deviation tells sharp maps' poses apart, the widest finds those of bent maps;
        // what either finds is tried at all of them.
        let mut ends = vec![0, self.rungs.len() - 1];
        ends.dedup();
        let tops: Vec<Candidate> =
            ends.into_iter().flat_map(|rung| self.climbed(&begun.poses, &hints, rung)).collect();
        let tops = tops.into_iter().map(|c| self.weigh(c, FINAL_SAMPLES)).collect();
        (candidates, tops)
    }

    /// The candidates that deserve a climb, each with how it looks, the best first: all are looked at briefly, some
    /// longer. What was correlated has been looked at before.
    fn looked_at(&self, structures: Vec<Candidate>, correlated: Vec<Candidate>) -> Vec<Scored> {
        let shortlist = self.effort.shortlist;
        let glance = Glance::new(self.a, self.b);
        let look = |c: Candidate| (glance.at(&c.t_a_b), c);
        let mut looks: Vec<(Look, Candidate)> = structures.into_iter().map(look).collect();
        glance.narrow(&mut looks, GLIMPSE_SAMPLES, 30 * shortlist);
        glance.narrow(&mut looks, BRIEF_SAMPLES, 8 * shortlist);
        looks.extend(correlated.into_iter().map(look));
        glance.narrow(&mut looks, glance::MOST, usize::MAX);
        let looks = looks.into_iter().map(|(l, c)| (f64::from(l.score), c)).collect();
        self.distinct(looks, self.followed())
    }

    /// Most candidates that are led uphill at a time.
    fn followed(&self) -> usize {
        3 * self.effort.shortlist / 2
    }

    /// Log-likelihood from which on corners and pairs of walls are not asked, nats: by the map that shows less.
    fn plenty(&self) -> f64 {
        let weight = |m: &LocalMap| m.probes.iter().map(|p| f64::from(p.weight)).sum::<f64>();
        PROVEN.max(PLENTY * self.rungs[0].hit * weight(self.a).min(weight(self.b)))
    }

    /// The tops of the best at one standard deviation of the walls.
    fn climbed(&self, begun: &[Weighed], hints: &[Candidate], rung: usize) -> Vec<Candidate> {
        let begun = begun.iter().map(|(c, fits)| (fits[rung], *c)).collect();
        let mut shortlist =
            self.rivals(begun, rung, self.effort.shortlist / 2, self.effort.stories + 1);
        shortlist.extend(hints.iter().map(|c| {
            let (c, fits) = self.weigh(*c, 2 * FIRST_SAMPLES);
            (fits[rung], c)
        }));
        let at_top = self.with_tops(shortlist, &self.climb(CLIMB_SAMPLES), 2 * FIRST_SAMPLES, rung);
        poses(self.rivals(at_top, rung, self.effort.modes, self.effort.stories + 1))
    }

    /// The tops of all at one standard deviation of the walls, exactly.
    fn final_tops(&self, tops: &[Weighed], rung: usize) -> Vec<Candidate> {
        let tops = tops.iter().map(|(c, fits)| (fits[rung], *c)).collect();
        let few = self.rivals(tops, rung, self.effort.modes, self.effort.stories + 1);
        let climb = self.climb(FINAL_SAMPLES);
        let climb =
            Climb { scale: 0.0, still: STILL, steps: climb.steps.min(FINAL_STEPS), ..climb };
        let at_top = self.with_tops(few, &climb, FINAL_SAMPLES, rung);
        let kept = self.rivals(at_top, rung, self.effort.modes, self.effort.stories);
        let apart = registration::apart(&self.rungs[rung]);
        // What strangers would fit as well is no mode, but some runner-up there must be.
        let likely = kept.iter().take_while(|(l, _)| *l > 0.0).count();
        let told = |n: usize| {
            registration::stories(kept[..n].iter().map(|k| &k.1.t_a_b), self.center, apart)
        };
        let enough = (likely..kept.len()).find(|n| told(*n).len() >= self.effort.stories);
        poses(kept.into_iter().take(enough.unwrap_or(usize::MAX)).collect())
    }

    fn climb(&self, samples: usize) -> Climb {
        let scale = climb::wide(self.a, self.b);
        Climb { samples, steps: self.config.max_iterations, scale, still: NEAR }
    }

    /// Some poses, weighed by so many samples, and where they lead, weighed by as many: no climb ends below its start.
    fn with_tops(
        &self,
        some: Vec<Scored>,
        climb: &Climb,
        samples: usize,
        rung: usize,
    ) -> Vec<Scored> {
        let models = &self.rungs[rung..=rung];
        let top = |(_, c): &Scored| {
            let t_a_b = climb.top(self.a, self.b, &c.t_a_b, &models[0])?;
            let fit = rigid::log_likelihoods(self.a, self.b, &t_a_b, samples, models)[0];
            Some((fit, Candidate { t_a_b, ..*c }))
        };
        let mut tops: Vec<Scored> = some.iter().filter_map(top).collect();
        tops.extend(some);
        tops
    }

    fn weigh(&self, c: Candidate, samples: usize) -> Weighed {
        (c, rigid::log_likelihoods(self.a, self.b, &c.t_a_b, samples, &self.rungs))
    }

    /// The best `keep` of some poses, no two the same, that may still matter beside the best, and the next best,
    /// however unlikely beside it, until so many different stories are told: those that may matter once they have
    /// climbed on. Hints need not be likely.
    fn rivals(&self, scored: Vec<Scored>, rung: usize, keep: usize, stories: usize) -> Vec<Scored> {
        let (least, apart) = (self.effort.least[rung], registration::apart(&self.rungs[rung]));
        let scored = self.distinct(scored, usize::MAX);
        let most = scored.first().map_or(0.0, |(l, _)| *l);
        let bar = most - (1.0 - RIVAL) * most.max(TELLING);
        let bar = bar.max(least);
        let mut kept: Vec<Scored> = Vec::new();
        for (l, c) in scored {
            let told =
                || registration::stories(kept.iter().map(|k| &k.1.t_a_b), self.center, apart).len();
            let is_likely = l > bar || c.source == Source::Members;
            let may_fill = || l > MAY_RISE * least && kept.len() < keep + stories;
            if (is_likely && kept.len() < keep) || (may_fill() && told() < stories) {
                kept.push((l, c));
            }
        }
        kept
    }

    /// The best `keep` of which no two are the same pose (paper, section 3: duplicates are one mode).
    fn distinct(&self, mut scored: Vec<Scored>, keep: usize) -> Vec<Scored> {
        let finer = self.a.grid.resolution().min(self.b.grid.resolution());
        let distance = self.config.duplicate_distance.unwrap_or(2.0 * finer);
        let angle = self.config.duplicate_angle;
        // A stable sort: equals stay in the sources' order, whatever the machine.
        scored.sort_by(|x, y| y.0.total_cmp(&x.0));
        let mut kept: Vec<Scored> = Vec::with_capacity(keep.min(scored.len()));
        for (score, c) in scored {
            let is_same =
                |k: &Scored| k.1.t_a_b.is_close_at(&c.t_a_b, self.center, distance, angle);
            if !kept.iter().any(is_same) {
                kept.push((score, c));
                if kept.len() == keep {
                    break;
                }
            }
        }
        kept
    }
}

/// Whether a pose has proven itself at some standard deviation of the walls.
fn is_proven((_, fits): &Weighed) -> bool {
    fits.iter().any(|l| *l >= PROVEN)
}

fn poses(scored: Vec<Scored>) -> Vec<Candidate> {
    scored.into_iter().map(|(_, c)| c).collect()
}

#[cfg(test)]
mod tests;
