//! The most that walls can say for a pose, however maps are bent: what refuses hopeless poses at a glance.
//!
//! Every wall that has one of like orientation within reach is taken for a hit, however far that lies, and a wall
//! speaks against the pose only where it lies so deep in clear free space that it is a full conflict. Bending may take
//! some of these out of there: the softer maps are, the less such a wall says. An estimate, from few of the samples.

use crate::blocks::{self, Block, LANES};
use crate::config::PerceptionConfig;
use crate::ground::Ground;
use crate::likelihood_field::ProbeView;
use crate::perception::placed::Placed;
use crate::vicinity::Outline;

/// Wall samples of a map that are asked, about.
const ASKED: usize = 256;
/// Drift, metres per square root of metre, up to which bending excuses next to nothing.
const STIFF: f64 = 0.06;

/// The most that two groups of placed maps may say of each other, nats, about.
pub fn between(a: &[Placed], b: &[Placed], config: &PerceptionConfig) -> f64 {
    let with_outlines = |placed: &[Placed]| placed.iter().map(Placed::outline).collect::<Vec<_>>();
    let (outlines_a, outlines_b) = (with_outlines(a), with_outlines(b));
    let of = |from: &[Placed], own: &[Outline], others: &[Placed], theirs: &[Outline]| -> f64 {
        let said = from.iter().zip(own).map(|(p, outline)| {
            let near = others.iter().zip(theirs).filter(|(_, o)| o.is_near(outline, 0.0));
            one_way(p, &near.map(|(o, _)| o).collect::<Vec<_>>(), config)
        });
        said.sum()
    };
    0.5 * (of(a, &outlines_a, b, &outlines_b) + of(b, &outlines_b, a, &outlines_a))
}

/// The same from the walls of one map alone, taking it that the others say as much: for less, and less if this one shows
/// what the others do not.
pub fn of(from: &Placed, others: &[Placed], config: &PerceptionConfig) -> f64 {
    let outline = from.outline();
    let near = others.iter().filter(|o| o.outline().is_near(&outline, 0.0));
    one_way(from, &near.collect::<Vec<_>>(), config)
}

/// The most that the samples of one map may say of others.
fn one_way(from: &Placed, others: &[&Placed], config: &PerceptionConfig) -> f64 {
    if others.is_empty() {
        return 0.0;
    }
    let views = others.iter().map(|o| (&o.map.ground, o.map.probe_view(from.axes_in(o))));
    let views: Vec<_> = views.collect();
    let some: Vec<Block>;
    let (asked, share) = match from.samples {
        None => (from.map.blocks.first(ASKED), from.map.blocks.share(ASKED)),
        Some(samples) => {
            let step = samples.len().div_ceil(ASKED).max(1);
            let probes = samples.iter().step_by(step).map(|k| &from.map.probes[*k as usize]);
            some = blocks::of(probes);
            (some.as_slice(), step as f64)
        }
    };
    share * most(asked, &views, config)
}

/// The most that some samples may say of others.
#[multiversion::multiversion(targets("x86_64+avx2"))]
fn most(asked: &[Block], others: &[(&Ground, ProbeView)], config: &PerceptionConfig) -> f64 {
    let firmness = (STIFF / config.bend_shift).min(1.0);
    let excuses = [config.conflict, config.straight_conflict].map(|c| c * firmness);
    let mut sum = 0.0;
    for block in asked {
        let (mut hits, mut conflicts) = ([0.0; LANES], [0.0; LANES]);
        for (ground, view) in others {
            let seen = view.see(block);
            let walls = view.walls(&seen, 0);
            for k in 0..LANES {
                let is_full = ground.conflict(seen.cell[k] as usize) >= 1.0;
                let is_there = walls.is_there(k);
                hits[k] += f64::from(u8::from(is_there));
                conflicts[k] += f64::from(u8::from(!is_there && is_full));
            }
        }
        for k in (0..LANES).filter(|k| hits[*k] + conflicts[*k] > 0.0) {
            let excuse = excuses[usize::from(block.straight[k])];
            let against = conflicts[k] * f64::from(block.conflict_weight[k]) * excuse;
            let agreed = hits[k] * config.hit * f64::from(block.weight[k]);
            sum += (agreed + against) / (hits[k] + conflicts[k]);
        }
    }
    sum
}
