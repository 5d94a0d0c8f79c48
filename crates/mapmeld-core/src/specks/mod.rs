//! Maps full of specks. Some mappers leave unknown cells between rays or where a cell is neither free nor occupied yet,
//! others mark a cell wherever one echo came from. Such a map has no open floor and its walls touch no free cell, or it is
//! full of walls that are none, though whoever looks at it sees the building. Maps that lasers drew cell by cell have few
//! specks, and are used as they are.

mod bands;
mod gaps;
mod loose;

use crate::grid::OccupancyGrid;

/// A map without its specks, where there are many. None for a map that is fit to be used as it is.
pub fn without(grid: &OccupancyGrid) -> Option<OccupancyGrid> {
    let settled = loose::freed(grid);
    gaps::closed(settled.as_ref().unwrap_or(grid)).or(settled)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::UNKNOWN;
    use crate::se2::Se2;

    const SIDE: usize = 60;

    /// A room with walls of one cell, nothing known outside, after some change of its floor, by row and column.
    fn room(floor: impl Fn(usize, usize) -> i8) -> OccupancyGrid {
        let cell = |k: usize| {
            let (row, col) = (k / SIDE, k % SIDE);
            match (row.min(col), row.max(col)) {
                (least, most) if least < 5 || most > 54 => UNKNOWN,
                (5, _) | (_, 54) => 100,
                _ => floor(row, col),
            }
        };
        let cells = (0..SIDE * SIDE).map(cell).collect();
        OccupancyGrid::new("room", SIDE, SIDE, 0.05, Se2::IDENTITY, cells).unwrap()
    }

    /// Fails with the first few cells that are not as expected.
    fn assert_becomes(map: &OccupancyGrid, expected: &OccupancyGrid) {
        let found = without(map).expect("full of specks");
        let differs = |k: &usize| found.cells()[*k] != expected.cells()[*k];
        let wrong: Vec<_> = (0..found.cells().len()).filter(differs).take(5).collect();
        assert!(
            wrong.is_empty(),
            "{:?}",
            wrong.iter().map(|k| (k / SIDE, k % SIDE)).collect::<Vec<_>>()
        );
    }

    fn value(is_speck: bool, of: i8) -> i8 {
        if is_speck {
            of
        } else {
            0
        }
    }

    #[test]
    fn a_map_with_few_specks_is_left_alone() {
        assert!(without(&room(|_, _| 0)).is_none());
        // A shadow is none, nor are a table's legs.
        assert!(without(&room(|row, _| value((10..16).contains(&row), UNKNOWN))).is_none());
        let legs = |row, col| value([20, 30].contains(&row) && [20, 40].contains(&col), 100);
        assert!(without(&room(legs)).is_none());
    }

    #[test]
    fn unknown_specks_become_floor() {
        let specks = room(|row, col| value((row + 2 * col) % 5 == 0, UNKNOWN));
        assert_becomes(&specks, &room(|_, _| 0));
    }

    #[test]
    fn walls_touch_the_floor_again() {
        // Grey cells between the walls and the floor.
        let belt = room(|row, col| value(row.min(col) == 6 || row.max(col) == 53, 40));
        assert_becomes(&belt, &room(|_, _| 0));
    }

    #[test]
    fn unknown_areas_keep_their_shape() {
        let half = room(|row, col| value(row > 30 || (row + 2 * col) % 5 == 0, UNKNOWN));
        assert_becomes(&half, &room(|row, _| value(row > 30, UNKNOWN)));
    }

    #[test]
    fn loose_echoes_become_floor_and_walls_stay() {
        let is_wall = |row: usize, col: usize| row == 30 && col < 40;
        // None within two cells of a wall.
        let is_echo = |row: usize, col: usize| {
            row % 7 == 3 && col % 9 == 5 && row < 50 && !(28..33).contains(&row)
        };
        let echoes = room(|row, col| value(is_wall(row, col) || is_echo(row, col), 100));
        assert_becomes(&echoes, &room(|row, col| value(is_wall(row, col), 100)));
        // With unknown specks among them too.
        let is_gap = |row: usize, col: usize| (row + 2 * col) % 5 == 0 && !is_wall(row, col);
        let both = room(|row, col| match (is_gap(row, col), is_wall(row, col)) {
            (true, _) => UNKNOWN,
            (_, is_wall) => value(is_wall || is_echo(row, col), 100),
        });
        assert_becomes(&both, &room(|row, col| value(is_wall(row, col), 100)));
    }

    /// Whether a corridor is cleaned that has specks of a value in its lower or upper half.
    fn is_cleaned(is_low: bool, value: i8) -> bool {
        let (w, h) = (24, 400);
        let is_speck = |row: usize, col: usize| match value {
            UNKNOWN => (row + 2 * col) % 5 == 0,
            _ => row % 7 == 3 && col % 9 == 5,
        };
        let cell = |k: usize| match (k / w, k % w) {
            (_, 0 | 23) | (0 | 399, _) => 100,
            (row, col) if (row < h / 2) == is_low && is_speck(row, col) => value,
            _ => 0,
        };
        let cells = (0..w * h).map(cell).collect();
        let map = OccupancyGrid::new("tall", w, h, 0.05, Se2::IDENTITY, cells).unwrap();
        without(&map).is_some()
    }

    #[test]
    fn either_end_of_a_map_is_asked() {
        for value in [UNKNOWN, 100] {
            assert!(is_cleaned(true, value) && is_cleaned(false, value));
        }
    }

    #[test]
    fn bands_make_no_difference() {
        // Of several bands: closed as if all were one, and slowly.
        let (w, h) = (130usize, 170usize);
        let mut rng = 7u32;
        let mut draw = || {
            rng = rng.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            rng >> 24
        };
        let cells: Vec<i8> = (0..w * h)
            .map(|_| match draw() {
                0..50 => UNKNOWN,
                50..60 => 100,
                _ => 0,
            })
            .collect();
        let about = |k: usize, radius: isize, is: &dyn Fn(usize) -> bool| -> Vec<bool> {
            let (row, col) = ((k / w) as isize, (k % w) as isize);
            let window = |at: isize| at - radius..=at + radius;
            window(row)
                .flat_map(|r| window(col).map(move |c| (r, c)))
                .map(|(r, c)| {
                    let inside = r >= 0 && c >= 0 && r < h as isize && c < w as isize;
                    inside && is(r as usize * w + c as usize)
                })
                .collect()
        };
        let count = |of: Vec<bool>| of.into_iter().filter(|v| *v).count();
        let is_loose = |k: usize| {
            cells[k] == 100
                && count(about(k, 2, &|k| cells[k] == 100)) <= 2
                && count(about(k, 1, &|k| cells[k] == 0)) >= 5
        };
        let freed: Vec<i8> = (0..w * h).map(|k| if is_loose(k) { 0 } else { cells[k] }).collect();
        let near: Vec<bool> =
            (0..w * h).map(|k| about(k, 1, &|k| freed[k] == 0).contains(&true)).collect();
        let is_bound = |k: usize| near[k] || freed[k] == 100;
        let is_closed =
            |k: usize| freed[k] == UNKNOWN && near[k] && !about(k, 1, &is_bound).contains(&false);
        let expected: Vec<i8> =
            (0..w * h).map(|k| if is_closed(k) { 0 } else { freed[k] }).collect();
        assert_ne!(freed, cells);
        assert_ne!(expected, freed);
        let grid = OccupancyGrid::new("noise", w, h, 0.05, Se2::IDENTITY, cells.clone()).unwrap();
        let found = without(&grid).expect("full of specks");
        let wrong = (0..w * h).find(|k| found.cells()[*k] != expected[*k]);
        assert_eq!(wrong.map(|k| (k / w, k % w)), None);
    }

    #[test]
    fn the_narrowest_grids_are_asked_too() {
        for (width, height) in [(1, 1), (1, 7), (7, 1), (2, 2), (3, 300)] {
            for value in [UNKNOWN, 0, 100] {
                let cells = vec![value; width * height];
                let grid = OccupancyGrid::new("g", width, height, 0.05, Se2::IDENTITY, cells);
                assert!(without(&grid.unwrap()).is_none());
            }
        }
    }
}
