//! Clusters that join: the robot travels among merged maps as it does among maps.

use crate::cache::{self, Cache, Lent, Noted};
use crate::cluster::Cluster;
use crate::config::Config;
use crate::error::Result;
use crate::events::Listener;
use crate::local_map::LocalMap;
use crate::memory::Memory;
use crate::merge::{judged, travel};
use crate::pair_table::PairTable;
use crate::parallel;
use crate::partners;
use crate::prior::Prior;
use crate::relation;
use crate::result::{Known, Observer, Stage};
use crate::virtual_robot::{Parts, VirtualRobot};
use std::collections::{BTreeSet, HashMap};

/// One travel with the clusters as maps; none when no two of them join.
pub(crate) fn join(
    lent: &Lent,
    cache: &mut Cache,
    pairs: &PairTable,
    clusters: &[Cluster],
    (known, rung): (&Known, usize),
    config: &Config,
    (observer, listener): (Observer, Listener),
) -> Result<Option<Vec<Cluster>>> {
    // Single maps alone tell nothing that their pairs have not told.
    if clusters.len() < 2 || clusters.iter().all(|c| c.members.len() == 1) {
        return Ok(None);
    }
    let maps = lent.maps.as_slice();
    let Some(merged) = as_maps(lent, cache, clusters, config, observer)? else {
        return Ok(None);
    };
    let relations = relation::of_clusters(clusters, &known.relations);
    let hints = |a: usize, b: usize| {
        let told = relations.iter().filter_map(|r| r.between(a, b)?.t_a_b());
        told.chain(clusters[a].motions(&clusters[b], pairs)).collect()
    };
    let mut wanted = worth_joining(clusters, pairs, config);
    wanted.extend(relations.iter().map(|r| (r.a.min(r.b), r.a.max(r.b))));
    wanted.sort_unstable();
    wanted.dedup();
    let found = cache.register(&merged, &wanted, hints, config, observer);
    let joined = found.and_then(|(found, _)| {
        let of_clusters = judged(found, 0, &merged.maps, config);
        let (tables, heard) = ((pairs, &of_clusters), (observer, listener));
        travel_among(maps, &merged.maps, tables, clusters, (known, rung), config, heard)
    });
    cache.give_back(merged);
    joined
}

/// Pairs of clusters that are worth registering: all of a few; of many, those of whose members some pair was
/// registered.
fn worth_joining(clusters: &[Cluster], pairs: &PairTable, config: &Config) -> Vec<(usize, usize)> {
    let n = clusters.len();
    let all = (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b)));
    if partners::are_all(n, config) {
        return all.collect();
    }
    let mut cluster_of = HashMap::new();
    for (k, c) in clusters.iter().enumerate() {
        cluster_of.extend(c.members.iter().map(|m| (*m, k)));
    }
    let across = cluster_of.iter().flat_map(|(m, a)| {
        let others = pairs.partners(*m).filter_map(|other| cluster_of.get(&other));
        others.map(move |b| (*a.min(b), *a.max(b)))
    });
    let found: BTreeSet<(usize, usize)> = across.filter(|(a, b)| a != b).collect();
    found.into_iter().collect()
}

/// The clusters as maps of their own; none when one of them is too large to draw, as pins far apart make it.
fn as_maps(
    lent: &Lent,
    cache: &mut Cache,
    clusters: &[Cluster],
    config: &Config,
    observer: Observer,
) -> Result<Option<Lent>> {
    let several: Vec<&Cluster> = clusters.iter().filter(|c| c.members.len() > 1).collect();
    let grids = parallel::map(&several, |c| c.fused(&lent.maps, config));
    let Ok(grids) = grids.into_iter().collect::<Result<Vec<_>>>() else {
        return Ok(None);
    };
    let grids: Vec<Noted> = grids.iter().map(|g| (g, cache::digest(g))).collect();
    let fused = cache.take(&grids, Stage::Join, config, observer)?;
    let mut fused = fused.maps.into_iter().zip(fused.digests);
    let of_cluster = |c: &Cluster| match c.members[..] {
        [only] => (lent.maps[only].clone(), lent.digests[only]),
        _ => fused.next().expect("one for each cluster of several maps"),
    };
    let (maps, digests) = clusters.iter().map(of_cluster).unzip();
    Ok(Some(Lent { maps, digests }))
}

/// One travel with the clusters as maps, their pairs judged; none when no two of them join.
fn travel_among(
    maps: &[LocalMap],
    merged: &[LocalMap],
    (of_maps, pairs): (&PairTable, &PairTable),
    clusters: &[Cluster],
    (known, rung): (&Known, usize),
    config: &Config,
    (observer, listener): (Observer, Listener),
) -> Result<Option<Vec<Cluster>>> {
    let first = known.order.as_ref().and_then(|o| o.first().copied());
    let first = first.and_then(|r| clusters.iter().position(|c| c.members.contains(&r)));
    // What members know of their poses tells where their cluster lies.
    let of_cluster = |c: &Cluster| Prior::of_frame(&c.with_priors(&known.priors));
    let priors: Vec<Option<Prior>> = clusters.iter().map(of_cluster).collect();
    let relations = relation::of_clusters(clusters, &known.relations);
    let order = first.map(|c| vec![c]);
    let of_clusters = Known { order, priors, relations, ..Known::default() };
    let overlays = parallel::map(clusters, |c| c.overlay(maps));
    let bridging = Config { evidence: config.evidence.of_bridges(maps.len()), ..config.clone() };
    let robot = VirtualRobot {
        maps: merged,
        pairs,
        open: vec![true; merged.len()],
        order: None,
        config: &bridging,
        rung,
        known: &of_clusters,
        parts: Some(Parts { maps, overlays: &overlays, known, pairs: of_maps }),
        memory: Memory::default(),
    };
    let travelled = travel(robot, &of_clusters, observer, (listener, Some(clusters)))?;
    // Each travel that takes in no other cluster leaves all as it was.
    if travelled.len() == clusters.len() {
        return Ok(None);
    }
    let joined: Vec<Cluster> = travelled
        .into_iter()
        .flat_map(|(worlds, steps)| {
            Cluster::join(maps, of_maps, clusters, (&worlds, steps), known, config)
        })
        .collect();
    let sizes = |c: &[Cluster]| c.iter().map(|c| c.members.len()).collect::<Vec<usize>>();
    Ok(is_progress(&sizes(clusters), &sizes(&joined)).then_some(joined))
}

/// Whether clusters of such sizes have joined. What is split off again has not; where strays were split off from
/// what joined, there may be as many clusters as before, and larger ones. Either can go on for so long only.
fn is_progress(before: &[usize], after: &[usize]) -> bool {
    let squares = |sizes: &[usize]| sizes.iter().map(|n| n * n).sum::<usize>();
    after.len() < before.len() || (after.len() == before.len() && squares(after) > squares(before))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_join_counts_though_a_stray_was_split_off() {
        assert!(is_progress(&[2, 2, 3], &[4, 3]));
        // Two pairs joined, and a map of the third cluster lies alone.
        assert!(is_progress(&[2, 2, 3], &[4, 2, 1]));
        // The same again, by whatever members, is none, nor is falling apart.
        assert!(!is_progress(&[2, 2, 3], &[3, 2, 2]));
        assert!(!is_progress(&[4, 2, 1], &[3, 2, 2]));
        assert!(!is_progress(&[3, 3], &[4, 1, 1]));
    }
}
