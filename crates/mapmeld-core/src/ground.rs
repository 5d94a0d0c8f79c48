//! What a wall of another map means in each cell: how deep it would lie in free space, and whether anything is known.

use crate::blocks::LANES;
use crate::config::PerceptionConfig;
use crate::distance::DistanceTable;
use crate::grid::{class_of, turned_over, Class, OccupancyGrid};
use std::ops::Range;

/// Of cells that nothing is known of, those outside the grid too.
const UNKNOWN: u8 = u8::MAX;

/// See the module's text. A byte a cell, row by row, and one for what lies outside the grid.
#[derive(Debug, Clone)]
pub struct Ground {
    /// Squared depth in free space, in cells, as far as it fits; zero for what is occupied.
    cells: Vec<u8>,
    /// How much of a full conflict a wall is there.
    shares: Box<[f32; 256]>,
}

impl Ground {
    /// Of a map.
    pub fn new(grid: &OccupancyGrid, config: &PerceptionConfig) -> Self {
        let depth = DistanceTable::to_other_than(grid, Class::Free);
        let cell = |(v, d): (&i8, &u8)| match class_of(*v) {
            Class::Unknown => UNKNOWN,
            _ => (*d).min(UNKNOWN - 1),
        };
        let mut cells: Vec<u8> = grid.cells().iter().zip(depth.as_slice()).map(cell).collect();
        cells.push(UNKNOWN);
        Self { cells, shares: Box::new(shares(grid.resolution(), config)) }
    }

    /// The same of the mirrored map, of a grid so many columns wide.
    pub fn mirrored(&self, columns: usize) -> Self {
        let (outside, cells) = self.cells.split_last().expect("what lies outside");
        let mut cells = turned_over(cells, columns);
        cells.push(*outside);
        Self { cells, shares: self.shares.clone() }
    }

    /// Squared depth in free space at a cell, in cells, up to 254; zero for what is not free. One beyond the last cell
    /// stands for what lies outside the grid.
    #[inline(always)]
    pub fn depth_squared(&self, cell: usize) -> u8 {
        match self.cells[cell] {
            UNKNOWN => 0,
            depth => depth,
        }
    }

    /// Which of some cells, counted from the first of them, lie in free space at such a squared depth at least.
    pub fn deep(&self, cells: Range<usize>, squared: u8) -> impl Iterator<Item = usize> + '_ {
        let is_deep = move |(_, v): &(usize, &u8)| (squared..UNKNOWN).contains(*v);
        self.cells[cells].iter().enumerate().filter(is_deep).map(|(k, _)| k)
    }

    /// Whether nothing is known of a cell.
    #[inline(always)]
    pub fn is_unknown(&self, cell: usize) -> bool {
        self.cells[cell] == UNKNOWN
    }

    /// How much of a full conflict a wall is in a cell, in [0, 1].
    #[inline(always)]
    pub fn conflict(&self, cell: usize) -> f32 {
        self.shares[usize::from(self.cells[cell])]
    }

    /// How much of a full conflict and how much of a miss a wall is in each of some cells, in [0, 1]: one of the two,
    /// neither where nothing is known.
    #[inline(always)]
    pub fn conflicts_and_misses(&self, cells: &[u32; LANES]) -> ([f32; LANES], [f32; LANES]) {
        let (mut conflicts, mut misses) = ([0.0; LANES], [0.0; LANES]);
        for (k, cell) in cells.iter().enumerate() {
            let code = self.cells[*cell as usize];
            conflicts[k] = self.shares[usize::from(code)];
            misses[k] = f32::from(u8::from(code != UNKNOWN && conflicts[k] == 0.0));
        }
        (conflicts, misses)
    }
}

/// By squared depth in cells: no conflict up to a depth, a full one from a greater depth on, in proportion between.
fn shares(resolution: f64, config: &PerceptionConfig) -> [f32; 256] {
    let least = (config.conflict_depth / resolution).clamp(3.0, 15.9);
    // Depths are known up to the reach of the distance table only.
    let full = (config.full_conflict_depth / resolution).clamp(least, 15.9);
    std::array::from_fn(|squared| {
        let depth = (squared as f64).sqrt();
        match squared == usize::from(UNKNOWN) || depth < least {
            true => 0.0,
            false => (depth / full).min(1.0) as f32,
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid;
    use crate::se2::Se2;

    #[test]
    fn tells_depths_conflicts_and_the_unknown() {
        // A wall, forty free cells, and nothing known beyond.
        let row: Vec<i8> = (0..50)
            .map(|k| [100, 0, grid::UNKNOWN][(k > 0) as usize + (k > 40) as usize])
            .collect();
        let cells = (0..60).flat_map(|_| row.clone()).collect();
        let g = OccupancyGrid::new("g", 50, 60, 0.1, Se2::IDENTITY, cells).unwrap();
        let ground = Ground::new(&g, &PerceptionConfig::default());
        let at = |col: usize| 30 * 50 + col;
        assert_eq!(
            [0, 1, 5, 20, 40, 41, 49].map(|c| ground.depth_squared(at(c))),
            [0, 1, 25, 254, 1, 0, 0]
        );
        assert!(ground.is_unknown(at(41)) && ground.is_unknown(3000) && !ground.is_unknown(at(0)));
        // Three cells deep at least, and half a metre for a full one.
        let mut cells = [3000; LANES];
        let some = [0, 2, 4, 5, 20, 45].map(|c| at(c) as u32);
        cells[..6].copy_from_slice(&some);
        let (conflicts, misses) = ground.conflicts_and_misses(&cells);
        assert_eq!(conflicts[..7], [0.0, 0.0, 0.8, 1.0, 1.0, 0.0, 0.0]);
        assert_eq!(misses[..7], [1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        assert!((0..6).all(|k| ground.conflict(cells[k] as usize) == conflicts[k]));
        let turned = ground.mirrored(50);
        assert!((0..50).all(|c| turned.depth_squared(at(49 - c)) == ground.depth_squared(at(c))));
        assert!(turned.is_unknown(3000));
    }
}
