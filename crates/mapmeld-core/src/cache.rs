//! What was worked out about maps, kept for the next merge by what the maps show.
//!
//! A prepared map depends on its cells alone, a registered pair on its two maps and its hints alone. So both are
//! kept by a digest of the contents: a map that did not change is found again, whatever it is called, and so are
//! the merged maps of a join.

use crate::canonical;
use crate::config::Config;
use crate::error::{Error, Result};
use crate::grid::OccupancyGrid;
use crate::local_map::LocalMap;
use crate::parallel;
use crate::registration::{pair, Registered};
use crate::result::{Observer, Stage};
use crate::se2::Se2;
use crate::stored::{self, Store};
use std::collections::HashMap;
use std::hash::Hash;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

/// Merges for which something is kept that none of them used: those that were interrupted use little.
const KEPT_FOR: u64 = 4;

/// What a grid shows, in 128 bits, the same on every machine. Names do not count.
pub type Digest = (u64, u64);

/// The digest of a grid.
pub fn digest(grid: &OccupancyGrid) -> Digest {
    let (height, width, numbers, cells) = canonical::key(grid);
    let mut hasher = blake3::Hasher::new();
    for number in [height as u64, width as u64].into_iter().chain(numbers) {
        hasher.update(&number.to_le_bytes());
    }
    let cells: Vec<u8> = cells.iter().map(|v| *v as u8).collect();
    hasher.update(&cells);
    let hash = *hasher.finalize().as_bytes();
    let half = |k: usize| u64::from_le_bytes(std::array::from_fn(|i| hash[8 * k + i]));
    (half(0), half(1))
}

/// A grid and its digest.
pub type Noted<'g> = (&'g OccupancyGrid, Digest);

/// Prepared maps that are lent out of a cache, and the digests of their grids.
pub struct Lent {
    /// In the order in which they were asked for.
    pub maps: Vec<LocalMap>,
    /// One for each.
    pub digests: Vec<Digest>,
}

/// The pair of two maps, and what hinted at it.
type PairKey = (Digest, Digest, Vec<[u64; 3]>);

struct Kept<T> {
    value: T,
    used: u64,
}

/// Prepared maps, their mirror images and registered pairs. Valid for one configuration.
#[derive(Default)]
pub struct Cache {
    /// None: nothing outlives the merge that needs it.
    generation: Option<u64>,
    maps: HashMap<Digest, Kept<LocalMap>>,
    mirrors: HashMap<Digest, Kept<LocalMap>>,
    /// By looks, not by generations.
    pairs: HashMap<PairKey, Kept<Registered>>,
    /// Merges that came to look at pairs: hints may change with each, and maps stay.
    looks: u64,
    /// Whether the merge that is under way did.
    has_looked: bool,
    /// Where pairs are kept beyond this process.
    store: Option<Arc<dyn Store>>,
}

impl Cache {
    /// Keeps from merge to merge what they use.
    pub fn lasting() -> Self {
        Self { generation: Some(0), ..Self::default() }
    }

    /// Keeps nothing: for one merge alone.
    pub fn passing() -> Self {
        Self::default()
    }

    /// Takes pairs from a store as well, and keeps there what it works out.
    pub fn with_store(self, store: Option<Arc<dyn Store>>) -> Self {
        Self { store, ..self }
    }

    fn now(&self) -> u64 {
        self.generation.unwrap_or(0)
    }

    /// A merge begins, of maps with these digests: what concerns them alone stays.
    pub fn begin(&mut self, current: &[Digest]) {
        let Some(generation) = &mut self.generation else { return };
        *generation += 1;
        let now = *generation;
        self.has_looked = false;
        for (key, kept) in self.maps.iter_mut().chain(&mut self.mirrors) {
            if current.contains(key) {
                kept.used = now;
            }
        }
    }

