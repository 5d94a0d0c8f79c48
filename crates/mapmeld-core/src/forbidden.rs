//! Pairs whose match is known to be wrong: which walls are no evidence then, and where no map may lie.

use crate::local_map::LocalMap;
use crate::pair_table::PairTable;
use crate::perception::placed::Placed;
use crate::perception::Overlay;
use crate::result::Known;
use crate::se2::Se2;

/// A map's index, and the map at its place.
pub(crate) type Member<'m> = (usize, Placed<'m>);

/// The maps that a merged map is made of, in a frame given by `t_frame_merged`.
pub(crate) fn members<'m>(
    merged: &'m Overlay,
    maps: &'m [LocalMap],
    t_frame_merged: &Se2,
) -> Vec<Member<'m>> {
    merged.layers().map(|l| l.map).zip(merged.placed(maps, t_frame_merged)).collect()
}

/// Those of two groups of maps whose walls are evidence of how the groups lie to each other: without the maps that a
/// forbidden pair has in one of them, in that which loses the smaller share.
pub(crate) fn evidence<'m>(
    a: Vec<Member<'m>>,
    b: Vec<Member<'m>>,
    known: &Known,
) -> (Vec<Placed<'m>>, Vec<Placed<'m>>) {
    let without = |these: &[Member<'m>], those: &[Member<'m>]| {
        let is_free = |m: usize| !those.iter().any(|(o, _)| known.is_forbidden(m, *o));
        let kept = these.iter().filter(|(m, _)| is_free(*m));
        kept.map(|(_, p)| *p).collect::<Vec<_>>()
    };
    let (few_a, few_b) = (without(&a, &b), without(&b, &a));
    let all = |these: Vec<Member<'m>>| these.into_iter().map(|(_, p)| p).collect();
    if few_a.len() * b.len() >= few_b.len() * a.len() {
        (few_a, all(b))
    } else {
        (all(a), few_b)
    }
}

/// Whether two groups in one frame have a forbidden pair across where its walls match best.
pub(crate) fn is_refused(
    a: &[(usize, Se2)],
    b: &[(usize, Se2)],
    pairs: &PairTable,
    maps: &[LocalMap],
) -> bool {
    a.iter().any(|(i, x_i)| {
        b.iter().any(|(j, x_j)| {
            let center = maps[*j].center.unwrap_or_default();
            pairs.is_refused(*i, *j, &x_i.between(x_j), center)
        })
    })
}
