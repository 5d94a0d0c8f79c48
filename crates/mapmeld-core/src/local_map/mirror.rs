//! The mirror image of a prepared map: its tables turned over or read backwards, where to prepare it anew would cost as
//! much as the map.

use crate::blocks::Blocks;
use crate::boundary::BoundaryPoint;
use crate::local_map::{LocalMap, Patch, WallSample};
use crate::probe::Probe;
use crate::registration::{coarse_table::CoarseTable, rotations::Turns};
use crate::se2::{Se2, Vec2};
use crate::structure::{Corner, Line};
use std::sync::OnceLock;

/// Turns a grid's columns over: the mirror is the grid's middle column.
struct Mirror {
    origin: Se2,
    to_axes: Se2,
    /// Width of the grid, metres.
    width: f64,
}

impl Mirror {
    fn point(&self, p: Vec2) -> Vec2 {
        let q = self.to_axes.apply(p);
        self.origin.apply(Vec2::new(self.width - q.x, q.y))
    }

    fn vector(&self, v: Vec2) -> Vec2 {
        let q = self.to_axes.rotate(v);
        self.origin.rotate(Vec2::new(-q.x, q.y))
    }

    fn boundary(&self, b: &BoundaryPoint, columns: usize) -> BoundaryPoint {
        let (row, col) = (b.cell as usize / columns, b.cell as usize % columns);
        BoundaryPoint {
            position: self.point(b.position),
            normal: self.vector(b.normal),
            cell: (row * columns + columns - 1 - col) as u32,
            ..*b
        }
    }

    /// Free space stays on the left from start to end.
    fn line(&self, l: &Line) -> Line {
        Line {
            start: self.point(l.end),
            end: self.point(l.start),
            normal: self.vector(l.normal),
            points: l.points.clone(),
            ..*l
        }
    }

    /// Free space stays counter-clockwise of the first arm.
    fn corner(&self, c: &Corner) -> Corner {
        let [first, second] = c.arms;
        let [length, other] = c.lengths;
        Corner {
            vertex: self.point(c.vertex),
            arms: [self.vector(second), self.vector(first)],
            lengths: [other, length],
            ..*c
        }
    }

    fn probe(&self, p: &Probe) -> Probe {
        let half_turn = 1u16 << 15;
        Probe {
            x: (self.width - f64::from(p.x)) as f32,
            nx: -p.nx,
            direction: half_turn.wrapping_sub(p.direction),
            ..*p
        }
    }
}

