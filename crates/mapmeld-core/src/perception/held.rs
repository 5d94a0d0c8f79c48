//! The walls that a patch of wall samples was found on: held while the patch moves, since to find them waits for memory.

use crate::blocks::{Block, LANES};
use crate::likelihood_field::{ProbeView, Walls};
use crate::perception::placed::Placed;
use crate::perception::pull::{Matches, Pull};
use crate::probe::Axes;
use crate::se2::{Rigid, Vec2};

/// A map that patches are pulled by, at its place.
pub(super) struct Puller<'a> {
    pub placed: Placed<'a>,
    /// Angle of its grid's axes in the world.
    theta: f64,
    t_world_axes: Rigid,
    t_axes_world: Rigid,
}

/// Where a patch's map lies, its grid's axes in the world: the angle, and all of it.
pub(super) type AxesPose = (f64, Rigid);

impl<'a> Puller<'a> {
    pub fn new(placed: &Placed<'a>) -> Self {
        let t = placed.t_world_map.compose(&placed.map.grid.origin());
        let (t_world_axes, t_axes_world) = (t.to_rigid(), t.inverse().to_rigid());
        Self { placed: *placed, theta: t.theta, t_world_axes, t_axes_world }
    }

    /// False when nothing within a circle, a point of the world and a radius in metres, can lie on the grid.
    pub fn sees(&self, center: Vec2, radius: f64) -> bool {
        self.placed.map.reaches(self.t_axes_world.apply(center), radius)
    }
}

/// The axes from a centre in the world, in the world's directions.
fn from_center((theta, t_world_axes): &AxesPose, center: Vec2) -> Axes {
    let corner = t_world_axes.translation() - center;
    Axes::from_parts(corner, *theta, t_world_axes.sin_cos())
}

/// Walls that the samples of a block were found on, as lines; without a normal where there is none.
struct Lines {
    /// The block.
    block: usize,
    /// Unit normals in the world.
    nx: [f32; LANES],
    /// The same.
    ny: [f32; LANES],
    /// Distances of the lines from the patch's centre along their normals, metres.
    offset: [f32; LANES],
}

impl Lines {
    /// Of walls, whose axes are given from the patch's centre.
    #[inline(always)]
    fn new(block: usize, walls: &Walls, axes: &Axes) -> Self {
        let zero = [0.0; LANES];
        let mut lines = Self { block, nx: zero, ny: zero, offset: zero };
        for k in 0..LANES {
            let (x, y) = axes.apply(walls.x[k], walls.y[k]);
            let (nx, ny) = axes.rotate(walls.nx[k], walls.ny[k]);
            (lines.nx[k], lines.ny[k], lines.offset[k]) = (nx, ny, nx * x + ny * y);
        }
        lines
    }
}

/// The samples of a patch and the walls that they were found on last.
pub(super) struct Held {
    /// Where the rigid pose has the patch's centre.
    center: Vec2,
    /// Where it has the samples of each block, from the centre, metres.
    points: Vec<([f32; LANES], [f32; LANES])>,
    lines: Vec<Lines>,
}

impl Held {
    /// Nothing found yet. `rigid` is where the patch's map lies before any patch has moved.
    pub fn new(samples: &[Block], rigid: &AxesPose, center: Vec2) -> Self {
        let axes = from_center(rigid, center);
        let place = |block: &Block| {
            let mut placed = (block.x, block.y);
            for k in 0..LANES {
                (placed.0[k], placed.1[k]) = axes.apply(block.x[k], block.y[k]);
            }
            placed
        };
        Self { center, points: samples.iter().map(place).collect(), lines: Vec::new() }
    }

    /// Whether any walls were found last.
    pub fn is_pulled(&self) -> bool {
        !self.lines.is_empty()
    }

