//! What the virtual robot has worked out on its way and need not work out again.
//!
//! Where a map may lie, and what its walls say there, changes only when a map is placed next to it. So both are
//! remembered by what they depend on: the placed maps nearby.

use crate::perception::{Layer, Overlay, WallEvidence};
use crate::se2::Se2;
use nalgebra::Matrix3;
use std::collections::HashMap;
use std::hash::Hash;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Support, pose and covariance of a place where a map may lie.
pub type Motion = (f64, Se2, Matrix3<f64>);

/// Placed maps and the bits of their poses.
type Placed = Vec<(usize, [u64; 3])>;

/// A map, the bits of its pose, and the layers nearby, by where they are kept.
type Seen = (usize, [u64; 3], Vec<usize>);

/// A layer, by where it is kept, a map and the bits of its pose.
type Asked = (usize, usize, [u64; 3]);

type Known<K, V> = Mutex<HashMap<K, V>>;

/// From so many on what single layers say is forgotten, unless it is asked for again.
const MANY_WORDS: usize = 1 << 16;

/// See the module's text.
#[derive(Default)]
pub struct Memory {
    motions: Known<(usize, Placed), Arc<Vec<Motion>>>,
    looks: Known<Seen, Look>,
    similar: Known<(usize, Vec<usize>), Vec<Similar>>,
    words: Mutex<Words>,
}

/// What one layer says of a map.
#[derive(Clone)]
struct Word {
    evidence: WallEvidence,
    /// Keeps the layer where it is.
    _layer: Overlay,
}

/// What layers say, in two halves: once the newer one is full, the older one is forgotten. What is asked for again is
/// new again, so what particles still need stays, and nothing else for long.
#[derive(Default)]
struct Words {
    new: HashMap<Asked, Word>,
    old: HashMap<Asked, Word>,
}

impl Words {
    fn get(&mut self, key: &Asked) -> Option<WallEvidence> {
        if let Some(word) = self.new.get(key) {
            return Some(word.evidence);
        }
        let (key, word) = self.old.remove_entry(key)?;
        let evidence = word.evidence;
        self.insert(key, word);
        Some(evidence)
    }

    fn insert(&mut self, key: Asked, word: Word) {
        if self.new.len() >= MANY_WORDS {
            self.old = std::mem::take(&mut self.new);
        }
        self.new.insert(key, word);
    }
}

/// What the walls of a map say at a pose, and the poses of the maps nearby.
struct Similar {
    pose: Se2,
    placed: Vec<(usize, Se2)>,
    evidence: Option<WallEvidence>,
}

#[derive(Clone)]
struct Look {
    found: Option<(Se2, WallEvidence)>,
    /// Keeps the layers where they are.
    _merged: Overlay,
}

impl Memory {
    /// Where `map` may lie to some placed maps.
    pub fn motions(
        &self,
        map: usize,
        placed: &[(usize, Se2)],
        work_out: impl FnOnce() -> Vec<Motion>,
    ) -> Arc<Vec<Motion>> {
        let key = (map, placed.iter().map(|(m, t)| (*m, bits(t))).collect());
        remembered(&self.motions, key, || Arc::new(work_out()))
    }

    /// What the walls of a map say at a pose next to some layers of a merged map; none where it is hopeless.
    pub fn look(
        &self,
        (map, x): (usize, &Se2),
        (merged, layers): (&Overlay, Vec<usize>),
        work_out: impl FnOnce() -> Option<(Se2, WallEvidence)>,
    ) -> Option<(Se2, WallEvidence)> {
        let look = remembered(&self.looks, (map, bits(x), layers), || Look {
            found: work_out(),
            _merged: merged.clone(),
        });
        look.found
    }

    /// What one layer, the last of `top`, says of a map at a pose.
    pub fn word(
        &self,
        (layer, top): (&Layer, impl FnOnce() -> Overlay),
        (map, x): (usize, &Se2),
        work_out: impl FnOnce() -> WallEvidence,
    ) -> WallEvidence {
        let key = (std::ptr::from_ref(layer) as usize, map, bits(x));
        if let Some(known) = self.words().get(&key) {
            return known;
        }
        let word = Word { evidence: work_out(), _layer: top() };
        let evidence = word.evidence;
        self.words().insert(key, word);
        evidence
    }

    /// Forgets what single layers say: they are left behind where all is placed anew.
    pub fn forget_words(&self) {
        *self.words() = Words::default();
    }

    fn words(&self) -> MutexGuard<'_, Words> {
        self.words.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What the walls of a map say at a pose next to some placed maps, or at one so close to it next to the same
    /// maps, each as close to its place, that it says the same.
    pub fn similar(
        &self,
        (map, x): (usize, &Se2),
        placed: &[(usize, Se2)],
        is_close: impl Fn(&Se2, &Se2) -> bool,
        work_out: impl FnOnce() -> Option<WallEvidence>,
    ) -> Option<WallEvidence> {
        let key = (map, placed.iter().map(|(m, _)| *m).collect::<Vec<usize>>());
        let lock = || self.similar.lock().unwrap_or_else(PoisonError::into_inner);
        let fits = |s: &&Similar| {
            is_close(&s.pose, x) && s.placed.iter().zip(placed).all(|(a, b)| is_close(&a.1, &b.1))
        };
        if let Some(known) = lock().get(&key).and_then(|known| known.iter().find(fits)) {
            return known.evidence;
        }
        let evidence = work_out();
        let new = Similar { pose: *x, placed: placed.to_vec(), evidence };
        lock().entry(key).or_default().push(new);
        evidence
    }
}

fn bits(t: &Se2) -> [u64; 3] {
    t.to_array().map(f64::to_bits)
}

/// The value of a key, worked out without holding the lock if it is not known.
fn remembered<K: Eq + Hash, V: Clone>(
    known: &Known<K, V>,
    key: K,
    work_out: impl FnOnce() -> V,
) -> V {
    // What another thread's panic left behind is whole: values are put in at once.
    let lock = || known.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(value) = lock().get(&key) {
        return value.clone();
    }
    let value = work_out();
    lock().insert(key, value.clone());
    value
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use crate::grid::OccupancyGrid;
    use crate::local_map::LocalMap;

    #[test]
    fn words_are_forgotten_unless_they_are_asked_for_again() {
        let grid = OccupancyGrid::new("g", 2, 2, 0.1, Se2::IDENTITY, vec![0; 4]).unwrap();
        let maps = vec![LocalMap::new(grid, &Config::default())];
        let merged = Overlay::default().with(&maps, 0, Se2::IDENTITY, 1.0, false);
        let layer = merged.layers().next().unwrap();
        let memory = Memory::default();
        let mut worked_out = 0;
        let mut ask = |k: usize| {
            let evidence = WallEvidence { log_likelihood: k as f64, ..WallEvidence::default() };
            let x = Se2::new(k as f64, 0.0, 0.0);
            let word = memory.word((layer, || merged.clone()), (1, &x), || {
                worked_out += 1;
                evidence
            });
            assert_eq!(word, evidence);
        };
        let n = 5 * MANY_WORDS;
        for k in 0..n {
            ask(k);
            // This one is needed all the time.
            ask(0);
        }
        ask(1);
        assert_eq!(worked_out, n + 1);
        let kept = |memory: &Memory| {
            let words = memory.words();
            words.new.len() + words.old.len()
        };
        assert!(kept(&memory) <= 2 * MANY_WORDS);
        memory.forget_words();
        assert_eq!(kept(&memory), 0);
    }
}
