//! The main loop: local maps in, placed maps and one merged map out, in the paper's order.

use crate::cache::Cache;
use crate::canonical::Canonical;
use crate::cluster::Cluster;
use crate::config::Config;
use crate::error::{Error, Result};
use crate::evidence::{self, World};
use crate::filter::{ParticleFilter, Step};
use crate::fuse;
use crate::grid::OccupancyGrid;
use crate::local_map::LocalMap;
use crate::parallel;
use crate::perception::noise;
use crate::registration::Registered;
use crate::result::{Component, Known, Merge, Observer, Stage};
use crate::verdict;
use crate::virtual_robot::{PairTable, Parts, VirtualRobot};
use std::time::Instant;

/// Merges maps (VR-SLAM). The result depends on the maps, the configuration and what is known, not on
/// the order in which the maps are given nor on the number of threads.
pub fn merge(
    grids: Vec<OccupancyGrid>,
    known: &Known,
    config: &Config,
    observer: Observer,
) -> Result<Merge> {
    config.validate()?;
    let grids: Vec<&OccupancyGrid> = grids.iter().collect();
    merge_with(&mut Cache::passing(), &grids, known, config, observer)
}

/// A merge that takes what it can from a cache, of the same configuration, and leaves there what it works out.
pub(crate) fn merge_with(
    cache: &mut Cache,
    grids: &[&OccupancyGrid],
    known: &Known,
    config: &Config,
    observer: Observer,
) -> Result<Merge> {
    check_known(known, grids.len())?;
    let canonical = Canonical::of(grids);
    let (grids, known) = (canonical.arranged(grids), canonical.known(known));
    let found = parallel::with_threads(config.threads, || {
        let mut clock = Clock::new();
        // Section 5: data points, lines, corners.
        let maps = cache.take(&grids, Stage::Prepare, config, observer)?;
        clock.lap("prepare");
        let found = run(&maps, cache, &known, config, (observer, clock));
        cache.give_back(maps);
        found
    })?;
    Ok(canonical.restored(found?))
}

fn run(
    maps: &[LocalMap],
    cache: &mut Cache,
    known: &Known,
    config: &Config,
    (observer, mut clock): (Observer, Clock),
) -> Result<Merge> {
    // Section 3: the possible motions u_t of every pair, once for all particles. How bent the maps are is
    // learnt from the pairs that fit best.
    let (found, registered_pairs) = cache.register(maps, |_, _| Vec::new(), config, observer)?;
    let rung = noise::how_bent(&found, &maps.iter().collect::<Vec<_>>());
    let pairs = judged(found, rung, maps, config);
    let perception = config.perception.rungs().swap_remove(rung);
    let config = &Config { perception, ..config.clone() };
    clock.lap("register");

    // Sections 2 and 4: the virtual robot travels through each component.
    let robot = VirtualRobot {
        maps,
        pairs: &pairs,
        open: maps.iter().map(|m| !m.is_blank()).collect(),
        order: known.order.as_deref(),
        config,
        rung,
        parts: None,
    };
    let mut clusters: Vec<Cluster> = travel(robot, known, observer)?
        .into_iter()
        .flat_map(|(worlds, steps)| Cluster::of_travel(maps, worlds, steps, config))
        .collect();
    clock.lap("filter");

    // Past the paper: merged maps are maps, so the robot travels among them until nothing joins.
    while let Some(joined) = join(maps, cache, &pairs, &clusters, (known, rung), config, observer)?
    {
        clusters = joined;
    }
    clusters.sort_by_key(|c| std::cmp::Reverse(c.members.len()));
    tell_all(&mut clusters);
    // A named reference lends its frame; where the robot starts is for the evidence to say.
    if let Some(r) = known.reference {
        clusters.iter_mut().filter(|c| c.members.contains(&r)).for_each(|c| {
            c.rebase(r, maps, config);
        });
    }
    clock.lap("join");

    let mut components = Vec::new();
    for (k, c) in clusters.iter().enumerate() {
        observe(observer, Stage::Fuse, k, clusters.len())?;
        components.push(Component {
            reference: c.reference,
            order: c.members.clone(),
            steps: c.steps.clone(),
            rms: c.rms,
            fused: fuse::fuse("merged", &c.placed(maps), &config.fuse)?,
        });
    }
    let placements = evidence::placements(maps, &clusters);
    let hypotheses = evidence::hypotheses(&clusters);
    let probability = clusters.iter().map(|c| c.worlds[0].certainty()).product();
    clock.lap("fuse");
    let (pairs, seconds) = (pairs.into_pairs(), clock.laps);
    Ok(Merge { placements, components, probability, hypotheses, pairs, registered_pairs, seconds })
}

