//! The threads' pools: kept, given back whatever happens, never shared by two that work at once.

use mapmeld_core::parallel::with_threads;
use std::collections::BTreeSet;
use std::panic::{catch_unwind, AssertUnwindSafe};
use std::sync::Barrier;
use std::thread::{self, ThreadId};

/// A number of threads that nothing else in this process asks for.
const THREADS: usize = 3;

/// The threads that a pool has.
fn threads_of_pool() -> BTreeSet<String> {
    let name = |_: rayon::BroadcastContext<'_>| format!("{:?}", thread::current().id());
    with_threads(Some(THREADS), || rayon::broadcast(name)).unwrap().into_iter().collect()
}

fn here() -> ThreadId {
    thread::current().id()
}

/// One test, so that no other takes the pools meanwhile.
#[test]
fn pools_last_and_are_nobody_else_s_while_they_work() {
    let first = threads_of_pool();
    assert_eq!(first.len(), THREADS);
    for _ in 0..20 {
        assert_eq!(threads_of_pool(), first);
    }

    // A panic is the caller's; the pool is there for the next one.
    let failed = catch_unwind(AssertUnwindSafe(|| {
        with_threads(Some(THREADS), || panic!("on purpose")).unwrap()
    }));
    assert!(failed.is_err());
    assert_eq!(threads_of_pool(), first);

    // Two at once that wait for each other: in one pool of one thread neither would end.
    let barrier = Barrier::new(2);
    let both = || {
        with_threads(Some(1), || {
            barrier.wait();
            here()
        })
    };
    let (a, b) = thread::scope(|s| {
        let other = s.spawn(both);
        (both().unwrap(), other.join().unwrap().unwrap())
    });
    assert_ne!(a, b);
    assert!([a, b].contains(&with_threads(Some(1), here).unwrap()));
}
