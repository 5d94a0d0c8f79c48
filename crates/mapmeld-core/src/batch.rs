//! Registration away from the merge: which pairs it needs, and some of them registered, on whatever machine.

use crate::cache::{self, Cache, Noted};
use crate::canonical::Canonical;
use crate::config::Config;
use crate::error::Result;
use crate::grid::OccupancyGrid;
use crate::merge;
use crate::parallel;
use crate::partners;
use crate::result::{Known, Observer, Stage};
use crate::se2::Se2;
use crate::stored;

/// A pair that a merge needs.
#[derive(Debug, Clone)]
pub struct Planned {
    /// Index of its first map, which need not be the smaller one.
    pub a: usize,
    /// Index of its second map.
    pub b: usize,
    /// Transforms that are worth a climb.
    pub hints: Vec<Se2>,
    /// The key under which a [`stored::Store`] keeps it.
    pub key: String,
}

/// The pairs of some maps that a merge of them begins with.
pub fn plan(
    grids: &[OccupancyGrid],
    known: &Known,
    config: &Config,
    observer: Observer,
) -> Result<Vec<Planned>> {
    config.validate()?;
    merge::check_known(known, grids.len())?;
    let noted: Vec<Noted> = grids.iter().map(|g| (g, cache::digest(g))).collect();
    let canonical = Canonical::of(grids.iter());
    let (arranged, known) = (canonical.arranged(&noted), canonical.known(known));
    let root = stored::root(config);
    parallel::with_threads(config.threads, || {
        let lent = Cache::passing().take(&arranged, Stage::Prepare, config, observer)?;
        let hints = merge::hints(&known);
        let planned = |(a, b): (usize, usize)| {
            let hints = hints(a, b);
            let key = stored::key(&root, (lent.digests[a], lent.digests[b]), &hints);
            Planned { a: canonical.given(a), b: canonical.given(b), hints, key }
        };
        let wanted = partners::pairs(&lent.maps, &known, config);
        Ok(wanted.into_iter().map(planned).collect())
    })?
}

/// Registers pairs of some maps (first, second, hints); each as bytes for a [`stored::Store`].
pub fn register(
    grids: &[OccupancyGrid],
    wanted: &[(usize, usize, Vec<Se2>)],
    config: &Config,
    observer: Observer,
) -> Result<Vec<Vec<u8>>> {
    config.validate()?;
    let noted: Vec<Noted> = grids.iter().map(|g| (g, cache::digest(g))).collect();
    parallel::with_threads(config.threads, || {
        let mut cache = Cache::passing();
        let lent = cache.take(&noted, Stage::Prepare, config, observer)?;
        let mut found = Vec::with_capacity(wanted.len());
        for (a, b, hints) in wanted {
            let hints = |_, _| hints.clone();
            let (registered, _) = cache.register(&lent, &[(*a, *b)], hints, config, observer)?;
            found.extend(registered.iter().map(stored::encode));
        }
        Ok(found)
    })?
}
