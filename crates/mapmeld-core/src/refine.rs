//! Joint refinement of all poses of a component over all overlapping boundaries.
//!
//! Point-to-line residuals of every pair of maps that share walls, under a Geman-McClure kernel that
//! narrows from the field's reach to the walls' noise (graduated non-convexity; Yang, Antonante,
//! Tzoumas, Carlone, "Graduated non-convexity for robust spatial perception", 2020), solved by
//! Gauss-Newton for all poses at once. Poses that are held stay where they are.

mod edge;
mod escape;
mod overlap;

use crate::config::Config;
use crate::local_map::LocalMap;
use crate::pair_table::PairTable;
use crate::parallel;
use crate::registration::climb::LEVER;
use crate::result::Known;
use crate::se2::{self, Se2, Vec2};
use crate::sparse::{Blocks, Factor};
use edge::Edge;
use escape::Arrangement;
use nalgebra::{DVector, Matrix3, Matrix6, Vector3};
use overlap::overlapping;

/// Smallest standard deviation of a wall's distance, cells: that of rounding to cells in both maps.
const FINEST: f64 = 0.41;

/// Up to so many poses a dense factorisation is as fast.
const MOST_DENSE: usize = 64;

/// Times that it is asked which maps' walls agree, at most.
const ROUNDS: usize = 3;

/// Poses are refined until none moves by more than this share of a cell...
const REFINED: f64 = 0.01;
/// ... or by this, where draws will add their noise.
pub const SETTLED: f64 = 0.05;

/// Times that members are moved to where pairs contradict the optimum, at most.
const MOVES: usize = 5;

/// Poses after refinement.
#[derive(Debug, Clone)]
pub struct Refined {
    /// `T_world_map` of each map, in the order given.
    pub poses: Vec<Se2>,
    /// Covariance of each pose relative to those held, whose own is zero.
    pub covariances: Vec<Matrix3<f64>>,
    /// Root mean square of the matched walls' residuals, metres; none without a match.
    pub rms: Option<f64>,
}

/// Refines the poses of `members` (indices into `maps`); those at the positions `held` stay. Walls of forbidden
/// pairs do not pull at each other. Of neighbouring optima it is the one in which all walls together say most that
/// moves of single members lead to, by the modes of `pairs`.
pub fn refine(
    maps: &[LocalMap],
    members: &[usize],
    poses: &[Se2],
    held: &[usize],
    pairs: &PairTable,
    known: &Known,
    config: &Config,
) -> Refined {
    let (poses, mut edges) = self::poses(maps, members, poses, held, known, (REFINED, config));
    let mut here = Arrangement::new(maps, members, poses, known, config);
    for _ in 0..MOVES {
        let Some(moved) = here.moved(held, pairs, known) else { break };
        let (poses, of_moved) = self::poses(maps, members, &moved, held, known, (REFINED, config));
        let there = Arrangement::new(maps, members, poses, known, config);
        if there.evidence() <= here.evidence() {
            break;
        }
        (here, edges) = (there, of_moved);
    }
    let poses = here.poses;
    let (resolution, narrow) = (resolution(maps, members), narrow(maps, members, config));
    let (h, _) = normal_equations(maps, members, &poses, &edges, held, narrow);
    let Tension { pulls, squares, weight } = tension(maps, members, &poses, &edges, narrow);
    let rms = (weight > 0.0).then(|| (squares / weight).sqrt());
    let arms = arms(maps, members, &poses);
    Refined { covariances: covariances(h, pulls, held, &arms, resolution, config), poses, rms }
}

/// The refined poses alone, and the pairs of members whose walls led them there. `still`: up to which share of a cell
/// they may still move.
pub fn poses(
    maps: &[LocalMap],
    members: &[usize],
    poses: &[Se2],
    held: &[usize],
    known: &Known,
    (still, config): (f64, &Config),
) -> (Vec<Se2>, Vec<(usize, usize)>) {
    let mut poses = poses.to_vec();
    let mut edges = overlapping(maps, members, &poses, known, config);
    descend(maps, members, &mut poses, &edges, held, (still, config));
    for _ in 1..ROUNDS {
        // Which walls agree is better known now.
        let agreeing = overlapping(maps, members, &poses, known, config);
        if agreeing == edges {
            break;
        }
        edges = agreeing;
        descend(maps, members, &mut poses, &edges, held, (still, config));
    }
    (poses, edges)
}

/// The coarsest resolution of the maps, metres.
fn resolution(maps: &[LocalMap], members: &[usize]) -> f64 {
    members.iter().map(|m| maps[*m].grid.resolution()).fold(0.0, f64::max)
}

