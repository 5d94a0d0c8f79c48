//! A real robot with odometry and a laser: a second instance of the filter that merges maps.
//!
//! Grid mapping with a Rao-Blackwellized particle filter (Grisetti, Stachniss, Burgard, "Improved
//! techniques for grid mapping with Rao-Blackwellized particle filters", 2007). The particle's map
//! is a grid that it draws itself (grid.rs), its modes are the places that scan matching finds around
//! the odometry's guess (robot.rs); the drive is simulated (world.rs).
//!
//!     cargo run --release --example laser_slam

mod grid;
mod robot;
mod world;

use mapmeld_core::filter::{ParticleFilter, Step};
use mapmeld_core::se2::Se2;
use robot::{Robot, State};

/// What a step left behind.
pub struct Row {
    /// Metres between the true place and where the wheels alone put the robot.
    pub dead_reckoning: f64,
    /// Metres between the true place and where the heaviest particle is.
    pub error: f64,
    /// How the filter fared.
    pub step: Step,
}

/// A whole run.
pub struct Run {
    /// One a step.
    pub rows: Vec<Row>,
    /// Metres between the true path and that of the heaviest particle at the end, root mean square.
    pub path_error: f64,
    /// Mean distance of the map's walls from the true ones, metres.
    pub wall_error: f64,
    /// Share of the particles' tiles that are held by more than one of them.
    pub shared_tiles: f64,
}

/// Simulates a drive and runs the filter on its readings.
pub fn run(steps: usize, particles: usize, seed: u64) -> Run {
    let drive = world::drive(steps, seed);
    let start = State::start(drive.truth[0], &drive.scans[0]);
    let mut filter = ParticleFilter::new(start, particles, 0.5, seed);
    let mut wheels = drive.truth[0];
    let mut rows = Vec::new();
    for (k, odometry) in drive.odometry.iter().enumerate() {
        let step = filter.step(&Robot { odometry, scan: &drive.scans[k + 1] });
        wheels = wheels.compose(odometry);
        let off = |pose: &Se2| (pose.translation() - drive.truth[k + 1].translation()).norm();
        let error = off(&heaviest(&filter).pose);
        rows.push(Row { dead_reckoning: off(&wheels), error, step });
    }
    let best = heaviest(&filter);
    let path = best.path();
    let squares: f64 = path
        .iter()
        .zip(&drive.truth)
        .map(|(a, b)| (a.translation() - b.translation()).norm_squared())
        .sum();
    let ends = best.grid.walls();
    let wall_error = ends.iter().map(|p| world::distance_to_wall(*p)).sum::<f64>();
    Run {
        rows,
        path_error: (squares / path.len() as f64).sqrt(),
        wall_error: wall_error / ends.len() as f64,
        shared_tiles: grid::shared_tiles(filter.particles().iter().map(|p| &p.state.grid)),
    }
}

fn heaviest(filter: &ParticleFilter<State>) -> &State {
    let best = filter.particles().iter().max_by(|a, b| a.log_weight.0.total_cmp(&b.log_weight.0));
    &best.expect("a filter has particles").state
}

#[allow(dead_code)] // The test that runs this example calls `run` itself.
fn main() {
    let particles = 30;
    println!("two rounds of a hall, {particles} particles");
    println!("step   dead reckoning [m]   filter [m]    N_eff   resampled");
    let run = run(140, particles, 1);
    let mut resampled = 0;
    for (k, row) in run.rows.iter().enumerate() {
        resampled += usize::from(row.step.resampled);
        if (k + 1) % 14 == 0 {
            let (wheels, filter, n_eff) =
                (row.dead_reckoning, row.error, row.step.effective_sample_size);
            println!("{:4} {wheels:20.2} {filter:12.2} {n_eff:8.1} {resampled:11}", k + 1);
        }
    }
    println!("path: {:.3} m root mean square", run.path_error);
    println!("walls: {:.3} m on the average", run.wall_error);
    println!("tiles of the maps that particles share: {:.0} %", 100.0 * run.shared_tiles);
}