impl LocalMap {
    /// The mirror image of the map, in the same frame: like it in every statistic, and like no place it was made in.
    pub fn mirrored(&self) -> Self {
        let g = &self.grid;
        let columns = g.width();
        let grid = g.mirrored();
        let mirror = Mirror {
            origin: g.origin(),
            to_axes: g.origin().inverse(),
            width: columns as f64 * g.resolution(),
        };

        let boundary: Vec<BoundaryPoint> =
            self.boundary.iter().map(|b| mirror.boundary(b, columns)).collect();
        let probes: Vec<Probe> = self.probes.iter().map(|p| mirror.probe(p)).collect();
        let sample = |s: &WallSample| WallSample {
            position: mirror.point(s.position),
            normal: mirror.vector(s.normal),
            ..*s
        };
        let patch = |p: &Patch| Patch {
            samples: p.samples.clone(),
            blocks: super::patches::blocks_of(&p.samples, &probes),
            center: mirror.point(p.center),
            radius: p.radius,
            neighbours: p.neighbours.clone(),
        };
        let field = self.field.mirrored(mirror.width);
        let ground = self.ground.mirrored(columns);
        Self {
            coarse: CoarseTable::new(&grid, &boundary, &field, &ground),
            turns: Turns::new(&probes),
            blocks: Blocks::new(&probes),
            lines: self.lines.iter().map(|l| mirror.line(l)).collect(),
            corners: self.corners.iter().map(|c| mirror.corner(c)).collect(),
            samples: self.samples.iter().map(sample).collect(),
            patches: self.patches.iter().map(patch).collect(),
            center: self.center.map(|c| mirror.point(c)),
            floor: self.floor.mirrored(mirror.width),
            wide: OnceLock::new(),
            occupied: OnceLock::new(),
            free: OnceLock::new(),
            grid,
            boundary,
            probes,
            field,
            ground,
            ..*self
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::blocks::LANES;
    use crate::config::Config;
    use crate::grid::{OccupancyGrid, UNKNOWN};
    use crate::likelihood_field::{Walls, DIRECTIONS};
    use crate::probe::Axes;

    /// A room with an alcove, clutter and an unknown rim, like no mirror image of itself.
    fn room() -> OccupancyGrid {
        let (w, h) = (90, 70);
        let cells = (0..w * h).map(|i| {
            let (row, col) = (i / w, i % w);
            let is_known = (8..61).contains(&row) && (6..80).contains(&col);
            let is_wall =
                [8, 60].contains(&row) || [6, 79].contains(&col) || (col == 31 && row > 33);
            match (is_known, is_wall || (row + 3 * col) % 211 == 7) {
                (false, _) => UNKNOWN,
                (_, true) => 100,
                _ => 0,
            }
        });
        let origin = Se2::new(4.0, -2.0, 0.3);
        OccupancyGrid::new("room", w, h, 0.05, origin, cells.collect()).unwrap().trimmed(8)
    }

    #[test]
    fn is_what_the_mirrored_grid_would_give() {
        let config = Config::default();
        let map = LocalMap::new(room(), &config);
        let (turned, anew) = (map.mirrored(), LocalMap::new(room().mirrored(), &config));
        assert_eq!(turned.grid, anew.grid);
        assert!((turned.center.unwrap() - anew.center.unwrap()).norm() < 1e-9);
        assert_eq!(turned.boundary.len(), anew.boundary.len());
        let columns = map.grid.width();
        for cell in 0..turned.grid.cells().len() {
            assert_eq!(turned.ground.depth_squared(cell), anew.ground.depth_squared(cell));
            let at = turned.grid.cell_center(cell / columns, cell % columns);
            for d in 0..DIRECTIONS {
                let far = |m: &LocalMap| {
                    let nearest = m.field.nearest(cell / columns, cell % columns);
                    m.boundary.get(usize::from(nearest[d])).map(|b| (b.position - at).norm())
                };
                match (far(&turned), far(&anew)) {
                    (Some(x), Some(y)) => assert!((x - y).abs() < 1e-9),
                    (None, None) => {}
                    other => panic!("cell {cell}, direction {d}: {other:?}"),
                }
            }
        }
        // As thousands of poses ask the field.
        let t = Se2::new(0.1, 0.05, 0.05);
        let views = [&turned, &anew].map(|m| m.probe_view(Axes::new(&t)));
        let mut walls = 0;
        for block in map.blocks.first(usize::MAX) {
            let [x, y] = views.map(|v| v.see(block));
            assert_eq!(x.cell, y.cell);
            for half_turns in [0, 1] {
                let [near_x, near_y] =
                    [(&x, &views[0]), (&y, &views[1])].map(|(s, v)| v.walls(s, half_turns));
                for k in 0..LANES {
                    assert_eq!(near_x.is_there(k), near_y.is_there(k));
                    walls += usize::from(near_x.is_there(k));
                    let far = |w: &Walls| (w.x[k] - x.x[k]).hypot(w.y[k] - x.y[k]);
                    assert!(!near_x.is_there(k) || (far(&near_x) - far(&near_y)).abs() < 1e-4);
                }
            }
        }
        assert!(walls > 60, "{walls} walls");
        for (of_one, of_other) in [(&turned, &anew), (&anew, &turned)] {
            assert!(!of_one.lines.is_empty() && !of_one.corners.is_empty());
            for l in &of_one.lines {
                let is_it = |m: &Line| (l.start - m.start).norm() + (l.end - m.end).norm() < 1e-6;
                assert!(of_other.lines.iter().any(is_it), "{l:?}");
            }
            for c in &of_one.corners {
                let is_it = |k: &Corner| {
                    (c.vertex - k.vertex).norm() + (c.arms[0] - k.arms[0]).norm() < 1e-6
                };
                assert!(of_other.corners.iter().any(is_it), "{c:?}");
            }
        }
    }

    #[test]
    fn the_mirror_image_of_the_mirror_image_is_the_map() {
        let map = LocalMap::new(room(), &Config::default());
        let twice = map.mirrored().mirrored();
        assert_eq!(twice.grid, map.grid);
        for (x, y) in twice.samples.iter().zip(&map.samples) {
            assert!((x.position - y.position).norm() < 1e-9 && (x.normal - y.normal).norm() < 1e-9);
        }
        for (x, y) in twice.probes.iter().zip(&map.probes) {
            assert!((x.x - y.x).abs() < 1e-5 && x.nx == y.nx && x.direction == y.direction);
        }
        let probes = crate::probe::probes(&map.mirrored().grid, &map.mirrored().samples);
        for (x, y) in map.mirrored().probes.iter().zip(&probes) {
            let off = x.direction.wrapping_sub(y.direction) as i16;
            assert!((x.x - y.x).abs() < 1e-5 && (x.nx - y.nx).abs() < 1e-5 && off.abs() < 3);
        }
    }
}
