//! What the parts of a merge cost, each alone, on maps of one synthetic floor plan.
//!
//! `cargo bench -p mapmeld-core` runs all, `cargo bench -p mapmeld-core -- psi` those with "psi" in their name.
//! One thread, unless a name says otherwise.

use criterion::{criterion_group, criterion_main, BatchSize, Criterion};
use mapmeld_core::boundary;
use mapmeld_core::config::{Config, PerceptionModel, PsiClasses};
use mapmeld_core::distance::DistanceTable;
use mapmeld_core::filter::ParticleFilter;
use mapmeld_core::fuse;
use mapmeld_core::grid::{Class, OccupancyGrid, UNKNOWN};
use mapmeld_core::local_map::LocalMap;
use mapmeld_core::pair_table::PairTable;
use mapmeld_core::parallel;
use mapmeld_core::perception::psi::Comparison;
use mapmeld_core::perception::{gamma, likelihood, placed, psi, Overlay};
use mapmeld_core::refine;
use mapmeld_core::registration::{
    corners as corner_source, correlation, pair, rotations, segments,
};
use mapmeld_core::result::Known;
use mapmeld_core::se2::{Se2, Vec2};
use mapmeld_core::structure::{corners, lines};
use mapmeld_core::verdict;
use mapmeld_core::virtual_robot::VirtualRobot;
use std::hint::black_box;
use std::time::Duration;

/// Cells of a side of the plan, and their size in metres.
const CELLS: usize = 400;
const RESOLUTION: f64 = 0.05;
/// Half the thickness of walls, metres.
const HALF: f64 = 0.06;
/// Walls of the plan as (x, y) to (x, y), metres: four wings of rooms around a hall, none like another.
const WALLS: [[f64; 4]; 26] = [
    [0.5, 0.5, 19.5, 0.5],
    [19.5, 0.5, 19.5, 19.5],
    [19.5, 19.5, 0.5, 19.5],
    [0.5, 19.5, 0.5, 0.5],
    [0.5, 6.0, 3.1, 6.0],
    [4.1, 6.0, 8.2, 6.0],
    [9.4, 6.0, 13.0, 6.0],
    [14.1, 6.0, 19.5, 6.0],
    [5.6, 0.5, 5.6, 6.0],
    [11.0, 0.5, 11.0, 6.0],
    [16.2, 2.4, 16.2, 6.0],
    [0.5, 12.4, 2.2, 12.4],
    [3.4, 12.4, 6.6, 12.4],
    [6.6, 8.0, 6.6, 15.1],
    [6.6, 16.2, 6.6, 19.5],
    [12.9, 8.3, 12.9, 13.2],
    [12.9, 14.4, 12.9, 19.5],
    [12.9, 11.0, 15.4, 11.0],
    [16.5, 11.0, 19.5, 11.0],
    [14.9, 14.2, 19.5, 14.2],
    [8.7, 10.1, 10.9, 11.6],
    [1.8, 2.0, 3.4, 2.0],
    [3.4, 2.0, 3.4, 3.3],
    [8.0, 2.9, 9.5, 2.9],
    [2.0, 16.0, 4.4, 17.3],
    [9.0, 16.8, 10.8, 16.8],
];
/// Where robots stood, and how far they saw, metres: neighbours share a good part.
const ROBOTS: [[f64; 3]; 5] =
    [[5.0, 5.0, 7.0], [10.0, 6.0, 7.0], [14.5, 9.0, 7.0], [11.0, 14.0, 7.0], [6.0, 11.0, 7.0]];

/// What stands at a point of the plan.
fn plan(p: Vec2) -> i8 {
    let in_wall = |[ax, ay, bx, by]: &[f64; 4]| {
        let (a, b) = (Vec2::new(*ax, *ay), Vec2::new(*bx, *by));
        let d = b - a;
        let nearest = a + d * ((p - a).dot(&d) / d.norm_squared()).clamp(0.0, 1.0);
        (p - nearest).norm() <= HALF
    };
    let inside = |v: f64| (0.5..=19.5).contains(&v);
    if WALLS.iter().any(in_wall) {
        100
    } else if inside(p.x) && inside(p.y) {
        0
    } else {
        UNKNOWN
    }
}

