//! The main loop: local maps in, placed maps and one merged map out, in the paper's order.

use crate::cache::{self, Cache, Lent, Noted};
use crate::canonical::Canonical;
use crate::cluster::Cluster;
use crate::config::Config;
use crate::error::{Error, Result};
use crate::events::{Event, Listener};
use crate::evidence::{self, World};
use crate::filter::{ParticleFilter, Step, Told};
use crate::fuse;
use crate::grid::OccupancyGrid;
use crate::joining;
use crate::local_map::LocalMap;
use crate::memory::Memory;
use crate::pair_table::PairTable;
use crate::parallel;
use crate::partners;
use crate::perception::noise;
use crate::prior;
use crate::registration::{stretch, Registered};
use crate::relation;
use crate::result::{Component, Known, Merge, Observer, Stage};
use crate::se2::Se2;
use crate::stored::Store;
use crate::verdict;
use crate::virtual_robot::VirtualRobot;
use std::sync::Arc;
use std::time::Instant;

/// Merges maps (VR-SLAM). The result depends on the maps, the configuration and what is known, not on
/// the order in which the maps are given nor on the number of threads.
pub fn merge(
    grids: Vec<OccupancyGrid>,
    known: &Known,
    config: &Config,
    observer: Observer,
) -> Result<Merge> {
    merge_told(grids, known, config, None, (observer, None))
}

/// A merge whose events are told to a listener. Pairs that a store keeps are taken from there, and those that it
/// lacks are left there.
pub fn merge_told(
    grids: Vec<OccupancyGrid>,
    known: &Known,
    config: &Config,
    store: Option<Arc<dyn Store>>,
    (observer, listener): (Observer, Listener),
) -> Result<Merge> {
    config.validate()?;
    let grids: Vec<Noted> = grids.iter().map(|g| (g, cache::digest(g))).collect();
    let mut cache = Cache::passing().with_store(store);
    let found = merge_with(&mut cache, &grids, known, config, (observer, listener))?;
    // Whoever merges once wants the merged map.
    match found.components.iter().find_map(|c| c.fused.as_ref().err()) {
        Some(problem) => Err(problem.clone()),
        None => Ok(found),
    }
}

/// A merge that takes what it can from a cache, of the same configuration, and leaves there what it works out.
pub(crate) fn merge_with(
    cache: &mut Cache,
    grids: &[Noted],
    known: &Known,
    config: &Config,
    (observer, listener): (Observer, Listener),
) -> Result<Merge> {
    check_known(known, grids.len())?;
    let canonical = Canonical::of(grids.iter().map(|(g, _)| *g));
    let (grids, known) = (canonical.arranged(grids), canonical.known(known));
    let restored = listener.map(|tell| |event: Event| tell(event.restored(&canonical)));
    let listener: Listener = restored.as_ref().map(|tell| tell as &(dyn Fn(Event) + Sync));
    let found = parallel::with_threads(config.threads, || {
        let mut clock = Clock::new();
        // Section 5: data points, lines, corners.
        let lent = cache.take(&grids, Stage::Prepare, config, observer)?;
        clock.lap("prepare");
        tell(listener, || Event::prepared(&lent.maps));
        let found = run(&lent, cache, &known, config, (observer, listener, clock));
        cache.give_back(lent);
        found
    })?;
    Ok(canonical.restored(found?))
}

