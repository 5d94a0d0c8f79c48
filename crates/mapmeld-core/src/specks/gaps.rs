//! Unknown specks amid free floor and along walls.

use super::bands::{self, put, sum, Band};
use crate::grid::{class_of, Class, OccupancyGrid};

/// Share of the open floor, and of the wall cells that touch free ones, below which specks have taken too much. Maps
/// that lasers drew keep 0.57 and 0.89 at least.
const LEAST: (f64, f64) = (0.5, 0.85);
/// Cells that open floor is clear of what is not free, on all sides.
const CLEAR: usize = 3;
/// Free cells about a speck of the floor, and such specks among free cells below which they cannot have taken much.
const OF_FLOOR: (u8, f64) = (5, 0.01);
/// Cells from which what is told of a cell comes at most.
const MARGIN: usize = CLEAR + 2;

/// A map with its free floor closed by one cell, where specks took much of it: gaps of up to two unknown cells are free,
/// those along walls too, and larger unknown areas keep their shape. None where specks took little.
pub fn closed(grid: &OccupancyGrid) -> Option<OccupancyGrid> {
    let cells = grid.cells();
    let mut layers = Layers::default();
    let mut total = Counts::default();
    for band in bands::some(grid, MARGIN) {
        see(&mut layers, cells, &band);
        total.add(&count(&mut layers, &band));
    }
    let mut has_floor = || {
        let (mut now, mut closed) = (0.0, 0.0);
        for band in bands::some(grid, MARGIN) {
            see(&mut layers, cells, &band);
            now += open(&layers.free, &mut layers.open, &mut layers.scratch, &band);
            closed += open(&layers.closed, &mut layers.open, &mut layers.scratch, &band);
        }
        now >= LEAST.0 * closed
    };
    if total.walls >= LEAST.1 * total.walls_closed
        && (total.specks <= OF_FLOOR.1 * total.free || has_floor())
    {
        return None;
    }
    let mut filled = cells.to_vec();
    for band in bands::all(grid, MARGIN) {
        see(&mut layers, cells, &band);
        band.free(&mut filled, &layers.closed);
    }
    Some(grid.with_cells(filled))
}

/// How many cells there are.
#[derive(Default)]
struct Counts {
    free: f64,
    /// Unknown ones amid the floor.
    specks: f64,
    /// Of walls that touch free cells: as they are, and with the floor closed.
    walls: f64,
    walls_closed: f64,
}

impl Counts {
    fn add(&mut self, more: &Counts) {
        self.free += more.free;
        self.specks += more.specks;
        self.walls += more.walls;
        self.walls_closed += more.walls_closed;
    }
}

/// What is known of the cells of some rows: one or zero each, but for the first.
#[derive(Default)]
struct Layers {
    /// Free cells about each, itself among them.
    about: Vec<u8>,
    free: Vec<u8>,
    walls: Vec<u8>,
    /// Free once the floor is closed.
    closed: Vec<u8>,
    open: Vec<u8>,
    scratch: Vec<u8>,
}

#[multiversion::multiversion(targets("x86_64+avx2"))]
fn see(layers: &mut Layers, cells: &[i8], band: &Band) {
    let Layers { about, free, walls, closed, scratch, .. } = layers;
    band.tell(free, cells, |v| u8::from(class_of(v) == Class::Free));
    band.tell(walls, cells, |v| u8::from(class_of(v) == Class::Occupied));
    put(about, free.iter().copied());
    band.take_of_window::<1>(about, scratch, |a, b| a + b);
    // Walls bound what is closed; they do not open it.
    put(closed, about.iter().zip(&*walls).map(|(n, w)| u8::from(*n > 0) | w));
    band.take_of_window::<1>(closed, scratch, u8::min);
    let is_closed = |n: u8, w: u8| u8::from(n > 0) & (1 - w);
    closed
        .iter_mut()
        .zip(about.iter().zip(&*walls))
        .for_each(|(c, (n, w))| *c &= is_closed(*n, *w));
}

/// Counts in a band's own rows.
#[multiversion::multiversion(targets("x86_64+avx2"))]
fn count(layers: &mut Layers, band: &Band) -> Counts {
    let Layers { about, free, walls, closed, open, scratch } = layers;
    put(open, closed.iter().copied());
    band.take_of_window::<1>(open, scratch, u8::max);
    let [about, free, walls, closed, near_closed] =
        [&*about, free, walls, closed, open].map(|layer| band.own(layer));
    let specks = closed.iter().zip(free.iter().zip(about));
    Counts {
        free: sum(free.iter().copied()),
        specks: sum(specks.map(|(c, (f, n))| c & (1 - f) & u8::from(*n >= OF_FLOOR.0))),
        walls: sum(walls.iter().zip(about).map(|(w, n)| w & u8::from(*n > 0))),
        walls_closed: sum(walls.iter().zip(near_closed).map(|(w, n)| w & n)),
    }
}

/// How many cells of some free ones are clear of all others, in a band's own rows.
#[multiversion::multiversion(targets("x86_64+avx2"))]
fn open(free: &[u8], open: &mut Vec<u8>, scratch: &mut Vec<u8>, band: &Band) -> f64 {
    put(open, free.iter().copied());
    band.take_of_window::<CLEAR>(open, scratch, u8::min);
    sum(band.own(open).iter().copied())
}
