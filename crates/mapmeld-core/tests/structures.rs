//! Lines and corners of rooms drawn at any angle, and the motions that similar corners propose.

mod common;

use common::{any_frame, apart, office, rng, Plan};
use mapmeld_core::config::Config;
use mapmeld_core::grid::OccupancyGrid;
use mapmeld_core::local_map::LocalMap;
use mapmeld_core::registration::corners::candidates;
use mapmeld_core::se2::{Se2, Vec2};
use std::f64::consts::{FRAC_PI_2, PI};

const CELL: f64 = 0.05;

/// A corner that a map must show: vertex, the directions of arm 0 and arm 1 (degrees), and whether
/// it belongs to a room (convex) or to something that stands in it.
struct Expected {
    vertex: (f64, f64),
    arms: (f64, f64),
    convex: bool,
    shorter_arm: f64,
}

fn expected(vertex: (f64, f64), arms: (f64, f64), convex: bool, shorter_arm: f64) -> Expected {
    Expected { vertex, arms, convex, shorter_arm }
}

/// A room of 6 m x 4.4 m with a door in its south wall, on unknown ground; a block in the shape of
/// an L, and a free-standing panel of 0.6 m x 1.6 m. All walls are 0.2 m thick.
fn room() -> Plan {
    let mut plan = Plan { half: 0.1, ..Plan::default() }
        .floor([0.0, 0.0, 6.0, 4.4])
        .wall(&[(4.0, 0.0), (6.0, 0.0), (6.0, 4.4), (0.0, 4.4), (0.0, 0.0), (3.0, 0.0)])
        .wall(&[(4.3, 1.6), (4.3, 3.0)])
        .wall(&[(4.5, 1.6), (4.5, 3.0)])
        .wall(&[(4.7, 1.6), (4.7, 3.0)]);
    // The L, solid: 2 m x 2 m without the quarter at its upper right.
    for k in 0..9 {
        let at = 1.1 + 0.1 * k as f64;
        plan = plan.wall(&[(1.1, at), (2.9, at)]).wall(&[(at, 1.1), (at, 2.9)]);
    }
    plan
}

/// Counter-clockwise from arm 0 to arm 1 lies free space.
fn corners_of_the_room() -> Vec<Expected> {
    vec![
        // The room, seen from within.
        expected((0.1, 0.1), (0.0, 90.0), true, 3.0),
        expected((5.9, 0.1), (90.0, 180.0), true, 2.0),
        expected((5.9, 4.3), (180.0, 270.0), true, 4.2),
        expected((0.1, 4.3), (270.0, 0.0), true, 4.2),
        // The L: five edges and its inner corner.
        expected((1.0, 1.0), (90.0, 0.0), false, 2.0),
        expected((3.0, 1.0), (180.0, 90.0), false, 1.0),
        expected((3.0, 2.0), (270.0, 180.0), false, 1.0),
        expected((2.0, 2.0), (0.0, 90.0), true, 1.0),
        expected((2.0, 3.0), (270.0, 180.0), false, 1.0),
        expected((1.0, 3.0), (0.0, 270.0), false, 1.0),
        // The panel.
        expected((4.2, 1.5), (90.0, 0.0), false, 0.6),
        expected((4.8, 1.5), (180.0, 90.0), false, 0.6),
        expected((4.8, 3.1), (270.0, 180.0), false, 0.6),
        expected((4.2, 3.1), (0.0, 270.0), false, 0.6),
    ]
}

fn everything(_: Vec2) -> bool {
    true
}

/// Frames at all angles: odd ones, small ones, and those along the axes.
fn frames() -> Vec<Se2> {
    let turns =
        [0.0, 0.03, 0.3, 0.6, PI / 4.0, 1.0, 1.4, FRAC_PI_2, 2.2, 3.0, PI, -2.0, -0.9, -0.1];
    turns.iter().map(|a| Se2::new(1.234 + a, -2.345 * a, *a)).collect()
}

fn heading(degrees: f64) -> Vec2 {
    Vec2::new(degrees.to_radians().cos(), degrees.to_radians().sin())
}

fn angle_between(a: &Vec2, b: &Vec2) -> f64 {
    a.perp(b).atan2(a.dot(b)).abs().to_degrees()
}