/// How wide the kernel is in the end, metres.
fn narrow(maps: &[LocalMap], members: &[usize], config: &Config) -> f64 {
    let walls = (2.0 * resolution(maps, members)).max(config.perception.climb_sigma);
    config.refine.kernel.unwrap_or(walls)
}

/// Leads poses to where the walls of the edges fit best under a kernel that narrows down, until none moves by more than
/// `still` cells.
fn descend(
    maps: &[LocalMap],
    members: &[usize],
    poses: &mut [Se2],
    edges: &[(usize, usize)],
    held: &[usize],
    (still, config): (f64, &Config),
) {
    let n = members.len();
    let (resolution, narrow) = (resolution(maps, members), narrow(maps, members, config));
    let reach = members.iter().map(|m| maps[*m].reach()).fold(f64::INFINITY, f64::min);
    let mut scale = (0.5 * reach).max(narrow);
    let iterations = if edges.is_empty() { 0 } else { config.refine.max_iterations };
    for _ in 0..iterations {
        let (mut h, g) = normal_equations(maps, members, poses, edges, held, scale);
        // Levenberg's damping, the same along both axes: a share of each axis' own information would
        // let a bare corridor, along which there is next to none, slide by any distance.
        for k in 0..n {
            let h = h.diagonal(k);
            let d = 1e-3 * h[(0, 0)].max(h[(1, 1)]) + 1e-6;
            h[(0, 0)] += d;
            h[(1, 1)] += d;
            h[(2, 2)] += 1e-3 * h[(2, 2)] + 1e-6;
        }
        let solved = match n {
            0..=MOST_DENSE => h.to_dense().cholesky().map(|c| c.solve(&g)),
            _ => Factor::of(&h).map(|c| c.solve(&g)),
        };
        let Some(solved) = solved else { break };
        let mut moved = 0.0f64;
        for (k, pose) in poses.iter_mut().enumerate() {
            let d = Vector3::new(solved[3 * k], solved[3 * k + 1], solved[3 * k + 2]);
            *pose = moved_by(&maps[members[k]], pose, &-d);
            moved = moved.max(d.xy().norm() + LEVER * d.z.abs());
        }
        if scale > narrow {
            scale = (0.7 * scale).max(narrow);
        } else if moved < still * resolution {
            break;
        }
    }
}

/// Covariances of refined poses relative to the members at the positions `held`.
pub fn uncertainty(
    maps: &[LocalMap],
    members: &[usize],
    poses: &[Se2],
    held: &[usize],
    known: &Known,
    config: &Config,
) -> Vec<Matrix3<f64>> {
    let edges = overlapping(maps, members, poses, known, config);
    let (resolution, narrow) = (resolution(maps, members), narrow(maps, members, config));
    let (h, _) = normal_equations(maps, members, poses, &edges, held, narrow);
    let pulls = tension(maps, members, poses, &edges, narrow).pulls;
    covariances(h, pulls, held, &arms(maps, members, poses), resolution, config)
}

/// A map that is moved and turned about its centre.
fn moved_by(map: &LocalMap, t_w_map: &Se2, d: &Vector3<f64>) -> Se2 {
    let turned = Se2::from_parts(Vec2::zeros(), t_w_map.theta + d.z);
    let center = edge::center(map, t_w_map) + d.xy();
    Se2::from_parts(center - turned.rotate(map.center.unwrap_or_default()), turned.theta)
}

/// From the centre of each map to the origin of its frame, in the world.
fn arms(maps: &[LocalMap], members: &[usize], poses: &[Se2]) -> Vec<Vec2> {
    let arm = |(m, t): (&usize, &Se2)| t.translation() - edge::center(&maps[*m], t);
    members.iter().zip(poses).map(arm).collect()
}

/// Information and gradient of all poses: of the edges, summed in their order. Some poses are held.
fn normal_equations(
    maps: &[LocalMap],
    members: &[usize],
    poses: &[Se2],
    edges: &[(usize, usize)],
    held: &[usize],
    scale: f64,
) -> (Blocks, DVector<f64>) {
    let n = members.len();
    let of_edges = parallel::map(edges, |(i, j)| {
        let edge = Edge::new([*i, *j].map(|k| (&maps[members[k]], &poses[k])));
        edge.normal_equations(scale)
    });
    let mut h = Blocks::zeros(n);
    let mut g = DVector::zeros(3 * n);
    for ((i, j), (of_h, of_g)) in edges.iter().zip(&of_edges) {
        add(&mut h, (*i, *j), of_h);
        for (p, x) in [(*i, 0), (*j, 3)] {
            let mut target = g.rows_mut(3 * p, 3);
            target += of_g.fixed_rows::<3>(x);
        }
    }
    h.set_apart(held, &Matrix3::identity());
    held.iter().for_each(|k| g.rows_mut(3 * k, 3).fill(0.0));
    (h, g)
}

