//! Occupied cells that stand alone amid free floor.

use super::bands::{self, put, sum, Band};
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
    let cells = grid.cells();
    let mut layers = Layers::default();
    let (mut loose, mut free) = (0.0, 0.0);
    for band in bands::some(grid, MARGIN) {
        let [more, more_free] = see(&mut layers, cells, &band);
        loose += more;
        free += more_free;
    }
    if loose <= MOST * free {
        return None;
    }
    let mut freed = cells.to_vec();
    for band in bands::all(grid, MARGIN) {
        see(&mut layers, cells, &band);
        band.free(&mut freed, &layers.loose);
    }
    Some(grid.with_cells(freed))
}

/// What is known of the cells of some rows.
#[derive(Default)]
struct Layers {
    /// How many free cells there are about each cell.
    free: Vec<u8>,
    /// How many occupied cells there are about each cell.
    walls: Vec<u8>,
    /// One for loose cells.
    loose: Vec<u8>,
    scratch: Vec<u8>,
}

/// How many cells of a band's own rows are loose, and how many free.
#[multiversion::multiversion(targets("x86_64+avx2"))]
fn see(layers: &mut Layers, cells: &[i8], band: &Band) -> [f64; 2] {
    let Layers { free, walls, loose, scratch } = layers;
    band.tell(free, cells, |v| u8::from(class_of(v) == Class::Free));
    band.tell(loose, cells, |v| u8::from(class_of(v) == Class::Occupied));
    let all_free = sum(band.own(free).iter().copied());
    put(walls, loose.iter().copied());
    band.take_of_window::<2>(walls, scratch, |a, b| a + b);
    band.take_of_window::<1>(free, scratch, |a, b| a + b);
    let is_loose = |w: u8, f: u8| u8::from(w <= MOST_NEAR) & u8::from(f >= LEAST_FREE);
    loose.iter_mut().zip(walls.iter().zip(&*free)).for_each(|(l, (w, f))| *l &= is_loose(*w, *f));
    [sum(band.own(loose).iter().copied()), all_free]
}