    /// A merge ends. One that was interrupted did not come to use all that it needs.
    pub fn end(&mut self, interrupted: bool) {
        let oldest = |now: u64| if interrupted { now.saturating_sub(KEPT_FOR) } else { now };
        let (oldest, oldest_pair) = (oldest(self.now()), oldest(self.looks));
        self.maps.retain(|_, kept| kept.used >= oldest);
        self.mirrors.retain(|_, kept| kept.used >= oldest);
        self.pairs.retain(|_, kept| kept.used >= oldest_pair);
    }

    /// Number of registered pairs that are kept.
    pub fn pairs(&self) -> usize {
        self.pairs.len()
    }

    /// Prepared maps of some grids, in their order. They are lent out of the cache: [`Cache::give_back`].
    pub fn take(
        &mut self,
        grids: &[Noted],
        stage: Stage,
        config: &Config,
        observer: Observer,
    ) -> Result<Lent> {
        let keys: Vec<Digest> = grids.iter().map(|(_, digest)| *digest).collect();
        let missing = first_of_each(&keys, |key| !self.maps.contains_key(key));
        let made =
            observed(&missing, stage, observer, |k| LocalMap::new(grids[*k].0.clone(), config));
        let used = self.now();
        for (k, made) in missing.iter().zip(made.parts) {
            if let Some(value) = made {
                self.maps.insert(keys[*k], Kept { value, used });
            }
        }
        made.whole?;
        let mut taken: Vec<LocalMap> = Vec::with_capacity(grids.len());
        for (k, key) in keys.iter().enumerate() {
            let of_like = || keys[..k].iter().position(|other| other == key);
            taken.push(match self.maps.remove(key) {
                Some(kept) => kept.value,
                // Two maps that show the same.
                None => taken[of_like().expect("made or taken before")].clone(),
            });
        }
        Ok(Lent { maps: taken, digests: keys })
    }

    /// Takes maps back that were lent.
    pub fn give_back(&mut self, lent: Lent) {
        if self.generation.is_some() {
            let used = self.now();
            let kept = lent.maps.into_iter().map(|value| Kept { value, used });
            self.maps.extend(lent.digests.into_iter().zip(kept));
        }
    }

    /// Some pairs of some maps, each hinted at some transforms, and how many of them had to be registered. Those
    /// that were are kept even when the observer ends it.
    pub fn register(
        &mut self,
        Lent { maps, digests }: &Lent,
        wanted: &[(usize, usize)],
        hints: impl Fn(usize, usize) -> Vec<Se2> + Sync + Send,
        config: &Config,
        observer: Observer,
    ) -> Result<(Vec<Registered>, usize)> {
        let hints: Vec<Vec<Se2>> = parallel::map(wanted, |(a, b)| hints(*a, *b));
        let bits = |t: &Se2| t.to_array().map(f64::to_bits);
        let key = |((a, b), hints): (&(usize, usize), &Vec<Se2>)| -> PairKey {
            (digests[*a], digests[*b], hints.iter().map(bits).collect())
        };
        let keys: Vec<PairKey> = wanted.iter().zip(&hints).map(key).collect();
        if !std::mem::replace(&mut self.has_looked, true) {
            self.looks += 1;
        }
        let looks = self.looks;
        // What is known already counts as used even if the observer ends the rest.
        for key in &keys {
            if let Some(kept) = self.pairs.get_mut(key) {
                kept.used = looks;
            }
        }
        let missing = first_of_each(&keys, |key| !self.pairs.contains_key(key));
        let missing = self.read_stored(missing, wanted, (&keys, &hints), config);

        let used = self.now();
        let seconds: Vec<Digest> = missing.iter().map(|k| keys[*k].1).collect();
        let unseen: Vec<usize> = first_of_each(&seconds, |key| !self.mirrors.contains_key(key))
            .into_iter()
            .map(|k| wanted[missing[k]].1)
            .collect();
        let root = stored::root(config);
        let stored_key = |k: usize| stored::key(&root, (keys[k].0, keys[k].1), &hints[k]);
        let mirrors = observed(&unseen, Stage::Register, observer, |b| maps[*b].mirrored());
        for (b, made) in unseen.iter().zip(mirrors.parts) {
            if let Some(value) = made {
                self.mirrors.insert(digests[*b], Kept { value, used });
            }
        }
        mirrors.whole?;
        let found = observed(&missing, Stage::Register, observer, |k| {
            let (a, b) = wanted[*k];
            let mirror = self.mirrors.get(&digests[b]).map(|kept| &kept.value);
            let found = pair::register(&maps[a], &maps[b], mirror, &hints[*k], (a, b), config);
            if let Some(store) = &self.store {
                store.write(&stored_key(*k), &stored::encode(&found));
            }
            found
        });
        for (k, found) in missing.iter().zip(found.parts) {
            if let Some(value) = found {
                self.pairs.insert(keys[*k].clone(), Kept { value, used: looks });
            }
        }
        found.whole?;
        for b in digests {
            if let Some(kept) = self.mirrors.get_mut(b) {
                kept.used = used;
            }
        }
        if self.generation.is_none() {
            self.mirrors.clear();
        }
        // Pairs of maps that show the same are one pair: the last of them may take it out.
        let mut left: HashMap<&PairKey, usize> = HashMap::new();
        keys.iter().for_each(|key| *left.entry(key).or_default() += 1);
        let told = wanted.iter().zip(&keys).map(|((a, b), key)| {
            let left = left.get_mut(key).expect("counted above");
            *left -= 1;
            let found = match self.generation {
                None if *left == 0 => self.pairs.remove(key).map(|kept| kept.value),
                _ => self.pairs.get(key).map(|kept| kept.value.clone()),
            };
            Registered { a: *a, b: *b, ..found.expect("registered above") }
        });
        Ok((told.collect(), missing.len()))
    }

