//! How bent the maps at hand are, told by the pairs that fit best.
//!
//! Every pair is registered at several degrees of bending. Sharp maps stand clearest of chance when little
//! bending is allowed, hand-held ones when much is. Maps of one set come from like robots: one degree is chosen
//! for all, the finest that does nearly as well as any.

use crate::local_map::LocalMap;
use crate::registration::Registered;
use crate::verdict::NEGLIGIBLE;

/// How much clearer of chance, in square roots of nats, each further degree of bending must stand.
const WIDER: f64 = 0.6;

/// The degree of bending, by its index, at which the maps' best fits stand clearest of what chance reaches, which is
/// [`NEGLIGIBLE`] of their likelihood at least.
pub fn how_bent(found: &[Registered], maps: &[&LocalMap]) -> usize {
    let rungs = found.first().map_or(1, |f| f.rungs.len());
    let clearance = |k: usize| -> f64 {
        let mut of_map = vec![0.0f64; maps.len()];
        for f in found {
            let rung = &f.rungs[k];
            let Some(best) = rung.modes.first() else { continue };
            let chance = rung.chance(maps[f.b].center.unwrap_or_default());
            let most = best.evidence.log_likelihood.max(0.0);
            let clear = most.sqrt() - chance.max(NEGLIGIBLE * most).sqrt();
            for m in [f.a, f.b] {
                of_map[m] = of_map[m].max(clear - WIDER * k as f64);
            }
        }
        of_map.iter().sum()
    };
    let values: Vec<f64> = (0..rungs).map(clearance).collect();
    // The finest of equals.
    (0..rungs).fold(0, |best, k| if values[k] > values[best] { k } else { best })
}
