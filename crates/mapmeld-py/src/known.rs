//! What is known beside the maps, told by their names.

use crate::convert;
use mapmeld_core::error::Error;
use mapmeld_core::prior::Prior;
use mapmeld_core::relation::Relation;
use mapmeld_core::result::Known;
use mapmeld_core::se2::Vec2;

/// A map, its T_world_map, and standard deviations; none where it is pinned.
pub type GivenPrior = (String, [f64; 3], Option<[f64; 3]>);

/// Maps a and b, a point of each that is the same, the standard deviation of their distance, and the heading of b in
/// a with its own, if it is known.
pub type GivenRelation = (String, String, [f64; 2], [f64; 2], f64, Option<(f64, f64)>);

/// The core's form of it; `index` finds a map by its name.
pub fn known(
    maps: usize,
    index: impl Fn(&str) -> Result<usize, Error>,
    priors: &[GivenPrior],
    relations: &[GivenRelation],
    forbidden: &[(String, String)],
) -> Result<Known, Error> {
    let mut known = Known::default();
    if !priors.is_empty() {
        known.priors = vec![None; maps];
    }
    for (name, t_world_map, sigma) in priors {
        let t_world_map = convert::pose(*t_world_map);
        known.priors[index(name)?] = Some(match sigma {
            Some(sigma) => Prior::new(t_world_map, *sigma),
            None => Prior::pinned(t_world_map),
        });
    }
    for (a, b, in_a, in_b, sigma, heading) in relations {
        let (in_a, in_b) = (Vec2::from(*in_a), Vec2::from(*in_b));
        let (a, b) = (index(a)?, index(b)?);
        known.relations.push(Relation { a, b, in_a, in_b, sigma: *sigma, heading: *heading });
    }
    for (a, b) in forbidden {
        known.forbidden.push((index(a)?, index(b)?));
    }
    Ok(known)
}
