//! Which members' walls pull at each other.

use crate::config::Config;
use crate::local_map::LocalMap;
use crate::parallel;
use crate::perception::likelihood;
use crate::result::Known;
use crate::se2::Se2;
use crate::vicinity;

/// Samples of each map that tell whether two overlap.
const OVERLAP_SAMPLES: usize = 256;

/// Pairs of members whose walls agree at the given poses, and of those that nothing joins to the others the pairs whose
/// walls agree most: what put a bent map where it lies may not be seen once it is rigid.
pub fn overlapping(
    maps: &[LocalMap],
    members: &[usize],
    poses: &[Se2],
    known: &Known,
    config: &Config,
) -> Vec<(usize, usize)> {
    let near = vicinity::pairs(maps, members, poses).into_iter();
    let all: Vec<(usize, usize)> =
        near.filter(|(i, j)| !known.is_forbidden(members[*i], members[*j])).collect();
    let perception = config.perception.rigid();
    let evidence = parallel::map(&all, |(i, j)| {
        let (a, b) = (&maps[members[*i]], &maps[members[*j]]);
        let t_a_b = poses[*i].between(&poses[*j]);
        likelihood::pair(a, b, &t_a_b, OVERLAP_SAMPLES, &perception)
    });
    let likelihood = |k: &usize| evidence[*k].log_likelihood;
    let (mut kept, mut rest): (Vec<usize>, Vec<usize>) = (0..all.len())
        .filter(|k| evidence[*k].hits >= 2.0)
        .partition(|k| evidence[*k].log_likelihood > 0.0);
    let mut groups = Groups::new(members.len());
    kept.iter().for_each(|k| {
        groups.join(all[*k]);
    });
    if groups.count > 1 {
        // Where a map was told to lie, walls need not agree.
        rest.retain(|k| [all[*k].0, all[*k].1].iter().all(|m| !known.is_told(members[*m])));
        // The likeliest first; of equals the first.
        rest.sort_by(|x, y| likelihood(y).total_cmp(&likelihood(x)));
        kept.extend(rest.into_iter().filter(|k| groups.join(all[*k])));
        kept.sort_unstable();
    }
    kept.into_iter().map(|k| all[k]).collect()
}

/// Members that edges hold together (union-find).
struct Groups {
    parents: Vec<usize>,
    count: usize,
}

impl Groups {
    fn new(members: usize) -> Self {
        Self { parents: (0..members).collect(), count: members }
    }

    fn of(&mut self, mut member: usize) -> usize {
        while self.parents[member] != member {
            self.parents[member] = self.parents[self.parents[member]];
            member = self.parents[member];
        }
        member
    }

    /// Whether the two were apart before.
    fn join(&mut self, (i, j): (usize, usize)) -> bool {
        let (i, j) = (self.of(i), self.of(j));
        self.parents[j] = i;
        self.count -= usize::from(i != j);
        i != j
    }
}