#[test]
fn corners_of_a_room_are_found_at_every_angle() {
    for t in frames() {
        let map = LocalMap::new(room().draw("room", &t, CELL, everything), &Config::default());
        for e in corners_of_the_room() {
            let vertex = Vec2::new(e.vertex.0, e.vertex.1);
            let c = map
                .corners
                .iter()
                .min_by(|a, b| {
                    let off =
                        |c: &mapmeld_core::structure::Corner| (t.apply(c.vertex) - vertex).norm();
                    off(a).total_cmp(&off(b))
                })
                .expect("a room has corners");
            let at = format!("corner {:?} at {:.0} deg", e.vertex, t.theta.to_degrees());
            let off = (t.apply(c.vertex) - vertex).norm() / CELL;
            assert!(off < 1.5, "{at}: {off:.2} cells off");
            // On a short side one cell up or down is already this much.
            let tolerance = if e.shorter_arm < 0.9 { 9.0 } else { 5.0 };
            let opening = if e.convex { FRAC_PI_2 } else { 1.5 * PI };
            let off = (c.opening - opening).to_degrees().abs();
            assert!(off < tolerance, "{at}: opening off by {off:.1} deg");
            for (k, degrees) in [e.arms.0, e.arms.1].into_iter().enumerate() {
                let off = angle_between(&t.rotate(c.arms[k]), &heading(degrees));
                assert!(off < tolerance, "{at}: arm {k} off by {off:.1} deg");
            }
            let shorter = c.lengths[0].min(c.lengths[1]);
            let off = (shorter - e.shorter_arm).abs() / CELL;
            assert!(off < 5.0, "{at}: shorter arm {shorter:.2} m, should be {} m", e.shorter_arm);
        }
    }
}

/// The door's jambs may be corners; nothing else is.
#[test]
fn no_corners_where_there_are_none() {
    for t in frames() {
        let map = LocalMap::new(room().draw("room", &t, CELL, everything), &Config::default());
        for c in &map.corners {
            let p = t.apply(c.vertex);
            let known = corners_of_the_room();
            let is_known =
                known.iter().any(|e| (p - Vec2::new(e.vertex.0, e.vertex.1)).norm() < 1.5 * CELL);
            let at_door = p.y < 0.3 && (2.7..4.3).contains(&p.x);
            assert!(is_known || at_door, "a corner at {:?}, {:.2} rad", (p.x, p.y), t.theta);
        }
    }
}

/// Every long side of a wall is one line: its length, its place, its normal into free space.
#[test]
fn lines_of_a_room_are_found_at_every_angle() {
    // Middle of the side, normal, length.
    let sides = [
        ((1.6, 0.1), 90.0, 3.0),
        ((4.9, 0.1), 90.0, 2.0),
        ((5.9, 2.2), 180.0, 4.2),
        ((3.0, 4.3), 270.0, 5.8),
        ((0.1, 2.2), 0.0, 4.2),
        ((2.0, 1.0), 270.0, 2.0),
        ((1.0, 2.0), 180.0, 2.0),
        ((3.0, 1.5), 0.0, 1.0),
        ((4.2, 2.3), 180.0, 1.6),
        ((4.8, 2.3), 0.0, 1.6),
    ];
    for t in frames() {
        let map = LocalMap::new(room().draw("room", &t, CELL, everything), &Config::default());
        assert!(map.lines.windows(2).all(|w| w[0].length() >= w[1].length()), "longest first");
        for ((x, y), normal, length) in sides {
            let (middle, normal) = (Vec2::new(x, y), heading(normal));
            let fits = |l: &&mapmeld_core::structure::Line| {
                let centre = t.apply((l.start + l.end) / 2.0);
                let n = t.rotate(l.normal);
                (centre - middle).dot(&normal).abs() < 1.5 * CELL
                    && (centre - middle).norm() < 4.0 * CELL
                    && angle_between(&n, &normal) < if length < 1.5 { 5.0 } else { 2.0 }
                    && (l.length() - length).abs() < 6.0 * CELL
            };
            let found = map.lines.iter().filter(fits).count();
            let at = format!("side at {:?} turned by {:.0} deg", (x, y), t.theta.to_degrees());
            assert_eq!(found, 1, "{at}: {found} lines");
        }
        for l in &map.lines {
            let left = Vec2::new(-l.direction().y, l.direction().x);
            assert!(left.dot(&l.normal) > 0.999, "free space lies on the left");
            assert!((l.end - l.start).normalize().dot(&l.direction()) > 0.999);
            let to_free = t.apply((l.start + l.end) / 2.0 + l.normal * (3.0 * CELL));
            assert_eq!(room().value(to_free), 0, "the normal points into free space");
        }
    }
}