    /// Finds the walls anew, for the patch as it has moved with its map's axes.
    pub fn find<'a, 'p: 'a>(
        &mut self,
        samples: &[Block],
        (theta, moved): &AxesPose,
        pullers: impl Iterator<Item = &'a Puller<'p>>,
    ) {
        self.lines.clear();
        for puller in pullers {
            let t = puller.t_axes_world.compose(moved);
            let turn = theta - puller.theta;
            let view =
                puller.placed.map.probe_view(Axes::from_parts(t.translation(), turn, t.sin_cos()));
            let axes = from_center(&(puller.theta, puller.t_world_axes), self.center);
            find_on(&view, samples, &axes, &mut self.lines);
        }
    }
}

/// Adds the walls of one map on which the samples lie.
#[multiversion::multiversion(targets("x86_64+avx2"))]
fn find_on(view: &ProbeView, samples: &[Block], axes: &Axes, lines: &mut Vec<Lines>) {
    for (k, block) in samples.iter().enumerate() {
        let walls = view.walls(&view.see(block), 0);
        if (0..LANES).any(|lane| walls.is_there(lane)) {
            lines.push(Lines::new(k, &walls, axes));
        }
    }
}

/// What the walls pull at a patch that was turned about its centre, sine and cosine given, and then shifted; in the
/// world's directions, turning about the centre.
#[multiversion::multiversion(targets("x86_64+avx2"))]
pub(super) fn pull_of(held: &Held, (s, c): (f64, f64), shift: Vec2, pull: &mut Pull) {
    let (s, c, dx, dy) = (s as f32, c as f32, shift.x as f32, shift.y as f32);
    for lines in &held.lines {
        let (x, y) = &held.points[lines.block];
        let zero = [0.0; LANES];
        let mut m = Matches { x: zero, y: zero, nx: lines.nx, ny: lines.ny, residual: zero };
        for k in 0..LANES {
            (m.x[k], m.y[k]) = (c * x[k] - s * y[k], s * x[k] + c * y[k]);
            let along = m.nx[k] * (m.x[k] + dx) + m.ny[k] * (m.y[k] + dy);
            m.residual[k] = along - lines.offset[k];
        }
        pull.add(&m);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use crate::grid::OccupancyGrid;
    use crate::local_map::LocalMap;
    use crate::se2::Se2;

    /// Two walls at a right angle, far from the origin of the map's frame.
    fn map() -> LocalMap {
        let cell = |k: usize| if k % 60 == 30 || k / 60 == 20 { 100 } else { 0 };
        let cells = (0..60 * 50).map(cell).collect();
        let origin = Se2::new(4000.0, -300.0, 0.7);
        LocalMap::new(
            OccupancyGrid::new("g", 60, 50, 0.1, origin, cells).unwrap(),
            &Config::default(),
        )
    }

    fn at(t: &Se2) -> AxesPose {
        (t.theta, t.to_rigid())
    }

    #[test]
    fn walls_that_are_held_pull_a_patch_back_as_far_as_it_has_moved() {
        let map = map();
        let puller = Puller::new(&Placed { map: &map, t_world_map: Se2::IDENTITY, samples: None });
        let rigid = at(&map.grid.origin());
        let (shift, turn) = (Vec2::new(0.03, -0.02), 0.01f64);
        let mut pulled = false;
        for patch in &map.patches {
            let mut held = Held::new(&patch.blocks, &rigid, patch.center);
            held.find(&patch.blocks, &rigid, [&puller].into_iter());
            // All walls weigh alike under so wide a kernel.
            let pull = |turn: f64, shift: Vec2| {
                let mut pull = Pull::new(Vec2::zeros(), 1e3);
                pull_of(&held, turn.sin_cos(), shift, &mut pull);
                pull.equations()
            };
            let (h, at_rest) = pull(0.0, Vec2::zeros());
            assert!(at_rest.norm() < 1e-3, "it lies on itself: {at_rest:?}");
            let (_, moved) = pull(turn, shift);
            let expected = h * shift.push(turn);
            assert!(
                (moved - expected).norm() < 0.02 * expected.norm() + 1e-3,
                "{moved:?} {expected:?}"
            );
            pulled |= expected.norm() > 0.1;
        }
        assert!(pulled);
    }
}
