//! An order of maps that depends on what they show alone, so that the answer does not depend on how they were
//! given.

use crate::grid::OccupancyGrid;
use crate::registration::{pair, PairModes};
use crate::relation::Relation;
use crate::result::{Known, Merge};

/// What a map shows, without its name.
pub fn key(grid: &OccupancyGrid) -> (usize, usize, [u64; 4], &[i8]) {
    let numbers = [grid.resolution(), grid.origin().x, grid.origin().y, grid.origin().theta];
    (grid.height(), grid.width(), numbers.map(f64::to_bits), grid.cells())
}

/// Which map comes where: `order[k]` is the given index of the k-th.
#[derive(Debug, Clone)]
pub struct Canonical {
    order: Vec<usize>,
    place: Vec<usize>,
}

impl Canonical {
    /// Sorts by size, resolution, origin and cells. Names do not count.
    pub fn of<'g>(grids: impl Iterator<Item = &'g OccupancyGrid>) -> Self {
        let grids: Vec<&OccupancyGrid> = grids.collect();
        let key = |k: usize| key(grids[k]);
        let mut order: Vec<usize> = (0..grids.len()).collect();
        order.sort_by(|a, b| key(*a).cmp(&key(*b)));
        let mut place = vec![0; order.len()];
        order.iter().enumerate().for_each(|(k, given)| place[*given] = k);
        Self { order, place }
    }

    /// The place in this order of a given index.
    pub fn place(&self, given: usize) -> usize {
        self.place[given]
    }

    /// The given index of a place in this order.
    pub fn given(&self, place: usize) -> usize {
        self.order[place]
    }

    /// The maps in this order.
    pub fn arranged<T: Copy>(&self, maps: &[T]) -> Vec<T> {
        self.order.iter().map(|k| maps[*k]).collect()
    }

    /// What is known, told of the maps in this order.
    pub fn known(&self, known: &Known) -> Known {
        Known {
            order: known.order.as_ref().map(|o| o.iter().map(|m| self.place[*m]).collect()),
            references: known.references.iter().map(|m| self.place[*m]).collect(),
            priors: match known.priors[..] {
                [] => Vec::new(),
                _ => self.order.iter().map(|m| known.priors[*m].clone()).collect(),
            },
            relations: known
                .relations
                .iter()
                .map(|r| Relation { a: self.place[r.a], b: self.place[r.b], ..r.clone() })
                .collect(),
            forbidden: known
                .forbidden
                .iter()
                .map(|(a, b)| (self.place[*a], self.place[*b]))
                .collect(),
        }
    }

    /// A result of maps in this order, told of the maps as given.
    pub fn restored(&self, merge: Merge) -> Merge {
        let given = |m: usize| self.order[m];
        Merge {
            placements: self.place.iter().map(|k| merge.placements[*k].clone()).collect(),
            components: merge
                .components
                .into_iter()
                .map(|mut c| {
                    c.reference = given(c.reference);
                    c.order.iter_mut().for_each(|m| *m = given(*m));
                    c
                })
                .collect(),
            hypotheses: merge
                .hypotheses
                .into_iter()
                .map(|mut h| {
                    h.maps.iter_mut().for_each(|(m, _, _)| *m = given(*m));
                    h
                })
                .collect(),
            probability: merge.probability,
            pairs: self.pairs(merge.pairs),
            registered_pairs: merge.registered_pairs,
            seconds: merge.seconds,
        }
    }

    /// Pairs of maps in this order, told of the maps as given.
    pub fn pairs(&self, pairs: Vec<PairModes>) -> Vec<PairModes> {
        let mut pairs: Vec<PairModes> = pairs.into_iter().map(|p| self.pair(p)).collect();
        pairs.sort_by_key(|p| (p.a, p.b));
        pairs
    }

    /// A pair, its first map the one that was given first.
    fn pair(&self, mut p: PairModes) -> PairModes {
        (p.a, p.b) = (self.order[p.a], self.order[p.b]);
        if p.a > p.b {
            (p.a, p.b) = (p.b, p.a);
            for m in &mut p.found.modes {
                (m.t_a_b, m.covariance) = pair::inverse(m);
            }
            p.stretch = p.stretch.map(|s| s.inverse());
        }
        p
    }
}