/// A map of 400 x 400 cells of what lies within a distance of a place, in a frame turned about its middle.
fn draw(t_plan_map: &Se2, seen: impl Fn(Vec2) -> bool) -> OccupancyGrid {
    let side = CELLS as f64 * RESOLUTION;
    let cells = (0..CELLS * CELLS)
        .map(|k| {
            let (col, row) = ((k % CELLS) as f64 + 0.5, (k / CELLS) as f64 + 0.5);
            let at = Vec2::new(col * RESOLUTION - 0.5 * side, row * RESOLUTION - 0.5 * side);
            let p = t_plan_map.apply(at);
            if seen(p) {
                plan(p)
            } else {
                UNKNOWN
            }
        })
        .collect();
    let origin = Se2::new(-0.5 * side, -0.5 * side, 0.0);
    OccupancyGrid::new("plan", CELLS, CELLS, RESOLUTION, origin, cells).expect("a valid map")
}

/// `T_plan_map` of robot k's map.
fn frame(k: usize) -> Se2 {
    let [x, y, _] = ROBOTS[k];
    Se2::new(x, y, 0.9 * k as f64 + 0.2)
}

fn robots() -> Vec<OccupancyGrid> {
    let near = |k: usize| {
        let [x, y, range] = ROBOTS[k];
        move |p: Vec2| (p - Vec2::new(x, y)).norm() <= range
    };
    (0..ROBOTS.len()).map(|k| draw(&frame(k), near(k))).collect()
}

fn prepare(c: &mut Criterion) {
    let config = Config::default();
    let grid = draw(&Se2::new(10.0, 10.0, 0.3), |_| true);
    c.bench_function("distance transform, 400 x 400 cells", |b| {
        b.iter(|| DistanceTable::to_class(black_box(&grid), Class::Occupied))
    });
    c.bench_function("boundary", |b| b.iter(|| boundary::extract(black_box(&grid))));
    let (walls, index) = boundary::extract(&grid);
    c.bench_function("lines", |b| {
        b.iter(|| lines::fit(&grid, black_box((&walls, &index)), &config.structure))
    });
    let fitted = lines::fit(&grid, (&walls, &index), &config.structure);
    c.bench_function("corners", |b| {
        b.iter(|| corners::find(&grid, black_box(&fitted), &config.structure))
    });
    c.bench_function("prepare a map (LocalMap::new)", |b| {
        b.iter_batched(|| grid.clone(), |g| LocalMap::new(g, &config), BatchSize::LargeInput)
    });
}

fn register(c: &mut Criterion) {
    let config = Config::default();
    let maps: Vec<LocalMap> = robots().into_iter().map(|g| LocalMap::new(g, &config)).collect();
    let (a, b) = (&maps[0], &maps[1]);
    let r = &config.registration;
    c.bench_function("candidates by corners", |t| {
        t.iter(|| corner_source::candidates(black_box(&a.corners), &b.corners, r))
    });
    c.bench_function("candidates by segments", |t| {
        t.iter(|| segments::candidates(black_box(&a.lines), &b.lines))
    });
    c.bench_function("candidates by correlation", |t| {
        t.iter(|| {
            let effort = correlation::THOROUGH;
            let proposed =
                rotations::Proposed::new(&black_box(a).turns, &b.turns, effort.promising);
            correlation::candidates(a, b, &proposed.promising(), effort)
        })
    });
    let t_a_b = frame(0).between(&frame(1));
    let p = &config.perception;
    c.bench_function("wall evidence of a rigid pair at a pose", |t| {
        t.iter(|| likelihood::pair(a, b, black_box(&t_a_b), usize::MAX, p))
    });
    c.bench_function("wall evidence of a pair unbent at a pose", |t| {
        t.iter(|| placed::pair(a, b, black_box(&t_a_b), p))
    });
    let mirrored = b.mirrored();
    c.bench_function("register a pair", |t| {
        t.iter(|| pair::register(a, b, None, &[], (0, 1), black_box(&config)))
    });
    c.bench_function("register a pair and its decoy", |t| {
        t.iter(|| pair::register(a, b, Some(&mirrored), &[], (0, 1), black_box(&config)))
    });
}