/// The verdicts on all pairs.
fn judged(found: Vec<Registered>, rung: usize, maps: &[LocalMap], config: &Config) -> PairTable {
    let judge = |f: Registered| {
        let two = [&maps[f.a], &maps[f.b]];
        verdict::of_pair(f, rung, two, &config.evidence)
    };
    PairTable::new(maps.len(), found.into_iter().map(judge).collect())
}

/// Lets the virtual robot travel from a reference as far as the evidence carries, then from another
/// one through the maps that are left. One list of worlds, most probable first, for each travel.
fn travel(
    mut robot: VirtualRobot,
    known: &Known,
    observer: Observer,
) -> Result<Vec<(Vec<World>, Vec<Step>)>> {
    let mut travelled = Vec::new();
    while let Some(start) = choose_start(robot.pairs, &robot.open, known) {
        let f = &robot.config.filter;
        let seed = robot.config.seed.wrapping_add(travelled.len() as u64);
        let mut filter =
            ParticleFilter::new(robot.start(start), f.particles, f.resample_below, seed);
        let mut steps = Vec::new();
        loop {
            let visited = robot.open.iter().filter(|o| !**o).count() + steps.len();
            observe(observer, Stage::Filter, visited, robot.open.len())?;
            let step = filter.step(&robot);
            if step.advanced == 0 {
                break;
            }
            steps.push(step);
        }
        let worlds = evidence::worlds(robot.maps, filter.particles());
        worlds[0].poses.iter().for_each(|(m, _)| robot.open[*m] = false);
        travelled.push((worlds, steps));
    }
    Ok(travelled)
}

/// Clusters whose story went with one that has joined another tell their own.
fn tell_all(clusters: &mut [Cluster]) {
    let told: Vec<usize> = clusters
        .iter()
        .flat_map(|c| &c.stories)
        .flat_map(|w| w.poses.iter().map(|(m, _)| *m))
        .collect();
    for c in clusters.iter_mut().filter(|c| c.members.iter().any(|m| !told.contains(m))) {
        c.stories = c.worlds.clone();
    }
}

/// One travel with the clusters as maps; none when no two of them join.
fn join(
    maps: &[LocalMap],
    cache: &mut Cache,
    pairs: &PairTable,
    clusters: &[Cluster],
    (known, rung): (&Known, usize),
    config: &Config,
    observer: Observer,
) -> Result<Option<Vec<Cluster>>> {
    // Single maps alone tell nothing that their pairs have not told.
    if clusters.len() < 2 || clusters.iter().all(|c| c.members.len() == 1) {
        return Ok(None);
    }
    let merged = as_maps(maps, cache, clusters, config, observer)?;
    let hints = |a: usize, b: usize| clusters[a].motions(&clusters[b], pairs);
    let found = cache.register(&merged, hints, config, observer);
    let joined = found.and_then(|(found, _)| {
        let pairs = judged(found, 0, &merged, config);
        travel_among(maps, &merged, &pairs, clusters, (known, rung), config, observer)
    });
    cache.give_back(merged);
    joined
}

