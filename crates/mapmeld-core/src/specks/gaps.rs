//! Unknown specks amid free floor and along walls.

use super::bands::{self, put, sum, take_of_window, Band};
use crate::grid::{class_of, Class, OccupancyGrid};

/// Share of the open floor, and of the wall cells that touch free ones, below which specks have taken too much. Maps
/// that lasers drew keep 0.57 and 0.89 at least.
const LEAST: (f64, f64) = (0.5, 0.85);
/// Cells that open floor is clear of what is not free, on all sides.
const CLEAR: usize = 3;
/// Cells from which what is told of a cell comes at most.
const MARGIN: usize = CLEAR + 2;

/// A map with its free floor closed by one cell, where specks took much of it: gaps of up to two unknown cells are free,
/// those along walls too, and larger unknown areas keep their shape. None where specks took little.
pub fn closed(grid: &OccupancyGrid) -> Option<OccupancyGrid> {
    let (cells, width) = (grid.cells(), grid.width());
    let mut layers = Layers::default();
    let mut total = [[0.0; 2]; 2];
    for band in bands::some(grid, MARGIN) {
        see(&mut layers, &cells[band.seen.clone()], width);
        let counts = count(&mut layers, &band, width);
        total.iter_mut().flatten().zip(counts.iter().flatten()).for_each(|(t, c)| *t += c);
    }
    let [[open, open_closed], [walls, walls_closed]] = total;
    if open >= LEAST.0 * open_closed && walls >= LEAST.1 * walls_closed {
        return None;
    }
    let mut filled = cells.to_vec();
    for band in bands::all(grid, MARGIN) {
        see(&mut layers, &cells[band.seen.clone()], width);
        let closed = &layers.closed[band.within()];
        filled[band.own].iter_mut().zip(closed).filter(|(_, c)| **c == 1).for_each(|(v, _)| *v = 0);
    }
    Some(grid.with_cells(filled))
}

/// What is known of the cells of some rows: one or zero each.
#[derive(Default)]
struct Layers {
    free: Vec<u8>,
    walls: Vec<u8>,
    /// Free, or beside a free cell.
    near: Vec<u8>,
    /// Free once the floor is closed.
    closed: Vec<u8>,
    scratch: Vec<u8>,
}

#[multiversion::multiversion(targets("x86_64+avx2"))]
fn see(layers: &mut Layers, cells: &[i8], width: usize) {
    let Layers { free, walls, near, closed, .. } = layers;
    put(free, cells.iter().map(|v| u8::from(class_of(*v) == Class::Free)));
    put(walls, cells.iter().map(|v| u8::from(class_of(*v) == Class::Occupied)));
    put(near, free.iter().copied());
    take_of_window::<1>(near, width, u8::max);
    // Walls bound what is closed; they do not open it.
    put(closed, near.iter().zip(&*walls).map(|(n, w)| n | w));
    take_of_window::<1>(closed, width, u8::min);
    closed.iter_mut().zip(near.iter().zip(&*walls)).for_each(|(c, (n, w))| *c &= n & (1 - w));
}

/// Open floor and walls that touch free cells, in a band's own rows: as they are and with the floor closed. What was known
/// to be near is gone then.
#[multiversion::multiversion(targets("x86_64+avx2"))]
fn count(layers: &mut Layers, band: &Band, width: usize) -> [[f64; 2]; 2] {
    let Layers { free, walls, near, closed, scratch } = layers;
    let own = band.within();
    let open = [&*free, &*closed].map(|free| {
        put(scratch, free.iter().copied());
        take_of_window::<CLEAR>(scratch, width, u8::min);
        sum(scratch[own.clone()].iter().copied())
    });
    let at_walls =
        |near: &[u8]| sum(near[own.clone()].iter().zip(&walls[own.clone()]).map(|(n, w)| n & w));
    let walls_now = at_walls(near);
    put(near, closed.iter().copied());
    take_of_window::<1>(near, width, u8::max);
    [open, [walls_now, at_walls(near)]]
}
