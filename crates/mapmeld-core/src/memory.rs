//! What the virtual robot has worked out on its way and need not work out again.
//!
//! Where a map may lie, and what its walls say there, changes only when a map is placed next to it. So both are
//! remembered by what they depend on: the placed maps nearby.

use crate::perception::{Layer, Overlay, WallEvidence};
use crate::se2::Se2;
use nalgebra::Matrix3;
use std::collections::HashMap;
use std::hash::Hash;
use std::sync::{Arc, Mutex, PoisonError};

/// Support, pose and covariance of a place where a map may lie.
pub type Motion = (f64, Se2, Matrix3<f64>);

/// Placed maps and the bits of their poses.
type Placed = Vec<(usize, [u64; 3])>;

/// A map, the bits of its pose, and the layers nearby, by where they are kept.
type Seen = (usize, [u64; 3], Vec<usize>);

/// A layer, by where it is kept, a map and the bits of its pose.
type Asked = (usize, usize, [u64; 3]);

type Known<K, V> = Mutex<HashMap<K, V>>;

/// See the module's text.
#[derive(Default)]
pub struct Memory {
    motions: Known<(usize, Placed), Arc<Vec<Motion>>>,
    looks: Known<Seen, Look>,
    similar: Known<(usize, Vec<usize>), Vec<Similar>>,
    words: Known<Asked, Word>,
}

/// What one layer says of a map.
#[derive(Clone)]
struct Word {
    evidence: WallEvidence,
    /// Keeps the layer where it is.
    _layer: Overlay,
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
        remembered(&self.words, key, || Word { evidence: work_out(), _layer: top() }).evidence
    }

    /// Forgets what single layers say: they are left behind where all is placed anew.
    pub fn forget_words(&self) {
        self.words.lock().unwrap_or_else(PoisonError::into_inner).clear();
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
