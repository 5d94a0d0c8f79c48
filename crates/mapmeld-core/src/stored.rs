//! Registered pairs as bytes, for whoever keeps them longer than a process or works them out elsewhere.
//!
//! A registered pair depends on what its two maps show, on what hinted at it, on the options of the stages before the
//! filter and on the code. Its key is a digest of all of these, the same on every machine.

use crate::cache::Digest;
use crate::config::{Config, RegistrationConfig};
use crate::registration::{Registered, Rung};
use crate::se2::Se2;
use serde::{Deserialize, Serialize};

/// Changes when the bytes of the same pair do.
const FORMAT: u32 = 1;

/// Length of the digest before the values.
const CHECK: usize = 16;

/// Where registered pairs are kept by their keys. Several threads read and write at once.
pub trait Store: Send + Sync {
    /// The bytes of a key; none when nothing is kept under it.
    fn read(&self, key: &str) -> Option<Vec<u8>>;
    /// Keeps the bytes of a key; that they are lost is no error, as they can be worked out again.
    fn write(&self, key: &str, bytes: &[u8]);
    /// Hears that what was kept under a key cannot be read.
    fn unreadable(&self, key: &str);
}

/// What all keys of one configuration have in common.
pub fn root(config: &Config) -> [u8; 32] {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&FORMAT.to_le_bytes());
    hasher.update(concat!(env!("CARGO_PKG_VERSION"), " ", env!("MAPMELD_SOURCES")).as_bytes());
    // Which pairs are registered says nothing of any one of them.
    let registration = RegistrationConfig { partners: None, ..config.registration.clone() };
    // The verdict decides whether a pair's mirror image is tried.
    let e = &config.evidence;
    let verdict = (&e.weights, e.even_log_likelihood, e.temperature, e.least_followed);
    let stages = (&config.structure, &registration, &config.perception, verdict);
    hasher.update(&serde_json::to_vec(&stages).expect("options are numbers and names"));
    *hasher.finalize().as_bytes()
}

/// The key of a pair: 64 hexadecimal digits.
pub fn key(root: &[u8; 32], (a, b): (Digest, Digest), hints: &[Se2]) -> String {
    let mut hasher = blake3::Hasher::new_keyed(root);
    for word in [a.0, a.1, b.0, b.1] {
        hasher.update(&word.to_le_bytes());
    }
    for number in hints.iter().flat_map(|t| t.to_array()) {
        hasher.update(&number.to_bits().to_le_bytes());
    }
    hasher.finalize().to_hex().to_string()
}

#[derive(Serialize, Deserialize)]
struct Written {
    candidates: usize,
    rungs: Vec<Rung>,
}

/// A registered pair as bytes, which tell when they are damaged.
pub fn encode(found: &Registered) -> Vec<u8> {
    let written = Written { candidates: found.candidates, rungs: found.rungs.clone() };
    let values = postcard::to_stdvec(&written).expect("numbers and lists of them");
    let mut bytes = blake3::hash(&values).as_bytes()[..CHECK].to_vec();
    bytes.extend(values);
    bytes
}

/// The pair of maps `a` and `b` from bytes; none when they are damaged or of another format.
pub fn decode(bytes: &[u8], (a, b): (usize, usize)) -> Option<Registered> {
    let (check, values) = bytes.split_at_checked(CHECK)?;
    if blake3::hash(values).as_bytes()[..CHECK] != *check {
        return None;
    }
    let Written { candidates, rungs } = postcard::from_bytes(values).ok()?;
    Some(Registered { a, b, candidates, rungs })
}