fn run(
    lent: &Lent,
    cache: &mut Cache,
    known: &Known,
    config: &Config,
    (observer, listener, mut clock): (Observer, Listener, Clock),
) -> Result<Merge> {
    // Section 3: the possible motions u_t of every pair, once for all particles. How bent the maps are is
    // learnt from the pairs that fit best.
    let Found { pairs, rung, config, fresh: registered_pairs } =
        registered(lent, cache, known, config, observer)?;
    let (config, maps) = (&config, lent.maps.as_slice());
    clock.lap("register");
    tell(listener, || Event::registered(&pairs));

    // Sections 2 and 4: the virtual robot travels through each component.
    let robot = VirtualRobot {
        maps,
        pairs: &pairs,
        open: maps.iter().map(|m| !m.is_blank()).collect(),
        order: known.order.as_deref(),
        config,
        rung,
        known,
        parts: None,
        memory: Memory::default(),
    };
    let mut clusters: Vec<Cluster> = travel(robot, known, observer, (listener, None))?
        .into_iter()
        .flat_map(|travelled| Cluster::of_travel(maps, &pairs, travelled, known, config))
        .collect();
    clock.lap("filter");
    tell(listener, || Event::refined(&clusters));

    // Past the paper: merged maps are maps, so the robot travels among them until nothing joins.
    while let Some(joined) =
        joining::join(lent, cache, &pairs, &clusters, (known, rung), config, (observer, listener))?
    {
        clusters = joined;
        tell(listener, || Event::refined(&clusters));
    }
    if !known.relations.is_empty() {
        clusters = relation::tied(clusters, known);
    }
    if known.priors.iter().any(Option::is_some) {
        clusters = prior::united(clusters, &known.priors);
    }
    clusters.sort_by_key(|c| std::cmp::Reverse(c.members.len()));
    tell_all(&mut clusters);
    // A named reference lends its frame; where the robot starts is for the evidence to say.
    for c in clusters.iter_mut().filter(|c| !c.in_world) {
        if let Some(r) = known.references.iter().find(|r| c.members.contains(r)) {
            c.rebase(*r, maps, known, config);
        }
    }
    clock.lap("join");

    let mut components = Vec::new();
    for (k, c) in clusters.iter().enumerate() {
        observe(observer, Stage::Fuse, k, clusters.len())?;
        components.push(Component {
            reference: c.reference,
            in_world: c.in_world,
            order: c.members.clone(),
            steps: c.steps.clone(),
            rms: c.rms,
            fused: fuse::fuse("merged", &c.placed(maps), &config.fuse),
        });
    }
    let placements = evidence::placements(maps, &clusters);
    let hypotheses = evidence::hypotheses(&clusters);
    let probability = clusters.iter().map(|c| c.worlds[0].certainty()).product();
    clock.lap("fuse");
    let mut pairs = pairs.into_pairs();
    stretch::tell(&mut pairs, maps, &config.perception);
    clock.lap("size");
    let seconds = clock.laps;
    Ok(Merge { placements, components, probability, hypotheses, pairs, registered_pairs, seconds })
}

/// What the pairs of some maps say.
pub(crate) struct Found {
    /// With their verdicts.
    pub pairs: PairTable,
    /// How bent the maps are.
    pub rung: usize,
    /// Options, with the perception model that fits them.
    pub config: Config,
    /// How many of the pairs had to be registered.
    pub fresh: usize,
}

/// Registers the pairs that are worth it and weighs them as bent as they are.
pub(crate) fn registered(
    lent: &Lent,
    cache: &mut Cache,
    known: &Known,
    config: &Config,
    observer: Observer,
) -> Result<Found> {
    let maps = lent.maps.as_slice();
    let config = &Config { evidence: config.evidence.among(maps.len()), ..config.clone() };
    let wanted = partners::pairs(maps, known, config);
    let (found, fresh) = cache.register(lent, &wanted, hints(known), config, observer)?;
    let (forbidden, told): (Vec<_>, Vec<_>) =
        found.into_iter().partition(|f| known.is_forbidden(f.a, f.b));
    let rung = noise::how_bent(&told, &maps.iter().collect::<Vec<_>>());
    let mut pairs = judged(told.into_iter().chain(forbidden).collect(), rung, maps, config);
    pairs.forbid(|a, b| known.is_forbidden(a, b));
    let perception = config.perception.rungs().swap_remove(rung);
    Ok(Found { pairs, rung, config: Config { perception, ..config.clone() }, fresh })
}

/// The verdicts on pairs.
pub(crate) fn judged(
    found: Vec<Registered>,
    rung: usize,
    maps: &[LocalMap],
    config: &Config,
) -> PairTable {
    let judge = |f: Registered| {
        let two = [&maps[f.a], &maps[f.b]];
        verdict::of_pair(f, rung, two, config)
    };
    PairTable::new(maps.len(), found.into_iter().map(judge).collect())
}

