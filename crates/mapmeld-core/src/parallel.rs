//! Threads, in one place. Results come back in the order of the items, whatever the threads did.

use crate::error::{Error, Result};
use rayon::prelude::*;

/// Runs `f` on a pool of so many threads (none: all cores).
pub fn with_threads<R: Send>(threads: Option<usize>, f: impl FnOnce() -> R + Send) -> Result<R> {
    let pool =
        rayon::ThreadPoolBuilder::new().num_threads(threads.unwrap_or(0)).build().map_err(|e| {
            Error::Config { key: "threads".into(), problem: format!("cannot start threads: {e}") }
        })?;
    Ok(pool.install(f))
}

/// `f` of every item, in the items' order.
pub fn map<T: Sync, R: Send>(items: &[T], f: impl Fn(&T) -> R + Sync + Send) -> Vec<R> {
    items.par_iter().map(f).collect()
}
