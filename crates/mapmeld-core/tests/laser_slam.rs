//! The filter's second instance, the example `laser_slam`, on a small problem.

#[path = "../examples/laser_slam/main.rs"]
mod laser_slam;

/// A round and a bit, so that the robot comes back to where its map began.
#[test]
fn the_filter_maps_where_the_wheels_alone_get_lost() {
    for seed in [1, 2] {
        let run = laser_slam::run(77, 12, seed);
        let last = run.rows.last().unwrap();
        assert!(last.dead_reckoning > 0.8, "wheels too good: {:.2} m", last.dead_reckoning);
        assert!(last.error < 0.15, "seed {seed}: {:.2} m off at the end", last.error);
        assert!(run.path_error < 0.2, "seed {seed}: path {:.2} m off", run.path_error);
        assert!(run.wall_error < 0.15, "seed {seed}: walls {:.2} m off", run.wall_error);
        assert!(run.rows.iter().all(|r| r.step.advanced == 12));
        let resampled = run.rows.iter().filter(|r| r.step.resampled).count();
        assert!((1..77).contains(&resampled), "resampled {resampled} times");
        assert!(run.shared_tiles > 0.3, "maps are copied, not shared: {:.2}", run.shared_tiles);
    }
}

#[test]
fn a_run_is_reproducible_with_any_number_of_threads() {
    let bits = |threads| {
        let run = || laser_slam::run(12, 6, 3);
        let run = mapmeld_core::parallel::with_threads(Some(threads), run).unwrap();
        run.rows
            .iter()
            .map(|r| (r.error.to_bits(), r.step.log_evidence.to_bits()))
            .collect::<Vec<_>>()
    };
    assert_eq!(bits(1), bits(2));
}
