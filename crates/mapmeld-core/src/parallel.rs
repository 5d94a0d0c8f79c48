//! Threads, in one place. Results come back in the order of the items, whatever the threads did.

use crate::error::{Error, Result};
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::Mutex;

/// Pools that nobody uses now, with the process that made them and their number of threads.
///
/// Threads that come and go with every estimate leave each its own part of the heap behind: a program that
/// merges for hours grows. Two that work at once never share a pool, so that neither waits for the other.
static IDLE: Mutex<Vec<(u32, usize, ThreadPool)>> = Mutex::new(Vec::new());

/// Runs `f` on a pool of so many threads (none: all cores). Its threads wait for the next one afterwards.
pub fn with_threads<R: Send>(threads: Option<usize>, f: impl FnOnce() -> R + Send) -> Result<R> {
    let pool = Lent::of(threads.unwrap_or(0))?;
    Ok(pool.run(f))
}

/// A pool in use; it is given back also when the work panics.
struct Lent {
    threads: usize,
    pool: Option<ThreadPool>,
}

impl Lent {
    fn of(threads: usize) -> Result<Self> {
        if let Some(pool) = idle(threads) {
            return Ok(Self { threads, pool: Some(pool) });
        }
        let pool = ThreadPoolBuilder::new().num_threads(threads).build().map_err(|e| {
            Error::Config { key: "threads".into(), problem: format!("cannot start threads: {e}") }
        })?;
        Ok(Self { threads, pool: Some(pool) })
    }

    fn run<R: Send>(&self, f: impl FnOnce() -> R + Send) -> R {
        self.pool.as_ref().expect("a pool until it is given back").install(f)
    }
}

impl Drop for Lent {
    fn drop(&mut self) {
        if let Ok(mut idle) = IDLE.try_lock() {
            idle.extend(self.pool.take().map(|pool| (std::process::id(), self.threads, pool)));
        }
    }
}

/// An idle pool of this process. A process that was forked has its parent's list but not its threads: those
/// pools stay where they are. The list is never waited for, as it may have been locked at the fork.
fn idle(threads: usize) -> Option<ThreadPool> {
    let mut idle = IDLE.try_lock().ok()?;
    let here = std::process::id();
    let found = idle.iter().position(|(pid, n, _)| (*pid, *n) == (here, threads))?;
    Some(idle.swap_remove(found).2)
}

/// `f` of every item, in the items' order.
pub fn map<T: Sync, R: Send>(items: &[T], f: impl Fn(&T) -> R + Sync + Send) -> Vec<R> {
    items.par_iter().map(f).collect()
}