/// How walls that were matched pull at the poses, and how far they lie apart.
struct Tension {
    /// Sum of `g g^T` over the patches of walls: how much their residuals pull, each on its own.
    pulls: Blocks,
    /// Sum of the squared residuals, each with its robust weight, square metres.
    squares: f64,
    weight: f64,
}

fn tension(
    maps: &[LocalMap],
    members: &[usize],
    poses: &[Se2],
    edges: &[(usize, usize)],
    scale: f64,
) -> Tension {
    let of_edges = parallel::map(edges, |(i, j)| {
        let edge = Edge::new([*i, *j].map(|k| (&maps[members[k]], &poses[k])));
        edge.tension(scale)
    });
    let mut sum = Tension { pulls: Blocks::zeros(members.len()), squares: 0.0, weight: 0.0 };
    for ((i, j), (pulls, squares, weight)) in edges.iter().zip(&of_edges) {
        add(&mut sum.pulls, (*i, *j), pulls);
        sum.squares += squares;
        sum.weight += weight;
    }
    sum
}

/// Adds what the two poses of an edge have to do with each other.
fn add(sum: &mut Blocks, (i, j): (usize, usize), of_both: &Matrix6<f64>) {
    for (p, x) in [(i, 0), (j, 3)] {
        for (q, y) in [(i, 0), (j, 3)] {
            sum.add(p, q, &of_both.fixed_view::<3, 3>(x, y).into_owned());
        }
    }
}

/// Covariances of the poses relative to those held, by how much the patches of walls pull against each other:
/// `H^-1 (sum of g_c g_c^T) H^-1` over the patches c (a cluster-robust covariance: Liang, Zeger, "Longitudinal data
/// analysis using generalized linear models", 1986). Samples of one wall err together, and a bent map's patches
/// each their own way: both show. On top comes what cells cannot tell.
fn covariances(
    mut information: Blocks,
    mut pulls: Blocks,
    held: &[usize],
    arms: &[Vec2],
    resolution: f64,
    config: &Config,
) -> Vec<Matrix3<f64>> {
    let (n, p) = (arms.len(), &config.perception);
    let sigma = FINEST * resolution;
    let discount = 0.5 * p.sample_spacing.max(resolution) / p.correlation_length;
    // What pulls: every wall from both sides, so twice; and the cells, as coarse as they are.
    for (at, block) in &mut pulls.at {
        *block *= 2.0;
        if let Some(h) = information.at.get(at) {
            *block += h * (sigma * sigma / discount);
        }
    }
    for k in (0..n).filter(|k| !held.contains(k)) {
        // A wide prior (10 m, 1 rad) keeps free directions finite, and large.
        let (information, pulls) = (information.diagonal(k), pulls.diagonal(k));
        for axis in 0..3 {
            let loose = sigma * sigma / discount * if axis == 2 { 1.0 } else { 0.01 };
            information[(axis, axis)] += loose;
            pulls[(axis, axis)] += loose * loose * if axis == 2 { 1.0 } else { 100.0 };
        }
    }
    information.set_apart(held, &Matrix3::identity());
    pulls.set_apart(held, &Matrix3::zeros());
    let wide = Matrix3::from_diagonal(&Vector3::new(100.0, 100.0, 1.0));
    let of_origin = |own: Matrix3<f64>, k: usize| se2::swung(&own, arms[k]);
    let all: Vec<usize> = (0..n).collect();
    if n > MOST_DENSE {
        let factor = Factor::of(&information);
        return parallel::map(&all, |k| match &factor {
            _ if held.contains(k) => Matrix3::zeros(),
            Some(factor) => of_origin(pulls.between(&factor.columns(*k)), *k),
            None => of_origin(wide, *k),
        });
    }
    let inverse = information.to_dense().cholesky().map(|c| c.inverse());
    let covariance = inverse.map(|inverse| &inverse * pulls.to_dense() * &inverse);
    let of_pose = |k: usize| match &covariance {
        _ if held.contains(&k) => Matrix3::zeros(),
        Some(all) => of_origin(all.fixed_view::<3, 3>(3 * k, 3 * k).into_owned(), k),
        None => of_origin(wide, k),
    };
    all.into_iter().map(of_pose).collect()
}
