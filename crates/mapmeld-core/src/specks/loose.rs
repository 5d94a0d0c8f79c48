//! Occupied cells that stand alone amid free floor.

use super::bands::{self, put, sum, take_of_window, Band};
use crate::grid::{class_of, Class, OccupancyGrid};

/// Loose cells among free ones from which they are noise. Maps that lasers drew have 0.002 at most: legs and corners.
const MOST: f64 = 0.004;
/// Occupied cells within two of a loose one, itself among them.
const MOST_NEAR: u8 = 2;
/// Free cells about a loose one.
const LEAST_FREE: u8 = 5;
/// Cells from which what is told of a cell comes at most.
const MARGIN: usize = 2;

/// A map whose loose occupied cells are free, where they are many. None where they are few.
pub fn freed(grid: &OccupancyGrid) -> Option<OccupancyGrid> {
    let (cells, width) = (grid.cells(), grid.width());
    let mut layers = Layers::default();
    let (mut loose, mut free) = (0.0, 0.0);
    for band in bands::some(grid, MARGIN) {
        let more = see(&mut layers, cells, &band, width);
        loose += more[0];
        free += more[1];
    }
    if loose <= MOST * free {
        return None;
    }
    let mut freed = cells.to_vec();
    for band in bands::all(grid, MARGIN) {
        see(&mut layers, cells, &band, width);
        let loose = &layers.loose[band.within()];
        freed[band.own].iter_mut().zip(loose).filter(|(_, l)| **l == 1).for_each(|(v, _)| *v = 0);
    }
    Some(grid.with_cells(freed))
}

/// What is known of the cells of some rows.
#[derive(Default)]
struct Layers {
    /// Free cells, and how many there are about each cell.
    free: Vec<u8>,
    /// How many occupied cells there are about each cell.
    walls: Vec<u8>,
    loose: Vec<u8>,
}

/// How many cells of a band's own rows are loose, and how many free.
#[multiversion::multiversion(targets("x86_64+avx2"))]
fn see(layers: &mut Layers, cells: &[i8], band: &Band, width: usize) -> [f64; 2] {
    let Layers { free, walls, loose } = layers;
    let cells = &cells[band.seen.clone()];
    put(loose, cells.iter().map(|v| u8::from(class_of(*v) == Class::Occupied)));
    put(free, cells.iter().map(|v| u8::from(class_of(*v) == Class::Free)));
    let all_free = sum(free[band.within()].iter().copied());
    put(walls, loose.iter().copied());
    take_of_window::<2>(walls, width, |a, b| a + b);
    take_of_window::<1>(free, width, |a, b| a + b);
    let is_loose = |w: u8, f: u8| u8::from(w <= MOST_NEAR) & u8::from(f >= LEAST_FREE);
    loose.iter_mut().zip(walls.iter().zip(&*free)).for_each(|(l, (w, f))| *l &= is_loose(*w, *f));
    [sum(loose[band.within()].iter().copied()), all_free]
}