    /// Takes what it can of the missing pairs from the store; gives those that it lacks.
    fn read_stored(
        &mut self,
        missing: Vec<usize>,
        wanted: &[(usize, usize)],
        (keys, hints): (&[PairKey], &[Vec<Se2>]),
        config: &Config,
    ) -> Vec<usize> {
        let Some(store) = &self.store else { return missing };
        let root = stored::root(config);
        let read = parallel::map(&missing, |k| {
            let key = stored::key(&root, (keys[*k].0, keys[*k].1), &hints[*k]);
            let found = stored::decode(&store.read(&key)?, wanted[*k]);
            if found.is_none() {
                store.unreadable(&key);
            }
            found
        });
        let mut left = Vec::new();
        for (k, found) in missing.into_iter().zip(read) {
            match found {
                Some(value) => {
                    let kept = Kept { value, used: self.looks };
                    self.pairs.insert(keys[k].clone(), kept);
                }
                None => left.push(k),
            }
        }
        left
    }
}

/// Indices of the first of each different key of those wanted.
fn first_of_each<K: Eq + Hash>(keys: &[K], wanted: impl Fn(&K) -> bool) -> Vec<usize> {
    let mut seen = std::collections::HashSet::new();
    (0..keys.len()).filter(|k| wanted(&keys[*k]) && seen.insert(&keys[*k])).collect()
}

/// What came out of some work that an observer may end.
pub struct Observed<R> {
    /// One for each item; none where the work had not begun when it was ended.
    pub parts: Vec<Option<R>>,
    /// Whether all was done.
    pub whole: Result<()>,
}

/// `f` of every item in parallel; the observer is asked after each.
pub fn observed<T: Sync, R: Send>(
    items: &[T],
    stage: Stage,
    observer: Observer,
    f: impl Fn(&T) -> R + Sync + Send,
) -> Observed<R> {
    let ended = AtomicBool::new(!observer(stage, 0, items.len()));
    let done = Mutex::new(0);
    let parts = parallel::map(items, |item| {
        if ended.load(Ordering::Relaxed) {
            return None;
        }
        let made = f(item);
        // Held while the observer is told, so that it hears the numbers in their order.
        let mut done = done.lock().expect("observers do not panic");
        *done += 1;
        if !observer(stage, *done, items.len()) {
            ended.store(true, Ordering::Relaxed);
        }
        Some(made)
    });
    let whole = if ended.into_inner() { Err(Error::Interrupted) } else { Ok(()) };
    Observed { parts, whole }
}