/// The motion from a map to its redraw is among those that similar corners propose.
#[test]
fn similar_corners_propose_the_true_motion() {
    let config = Config::default();
    let mut rng = rng(4);
    for k in 0..15 {
        let (ta, tb) = (any_frame(&mut rng), any_frame(&mut rng));
        // Two robots that share the middle of the floor only.
        let a = LocalMap::new(office().draw("a", &ta, 0.1, |p| p.x < 11.0), &config);
        let b = LocalMap::new(office().draw("b", &tb, 0.1, |p| p.x > 5.5), &config);
        let truth = ta.between(&tb);
        let found = candidates(&a.corners, &b.corners, &config.registration);
        // In the middle of what both see.
        let middle = tb.inverse().apply(Vec2::new(8.0, 5.0));
        let near = |t: &Se2| {
            let (metres, degrees) = apart(t, &truth, middle);
            metres < 0.2 && degrees < 3.0
        };
        let right = found.iter().filter(|c| near(&c.t_a_b)).count();
        assert!(right >= 2, "frames {k}: {right} right of {}", found.len());
        assert!(found.len() < a.corners.len() * b.corners.len(), "not every pair is similar");
    }
}

#[test]
fn how_thick_walls_are_drawn_is_seen_in_every_frame() {
    let outline = [(0.0, 0.0), (6.0, 0.0), (6.0, 4.0), (0.0, 4.0), (0.0, 0.0)];
    let drawn = |half: f64, cell: f64, t: &Se2| {
        let plan = Plan { half, ..Plan::default() }.floor([0.0, 0.0, 6.0, 4.0]).wall(&outline);
        LocalMap::new(plan.draw("room", t, cell, everything), &Config::default()).smear
    };
    for t in frames() {
        for cell in [0.05, 0.1] {
            assert!(drawn(0.5 * cell, cell, &t) < 0.3 * cell, "a cell thick");
            let thick = drawn(2.0 * cell, cell, &t) / cell;
            assert!((thick - 2.5).abs() < 1.1, "{thick} beyond a cell and a half, of four");
        }
    }
}

#[test]
fn what_is_missing_of_a_wall_does_not_make_it_sharp() {
    let outline = [(0.0, 0.0), (6.0, 0.0), (6.0, 4.0), (0.0, 4.0), (0.0, 0.0)];
    let plan = Plan { half: 0.12, ..Plan::default() }.floor([0.0, 0.0, 6.0, 4.0]).wall(&outline);
    let whole = plan.draw("room", &Se2::IDENTITY, 0.05, everything);
    let broken = |is_missing: &dyn Fn(usize, usize) -> bool| {
        let (w, h) = (whole.width(), whole.height());
        let missing = |k: usize| whole.cells()[k] >= 65 && is_missing(k % w, k / w);
        let cells = (0..w * h).map(|k| if missing(k) { 0 } else { whole.cells()[k] }).collect();
        let grid = OccupancyGrid::new("room", w, h, 0.05, whole.origin(), cells).unwrap();
        LocalMap::new(grid, &Config::default()).smear
    };
    let full = broken(&|_, _| false);
    // Single cells, which have faces of their own.
    let holes = broken(&|x, y| x % 3 == 0 && y % 3 == 0);
    assert!(full > 0.1 && holes > 0.5 * full, "{holes} of {full}");
    // Two cells in three: what is left are thin stripes.
    let stripes = broken(&|x, y| (x + y) % 4 > 0);
    assert!(stripes < 0.3 * full, "{stripes} of {full}");
}

/// Of thousands of wall points some tell how deep walls are drawn: not those of one wall alone.
#[test]
fn the_depth_of_walls_is_no_matter_of_how_many_come_in_a_row() {
    for walls in 3..9 {
        // One thin wall and thick ones, in all rows the same.
        let (w, h) = (40 * walls, 1000);
        let is_wall = |x: usize| (20..if x < 40 { 21 } else { 25 }).contains(&(x % 40));
        let cells = (0..w * h).map(|k| if is_wall(k % w) { 100 } else { 0 }).collect();
        let grid = OccupancyGrid::new("g", w, h, 0.05, Se2::IDENTITY, cells).unwrap();
        let smear = LocalMap::new(grid, &Config::default()).smear / 0.05;
        assert!((smear - 3.5).abs() < 0.6, "{smear} cells beyond a cell and a half, of five");
    }
}