/// Lets the virtual robot travel from a reference as far as the evidence carries, then from another
/// one through the maps that are left. One list of worlds, most probable first, for each travel. `clusters`, for the
/// listener: what the robot's maps are merged of, if they are merged maps.
pub(crate) fn travel(
    mut robot: VirtualRobot,
    known: &Known,
    observer: Observer,
    (listener, clusters): (Listener, Option<&[Cluster]>),
) -> Result<Vec<(Vec<World>, Vec<Step>)>> {
    let mut travelled = Vec::new();
    while let Some(start) = choose_start(&robot, known) {
        let f = &robot.config.filter;
        let seed = robot.config.seed.wrapping_add(travelled.len() as u64);
        let mut filter =
            ParticleFilter::new(robot.start(start), f.particles, f.resample_below, seed);
        let told = |told: &Told<VirtualRobot>, step: &Step| {
            // A step that leads nowhere is the end of the travel, and none of it.
            if step.advanced > 0 {
                tell(listener, || Event::stepped(&robot, (told, step), travelled.len(), clusters));
            }
        };
        let (mut steps, mut is_settled) = (Vec::new(), robot.parts.is_some());
        loop {
            let visited = robot.open.iter().filter(|o| !**o).count() + steps.len();
            observe(observer, Stage::Filter, visited, robot.open.len())?;
            let step = filter.step_told(&robot, listener.is_some().then_some(&told));
            if step.advanced > 0 {
                steps.push(step);
                is_settled = robot.parts.is_some();
            } else if is_settled || steps.is_empty() || robot.is_everywhere(filter.particles()) {
                break;
            } else {
                // The noise of draws must not have the last word on the maps that are left.
                filter.settle(&robot);
                is_settled = true;
            }
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

/// Where the robot starts through the next component: at a pinned map, at the first map of the known order, or at
/// the one with the most evidence in common with other open maps. None when no map is open.
fn choose_start(robot: &VirtualRobot, known: &Known) -> Option<usize> {
    let (pairs, open) = (robot.pairs, &robot.open);
    let is_open = |m: &usize| open[*m];
    let pinned =
        (0..open.len()).filter(is_open).find(|m| robot.prior(*m).is_some_and(|p| p.is_pinned));
    let first = known.order.as_ref().and_then(|o| o.iter().copied().find(is_open));
    let connected = |a: usize| -> f64 {
        pairs
            .partners(a)
            .filter(|b| open[*b])
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
    pinned.or(first).or_else(strongest)
}

/// Where priors and relations say that two maps lie to each other.
pub(crate) fn hints(known: &Known) -> impl Fn(usize, usize) -> Vec<Se2> + Sync + Send + '_ {
    let prior = |m: usize| known.priors.get(m).and_then(Option::as_ref);
    move |a, b| {
        let both = prior(a).zip(prior(b));
        let of_priors = both.map(|(a, b)| a.t_world_map.between(&b.t_world_map));
        let of_relations = known.relations.iter().filter_map(|r| r.between(a, b)?.t_a_b());
        of_priors.into_iter().chain(of_relations).collect()
    }
}

pub(crate) fn check_known(known: &Known, n: usize) -> Result<()> {
    let fail = |key: &str, problem: String| Err(Error::Config { key: key.into(), problem });
    if let Some(r) = known.references.iter().find(|r| **r >= n) {
        return fail("reference", format!("index {r} of {n} maps"));
    }
    if !known.priors.is_empty() && known.priors.len() != n {
        return fail("priors", format!("{} of them for {n} maps", known.priors.len()));
    }
    relation::check(known, n)?;
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
        if let (Some(reference), Some(first)) = (known.references.first(), order.first()) {
            if reference != first {
                return fail("order", "must begin with the reference map".into());
            }
        }
    }
    Ok(())
}

/// Makes an event where somebody listens.
fn tell(listener: Listener, event: impl FnOnce() -> Event) {
    if let Some(tell) = listener {
        tell(event());
    }
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
