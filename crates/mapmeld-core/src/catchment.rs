//! The cells around a point that may lie nearer to it than to its neighbours: of the middle of a wall, a strip across.

/// Largest reach of a point, in cells.
pub const MAX_REACH: usize = 15;
/// Rows within reach.
const ROWS: usize = 2 * MAX_REACH + 1;
/// How far, in rows and columns, the neighbours lie that cells are ceded to.
pub const AROUND: isize = 2;
const SIDE: usize = 2 * AROUND as usize + 1;

/// For each row within reach, the first and the last column of a catchment, from those of the point; none where the
/// first lies beyond the last.
#[derive(Debug, Clone, Copy)]
pub struct Catchment {
    from: [i8; ROWS],
    to: [i8; ROWS],
}

impl Catchment {
    /// Rows, each with its first and last column, that hold a cell.
    pub fn rows(&self) -> impl Iterator<Item = (isize, isize, isize)> + '_ {
        (0..ROWS).filter(|k| self.from[*k] <= self.to[*k]).map(|k| {
            (k as isize - MAX_REACH as isize, isize::from(self.from[k]), isize::from(self.to[k]))
        })
    }

    fn cut(&mut self, other: &Self) {
        for k in 0..ROWS {
            self.from[k] = self.from[k].max(other.from[k]);
            self.to[k] = self.to[k].min(other.to[k]);
        }
    }
}

/// The cells that a point keeps beside one neighbour, at each place that may have one, and those of a point alone.
pub struct Catchments {
    alone: Catchment,
    beside: [[Catchment; SIDE]; SIDE],
}

impl Catchments {
    /// Of points that reach so many cells.
    pub fn new(reach: usize) -> Self {
        assert!(reach <= MAX_REACH, "a reach of {reach} cells");
        let r = reach as i32;
        let where_true = |is_mine: &dyn Fn(i32, i32) -> bool| {
            let mut rows = Catchment { from: [1; ROWS], to: [0; ROWS] };
            for k in 0..ROWS {
                let row = k as i32 - MAX_REACH as i32;
                let mut mine = (-r..=r).filter(|col| is_mine(row, *col));
                if let Some(first) = mine.next() {
                    (rows.from[k], rows.to[k]) = (first as i8, mine.last().unwrap_or(first) as i8);
                }
            }
            rows
        };
        let alone = where_true(&|row, col| row * row + col * col <= r * r);
        let beside = std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                let (to_row, to_col) = (i as i32 - AROUND as i32, j as i32 - AROUND as i32);
                // As near to both: the point's own.
                where_true(&|row, col| {
                    row * row + col * col <= (row - to_row).pow(2) + (col - to_col).pow(2)
                })
            })
        });
        Self { alone, beside }
    }

    /// Of a point without neighbours: a disc.
    pub fn alone(&self) -> Catchment {
        self.alone
    }

    /// Cedes what lies nearer to a neighbour, which lies so many rows and columns on.
    pub fn cede(&self, own: &mut Catchment, rows: isize, cols: isize) {
        own.cut(&self.beside[(rows + AROUND) as usize][(cols + AROUND) as usize]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn holds_what_is_no_farther_than_from_any_neighbour() {
        let neighbours: [&[(isize, isize)]; 5] =
            [&[], &[(0, 1), (0, -1)], &[(1, 1), (-1, -1)], &[(2, -1), (-1, 0), (0, 2)], &[(0, 0)]];
        for reach in [1, 3, 7, 15] {
            let catchments = Catchments::new(reach);
            for near in neighbours {
                let mut own = catchments.alone();
                near.iter().for_each(|(rows, cols)| catchments.cede(&mut own, *rows, *cols));
                let mut got: Vec<(isize, isize)> = own
                    .rows()
                    .flat_map(|(row, from, to)| (from..=to).map(move |c| (row, c)))
                    .collect();
                got.sort_unstable();
                let r = reach as isize;
                let is_own = |(row, col): &(isize, isize)| {
                    let d = row * row + col * col;
                    d <= r * r && near.iter().all(|(i, j)| d <= (row - i).pow(2) + (col - j).pow(2))
                };
                let all = (-r..=r).flat_map(|row| (-r..=r).map(move |col| (row, col)));
                assert_eq!(got, all.filter(is_own).collect::<Vec<_>>(), "{reach} {near:?}");
            }
        }
    }
}
