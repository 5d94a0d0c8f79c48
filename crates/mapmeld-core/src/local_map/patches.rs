//! The wall samples of a map in patches of a few metres, each of which may move a little of its own.

use super::WallSample;
use crate::blocks::{self, Block};
use crate::probe::Probe;
use crate::se2::Vec2;

/// Wall samples that lie close together.
#[derive(Debug, Clone)]
pub struct Patch {
    /// Indices of the samples.
    pub samples: Vec<u32>,
    /// The same samples as other maps are asked about them.
    pub blocks: Vec<Block>,
    /// Their mean position, metres.
    pub center: Vec2,
    /// How far the farthest lies from it, metres.
    pub radius: f64,
    /// The patches that it holds on to, with the distance between the centres, metres; at least one.
    pub neighbours: Vec<(u32, f64)>,
}

/// Fewest wall samples of a patch, where there are as many.
const PATCH_SAMPLES: usize = 40;
/// Extent below which a patch is not split, metres.
const PATCH_SIZE: f64 = 4.0;
/// Nearest patches that each patch holds on to; they hold on to it as well.
const NEIGHBOURS: usize = 4;

/// Some samples of a map, by their indices, in blocks.
pub(super) fn blocks_of(samples: &[u32], probes: &[Probe]) -> Vec<Block> {
    blocks::of(samples.iter().map(|k| &probes[*k as usize]))
}

/// Splits wall samples, which are the probes too, across their longer extent until patches are small.
pub(super) fn of(samples: &[WallSample], probes: &[Probe]) -> Vec<Patch> {
    let mut done = Vec::new();
    let at = |k: &u32| samples[*k as usize].position;
    let along =
        |axis: usize| move |x: &u32, y: &u32| at(x)[axis].total_cmp(&at(y)[axis]).then(x.cmp(y));
    // With the axis that they were split across last.
    let mut todo: Vec<(Option<usize>, Vec<u32>)> =
        vec![(None, (0..samples.len() as u32).collect())];
    while let Some((split, mut some)) = todo.pop() {
        let Some(first) = some.first().map(at) else { continue };
        let (low, high) =
            some.iter().fold((first, first), |(l, h), k| (l.inf(&at(k)), h.sup(&at(k))));
        let span = high - low;
        if some.len() < 2 * PATCH_SAMPLES || span.max() < PATCH_SIZE {
            // Every so manieth of them lies evenly over the patch.
            if let Some(axis) = split {
                some.sort_unstable_by(along(axis));
            }
            let sum = some.iter().map(at).fold(Vec2::zeros(), |a, b| a + b);
            let center = sum / some.len() as f64;
            let radius = some.iter().map(|k| (at(k) - center).norm()).fold(0.0, f64::max);
            let blocks = blocks_of(&some, probes);
            done.push(Patch { center, radius, samples: some, blocks, neighbours: Vec::new() });
            continue;
        }
        let axis = usize::from(span.y > span.x);
        let half = some.len() / 2;
        some.select_nth_unstable_by(half, along(axis));
        let half = some.split_off(half);
        todo.extend([(Some(axis), some), (Some(axis), half)]);
    }
    let centers: Vec<Vec2> = done.iter().map(|p: &Patch| p.center).collect();
    let mut edges = std::collections::BTreeSet::new();
    for k in 0..centers.len() {
        let others = (0..centers.len()).filter(|q| *q != k);
        let mut others: Vec<(f64, usize)> =
            others.map(|q| ((centers[q] - centers[k]).norm(), q)).collect();
        if others.len() > NEIGHBOURS {
            others
                .select_nth_unstable_by(NEIGHBOURS, |x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)));
            others.truncate(NEIGHBOURS);
        }
        edges.extend(others.into_iter().flat_map(|(_, q)| [(k, q), (q, k)]));
    }
    for (k, q) in edges {
        let far = (centers[q] - centers[k]).norm().max(1.0);
        done[k].neighbours.push((q as u32, far));
    }
    done
}