fn travel(c: &mut Criterion) {
    let config = Config::default();
    let maps: Vec<LocalMap> = robots().into_iter().map(|g| LocalMap::new(g, &config)).collect();
    let n = maps.len();
    let mut pairs = Vec::new();
    for a in 0..n {
        for b in a + 1..n {
            let mirrored = maps[b].mirrored();
            let found = pair::register(&maps[a], &maps[b], Some(&mirrored), &[], (a, b), &config);
            pairs.push(verdict::of_pair(found, 0, [&maps[a], &maps[b]], &config));
        }
    }
    let pairs = PairTable::new(n, pairs);
    // The true world, but for the last map, which is to be weighed.
    let last = n - 1;
    let pose = |k: usize| frame(0).between(&frame(k));
    let mut merged = Overlay::default();
    for k in 0..last {
        merged = merged.with(&maps, k, pose(k), 1.0, true);
    }
    let t_world_map = pose(last);
    let p = &config.perception;
    c.bench_function("wall evidence of a pose against 4 maps", |b| {
        b.iter(|| placed::against(&maps, &merged, last, black_box(&t_world_map), p))
    });
    for (name, classes) in [("occupied", PsiClasses::Occupied), ("all", PsiClasses::All)] {
        c.bench_function(&format!("psi ({name}) and gamma of a pose against 4 maps"), |b| {
            b.iter(|| {
                let at = black_box(t_world_map);
                let compared = Comparison::new(&maps, &merged, &maps[last], at, p.sigma_cells);
                psi::psi(&compared, classes) + gamma::gamma(&compared)
            })
        });
    }
    c.bench_function("fold a map into 4", |b| {
        b.iter(|| merged.with(&maps, last, black_box(t_world_map), 1.0, false))
    });
    for (name, model) in
        [("walls", PerceptionModel::OrientedWalls), ("psi gamma", PerceptionModel::PsiGamma)]
    {
        let mut config = config.clone();
        let known = Known::default();
        config.perception.model = model;
        let robot = VirtualRobot {
            maps: &maps,
            pairs: &pairs,
            open: vec![true; n],
            order: None,
            rung: 0,
            known: &known,
            parts: None,
            memory: Default::default(),
            config: &config,
        };
        let start = ParticleFilter::new(robot.start(0), 100, config.filter.resample_below, 1);
        let mut third = start.clone();
        let moved: Vec<usize> = (0..2).map(|_| third.step(&robot).advanced).collect();
        assert_eq!(moved, [100, 100], "the maps of the bench must connect");
        for (step, filter) in [("first", &start), ("third", &third)] {
            let name = format!("{step} filter step, 100 particles, {name}");
            c.bench_function(&name, |b| {
                b.iter_batched(
                    || filter.clone(),
                    |mut f| {
                        let step = || f.step(&robot);
                        parallel::with_threads(Some(1), step).expect("a thread")
                    },
                    BatchSize::SmallInput,
                )
            });
        }
    }
    let all: Vec<usize> = (0..n).collect();
    let rough: Vec<Se2> =
        all.iter().map(|k| pose(*k).compose(&Se2::new(0.03, -0.02, 0.004))).collect();
    c.bench_function("refine 5 maps", |b| {
        b.iter(|| {
            refine::refine(&maps, &all, black_box(&rough), &[0], &pairs, &Known::default(), &config)
        })
    });
    let placed: Vec<(&OccupancyGrid, Se2)> =
        all.iter().map(|k| (&maps[*k].grid, pose(*k))).collect();
    c.bench_function("fuse 5 maps", |b| {
        b.iter(|| fuse::fuse("merged", black_box(&placed), &config.fuse))
    });
}

criterion_group! {
    name = kernels;
    config = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(200))
        .measurement_time(Duration::from_millis(600))
        .without_plots();
    targets = prepare, register, travel
}
criterion_main!(kernels);