/// The clusters as maps of their own.
fn as_maps(
    maps: &[LocalMap],
    cache: &mut Cache,
    clusters: &[Cluster],
    config: &Config,
    observer: Observer,
) -> Result<Vec<LocalMap>> {
    let several: Vec<&Cluster> = clusters.iter().filter(|c| c.members.len() > 1).collect();
    let grids = parallel::map(&several, |c| c.fused(maps, config));
    let grids = grids.into_iter().collect::<Result<Vec<_>>>()?;
    let grids: Vec<&OccupancyGrid> = grids.iter().collect();
    let mut fused = cache.take(&grids, Stage::Join, config, observer)?.into_iter();
    let of_cluster = |c: &Cluster| match c.members[..] {
        [only] => maps[only].clone(),
        _ => fused.next().expect("one for each cluster of several maps"),
    };
    Ok(clusters.iter().map(of_cluster).collect())
}

/// One travel with the clusters as maps, their pairs judged; none when no two of them join.
fn travel_among(
    maps: &[LocalMap],
    merged: &[LocalMap],
    pairs: &PairTable,
    clusters: &[Cluster],
    (known, rung): (&Known, usize),
    config: &Config,
    observer: Observer,
) -> Result<Option<Vec<Cluster>>> {
    let first = known.order.as_ref().and_then(|o| o.first().copied());
    let first = first.and_then(|r| clusters.iter().position(|c| c.members.contains(&r)));
    let known = Known { order: first.map(|c| vec![c]), reference: None };
    let overlays = parallel::map(clusters, |c| c.overlay(maps));
    let robot = VirtualRobot {
        maps: merged,
        pairs,
        open: vec![true; merged.len()],
        order: None,
        config,
        rung,
        parts: Some(Parts { maps, overlays: &overlays }),
    };
    let travelled = travel(robot, &known, observer)?;
    if travelled.len() == clusters.len() {
        return Ok(None);
    }
    let joined: Vec<Cluster> = travelled
        .into_iter()
        .flat_map(|(worlds, steps)| Cluster::join(maps, clusters, &worlds, steps, config))
        .collect();
    // What is split off again has not joined.
    Ok((joined.len() < clusters.len()).then_some(joined))
}

/// Where the robot starts through the next component: at the first map of the known order, or at the one with
/// the most evidence in common with other open maps. None when no map is open.
fn choose_start(pairs: &PairTable, open: &[bool], known: &Known) -> Option<usize> {
    let is_open = |m: &usize| open[*m];
    let first = known.order.as_ref().and_then(|o| o.iter().copied().find(is_open));
    let connected = |a: usize| -> f64 {
        (0..open.len())
            .filter(|b| open[*b] && *b != a)
            .filter_map(|b| pairs.best(a, b))
            .map(|l| l.max(0.0))
            .sum()
    };
    let strongest = || {
        (0..open.len())
            .filter(is_open)
            .map(|a| (a, connected(a)))
            // The first of equals, so that the answer does not hang on the sort.
            .reduce(|x, y| if y.1 > x.1 { y } else { x })
            .map(|(a, _)| a)
    };
    first.or_else(strongest)
}

fn check_known(known: &Known, n: usize) -> Result<()> {
    let fail = |key: &str, problem: String| Err(Error::Config { key: key.into(), problem });
    if let Some(r) = known.reference.filter(|r| *r >= n) {
        return fail("reference", format!("index {r} of {n} maps"));
    }
    if let Some(order) = &known.order {
        let mut seen = vec![false; n];
        for m in order {
            if *m >= n {
                return fail("order", format!("index {m} of {n} maps"));
            }
            if std::mem::replace(&mut seen[*m], true) {
                return fail("order", format!("names map {m} twice"));
            }
        }
        if let (Some(reference), Some(first)) = (known.reference, order.first()) {
            if reference != *first {
                return fail("order", "must begin with the reference map".into());
            }
        }
    }
    Ok(())
}

fn observe(observer: Observer, stage: Stage, done: usize, total: usize) -> Result<()> {
    if observer(stage, done, total) {
        Ok(())
    } else {
        Err(Error::Interrupted)
    }
}

struct Clock {
    last: Instant,
    laps: Vec<(&'static str, f64)>,
}

impl Clock {
    fn new() -> Self {
        Self { last: Instant::now(), laps: Vec::new() }
    }
    fn lap(&mut self, name: &'static str) {
        self.laps.push((name, self.last.elapsed().as_secs_f64()));
        self.last = Instant::now();
    }
}
