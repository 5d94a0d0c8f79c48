//! Where some maps come to rest when they are let go near others: the local maximum of the walls' likelihood, and
//! what it is worth.

use crate::cache::{Cache, Noted};
use crate::config::Config;
use crate::error::Result;
use crate::local_map::LocalMap;
use crate::parallel;
use crate::perception::{placed, Overlay, WallEvidence};
use crate::registration::climb;
use crate::result::{Observer, Stage};
use crate::se2::Se2;
use crate::standing::Question;
use crate::verdict::{self, Background};

/// A place of some maps among others.
#[derive(Debug, Clone)]
pub struct Snap {
    /// Where the moved maps' frame lies in that of the others.
    pub t_base_moved: Se2,
    /// What the walls say there.
    pub evidence: WallEvidence,
    /// Probability that the place is right, as if it were the only one that anybody has looked at.
    pub probability: f64,
}

/// Climbs from each place where the maps are let go, at each degree of bending, and keeps the most probable. Maps of
/// the question are positions in `grids`; `decoy` is the best log-likelihood that mirror images of these maps are
/// known to reach, nats. None where no walls meet.
pub(crate) fn snap(
    cache: &mut Cache,
    grids: &[Noted],
    Question { base, moved, places }: &Question,
    decoy: f64,
    config: &Config,
    observer: Observer,
) -> Result<Option<Snap>> {
    let wanted: Vec<Noted> = base.iter().chain(moved).map(|(m, _)| grids[*m]).collect();
    parallel::with_threads(config.threads, || {
        let lent = cache.take(&wanted, Stage::Prepare, config, observer)?;
        let overlay = |first: usize, placed: &[(usize, Se2)]| {
            let maps = placed.iter().enumerate();
            maps.fold(Overlay::default(), |o, (k, (_, t))| {
                o.with(&lent.maps, first + k, *t, 1.0, false)
            })
        };
        let (below, above) = (overlay(0, base), overlay(base.len(), moved));
        let found = settle(&lent.maps, &below, &above, places, decoy, config);
        cache.give_back(lent);
        Ok(found)
    })?
}

fn settle(
    maps: &[LocalMap],
    below: &Overlay,
    above: &Overlay,
    places: &[Se2],
    decoy: f64,
    config: &Config,
) -> Option<Snap> {
    let most = config.registration.max_iterations;
    let base = below.placed(maps, &Se2::IDENTITY);
    let own = above.placed(maps, &Se2::IDENTITY);
    let rungs = config.perception.rungs();
    let at = |(rung, start): (usize, &Se2)| {
        let p = &rungs[rung];
        let t_base_moved = climb::climb_group(&base, &own, start, most, &p.rigid())?;
        let evidence = placed::between(&base, &above.placed(maps, &t_base_moved), p);
        let background = Background::new(maps.iter(), (rung, p), decoy);
        let verdict = verdict::weigh(&[&evidence], &background, &config.evidence);
        let probability = verdict.probabilities.first().copied().unwrap_or(0.0);
        Some(Snap { t_base_moved, evidence, probability })
    };
    let all = places.iter().flat_map(|x| (0..rungs.len()).map(move |rung| (rung, x)));
    let found = all.filter_map(at);
    // The finest of equals.
    found.reduce(|best, next| if next.probability > best.probability { next } else { best })
}
