//! Probes in blocks, asked all at once.
//!
//! A look-up in the tables of a large map waits for memory. Asked one after the other, with a branch in between, each
//! probe has a wait of its own; the probes of a block wait together, and what is worked out of their answers the
//! compiler does for several at a time.

use crate::probe::Probe;

/// Probes of a block.
pub const LANES: usize = 16;
/// Where lanes lie that hold no probe, metres: on no grid.
const NOWHERE: f32 = 1e12;

/// Some probes of a map, in its grid's axes. Lanes that hold none lie nowhere and weigh nothing.
#[derive(Debug, Clone)]
pub struct Block {
    /// Metres from the corner of cell (0, 0).
    pub x: [f32; LANES],
    /// The same.
    pub y: [f32; LANES],
    /// See [`Probe::weight`].
    pub weight: [f32; LANES],
    /// See [`Probe::conflict_weight`].
    pub conflict_weight: [f32; LANES],
    /// See [`Probe::direction`].
    pub direction: [u16; LANES],
    /// See [`Probe::straight`].
    pub straight: [bool; LANES],
}

impl Block {
    fn empty() -> Self {
        Self {
            x: [NOWHERE; LANES],
            y: [NOWHERE; LANES],
            weight: [0.0; LANES],
            conflict_weight: [0.0; LANES],
            direction: [0; LANES],
            straight: [false; LANES],
        }
    }

    fn set(&mut self, lane: usize, p: &Probe) {
        (self.x[lane], self.y[lane]) = (p.x, p.y);
        (self.weight[lane], self.conflict_weight[lane]) = (p.weight, p.conflict_weight);
        (self.direction[lane], self.straight[lane]) = (p.direction, p.straight);
    }
}

/// Probes in blocks, in their order; the last one may hold fewer.
pub fn of<'p>(probes: impl IntoIterator<Item = &'p Probe>) -> Vec<Block> {
    let mut blocks: Vec<Block> = Vec::new();
    for (k, p) in probes.into_iter().enumerate() {
        if k % LANES == 0 {
            blocks.push(Block::empty());
        }
        blocks[k / LANES].set(k % LANES, p);
    }
    blocks
}

/// All probes of a map, in rounds: each asks as many as all before it, in between those, so that whatever power of two
/// of the first is asked, they lie evenly all over the map.
#[derive(Debug, Clone)]
pub struct Blocks {
    blocks: Vec<Block>,
    probes: usize,
}

impl Blocks {
    /// Within a round, probes stay in their order, which is that of their cells in memory.
    pub fn new(probes: &[Probe]) -> Self {
        let n = probes.len();
        let places = 1usize << n.max(1).ilog2();
        let at = |place: usize| place * n / places;
        let mut order: Vec<usize> = Vec::with_capacity(n);
        let mut step = (places / LANES).max(1);
        order.extend((0..places).step_by(step).map(at));
        while step > 1 {
            order.extend((step / 2..places).step_by(step).map(at));
            step /= 2;
        }
        let mut is_asked = vec![false; n];
        order.retain(|k| *k < n);
        order.iter().for_each(|k| is_asked[*k] = true);
        order.extend((0..n).filter(|k| !is_asked[*k]));
        Self { blocks: of(order.into_iter().map(|k| &probes[k])), probes: n }
    }

    /// Number of probes.
    pub fn probes(&self) -> usize {
        self.probes
    }

    /// The largest power of two of the probes that is no more than so many, or all of them; one block at least.
    pub fn first(&self, samples: usize) -> &[Block] {
        &self.blocks[..self.asked(samples).div_ceil(LANES)]
    }

    /// How many probes each of so many of the first stands for.
    pub fn share(&self, samples: usize) -> f64 {
        self.probes as f64 / self.asked(samples).max(1) as f64
    }

    /// The blocks from one on up to another, as far as there are.
    pub fn range(&self, from: usize, until: usize) -> &[Block] {
        let until = until.min(self.blocks.len());
        &self.blocks[from.min(until)..until]
    }

    fn asked(&self, samples: usize) -> usize {
        if samples >= self.probes {
            self.probes
        } else {
            (1 << samples.max(LANES).ilog2()).min(self.probes)
        }
    }
}

/// The whole part of a number that is not negative and less than eight million; one less than a whole number may come
/// out for that, and anything for other numbers.
#[inline(always)]
pub fn whole(v: f32) -> i32 {
    // The sum leaves no bits for the fraction. A conversion would ask of each number whether it fits.
    const NO_FRACTION: f32 = (1 << 23) as f32;
    let below = v - 0.5;
    let below = if below > 0.0 { below } else { 0.0 };
    ((below + NO_FRACTION).to_bits() & 0x7f_ffff) as i32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_parts_are_those_of_numbers() {
        for k in 0..1000 {
            for v in [k as f32 + 0.001, k as f32 + 0.5, k as f32 + 0.999, 1000.0 * k as f32 + 0.4] {
                assert_eq!(whole(v), v as i32, "{v}");
            }
            assert!([k, k - 1].contains(&whole(k as f32)) && whole(k as f32) >= 0);
            let most = f32::from_bits((k as f32 + 1.0).to_bits() - 1);
            assert_eq!(whole(most), k);
        }
    }

    fn probes(n: usize) -> Vec<Probe> {
        let probe = |k: usize| Probe {
            x: k as f32,
            y: 0.0,
            nx: 1.0,
            ny: 0.0,
            weight: 1.0,
            conflict_weight: 1.0,
            direction: 0,
            straight: false,
        };
        (0..n).map(probe).collect()
    }

    fn places(blocks: &[Block]) -> Vec<usize> {
        let lanes = blocks.iter().flat_map(|b| (0..LANES).map(|k| (b.x[k], b.weight[k])));
        lanes.filter(|(_, w)| *w > 0.0).map(|(x, _)| x as usize).collect()
    }

    #[test]
    fn every_probe_is_asked_once() {
        for n in [0, 1, 2, 7, 8, 15, 16, 17, 31, 100, 128, 1000] {
            let blocks = Blocks::new(&probes(n));
            let mut all = places(blocks.first(usize::MAX));
            all.sort_unstable();
            assert_eq!(all, (0..n).collect::<Vec<_>>());
            assert_eq!((blocks.probes(), blocks.range(0, n).len()), (n, n.div_ceil(LANES)));
        }
    }

    #[test]
    fn the_first_lie_evenly_all_over_the_map() {
        for n in [16, 100, 700, 1000, 1024, 1500] {
            let blocks = Blocks::new(&probes(n));
            for samples in [16, 20, 64, 128, 511, 512] {
                let mut some = places(blocks.first(samples));
                let asked = 1 << samples.min(n).ilog2();
                if samples < n {
                    assert_eq!(some.len(), asked, "{n} {samples}");
                }
                some.sort_unstable();
                let gaps = some.windows(2).map(|w| w[1] - w[0]).chain([n - some[some.len() - 1]]);
                let most = n.div_ceil(some.len());
                assert!(gaps.max().unwrap() <= most, "{n} {samples}: {some:?}");
                let stands_for = blocks.share(samples) * some.len() as f64;
                assert!((stands_for - n as f64).abs() < 1e-9, "{n} {samples}");
            }
        }
    }
}
