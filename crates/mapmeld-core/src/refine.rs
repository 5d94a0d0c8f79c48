//! Joint refinement of all poses of a component over all overlapping boundaries.
//!
//! Point-to-line residuals of every pair of maps that share walls, under a Geman-McClure kernel that
//! narrows from the field's reach to the walls' noise (graduated non-convexity; Yang, Antonante,
//! Tzoumas, Carlone, "Graduated non-convexity for robust spatial perception", 2020), solved by
//! Gauss-Newton for all poses at once. Poses that are held stay where they are.

use crate::config::Config;
use crate::local_map::{LocalMap, Patch};
use crate::parallel;
use crate::perception::likelihood;
use crate::registration::climb::robust_weight;
use crate::result::Known;
use crate::se2::{Rigid, Se2, Vec2};
use crate::sparse::{Blocks, Factor};
use crate::vicinity;
use nalgebra::{DVector, Matrix3, Matrix6, Vector3, Vector6};

/// Residuals up to about this count as pulling on the poses, metres, even where the kernel lets go of them.
const WIDE: f64 = 0.2;

/// Smallest standard deviation of a wall's distance, cells: that of rounding to cells in both maps.
const FINEST: f64 = 0.41;

/// Up to so many poses a dense factorisation is as fast.
const MOST_DENSE: usize = 64;

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

/// A pair's share of the normal equations, for the poses of its two maps.
#[derive(Clone)]
struct Block {
    h: Matrix6<f64>,
    g: Vector6<f64>,
    /// Sum of `g g^T` over the patches of walls: how much their residuals pull, each on its own.
    pulls: Matrix6<f64>,
    squares: f64,
    weight: f64,
}

/// The normal equations of all poses.
struct Normal {
    h: Blocks,
    g: DVector<f64>,
    pulls: Blocks,
    squares: f64,
    weight: f64,
}

/// Refines the poses of `members` (indices into `maps`); those at the positions `held` stay. Walls of forbidden
/// pairs do not pull at each other.
pub fn refine(
    maps: &[LocalMap],
    members: &[usize],
    poses: &[Se2],
    held: &[usize],
    known: &Known,
    config: &Config,
) -> Refined {
    let n = members.len();
    let mut poses = poses.to_vec();
    let edges = overlapping(maps, members, &poses, known, config);
    let resolution = members.iter().map(|m| maps[*m].grid.resolution()).fold(0.0, f64::max);
    let narrow =
        config.refine.kernel.unwrap_or((2.0 * resolution).max(config.perception.climb_sigma));
    let reach = members.iter().map(|m| maps[*m].reach()).fold(f64::INFINITY, f64::min);
    let mut scale = (0.5 * reach).max(narrow);
    let iterations = if edges.is_empty() { 0 } else { config.refine.max_iterations };
    for _ in 0..iterations {
        let Normal { mut h, g, .. } = normal_equations(maps, members, &poses, &edges, held, scale);
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
            *pose = pose.perturbed(&-d);
            moved = moved.max(d.xy().norm() + 5.0 * d.z.abs());
        }
        if scale > narrow {
            scale = (0.7 * scale).max(narrow);
        } else if moved < 0.01 * resolution {
            break;
        }
    }
    let normal = normal_equations(maps, members, &poses, &edges, held, narrow);
    let rms = (normal.weight > 0.0).then(|| (normal.squares / normal.weight).sqrt());
    Refined { covariances: covariances(normal, held, n, resolution, config), poses, rms }
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
    let resolution = members.iter().map(|m| maps[*m].grid.resolution()).fold(0.0, f64::max);
    let narrow =
        config.refine.kernel.unwrap_or((2.0 * resolution).max(config.perception.climb_sigma));
    let normal = normal_equations(maps, members, poses, &edges, held, narrow);
    covariances(normal, held, members.len(), resolution, config)
}

/// Samples of each map that tell whether two overlap.
const OVERLAP_SAMPLES: usize = 256;

/// Pairs of members whose walls agree at the given poses.
fn overlapping(
    maps: &[LocalMap],
    members: &[usize],
    poses: &[Se2],
    known: &Known,
    config: &Config,
) -> Vec<(usize, usize)> {
    let near = vicinity::pairs(maps, members, poses).into_iter();
    let all: Vec<(usize, usize)> =
        near.filter(|(i, j)| !known.is_forbidden(members[*i], members[*j])).collect();
    let perception = config.perception.rigid();
    let keep = parallel::map(&all, |(i, j)| {
        let (a, b) = (&maps[members[*i]], &maps[members[*j]]);
        let t_a_b = poses[*i].between(&poses[*j]);
        let e = likelihood::pair(a, b, &t_a_b, OVERLAP_SAMPLES, &perception);
        e.log_likelihood > 0.0 && e.hits >= 2.0
    });
    all.into_iter().zip(keep).filter(|(_, k)| *k).map(|(e, _)| e).collect()
}

/// Normal equations of all edges, summed in the edges' order; some poses are held.
fn normal_equations(
    maps: &[LocalMap],
    members: &[usize],
    poses: &[Se2],
    edges: &[(usize, usize)],
    held: &[usize],
    scale: f64,
) -> Normal {
    let n = members.len();
    let blocks = parallel::map(edges, |(i, j)| {
        block(&maps[members[*i]], &maps[members[*j]], &poses[*i], &poses[*j], scale)
    });
    let (mut h, mut pulls) = (Blocks::zeros(n), Blocks::zeros(n));
    let mut g = DVector::zeros(3 * n);
    let (mut squares, mut weight) = (0.0, 0.0);
    for ((i, j), b) in edges.iter().zip(&blocks) {
        for (p, x) in [(*i, 0), (*j, 3)] {
            for (q, y) in [(*i, 0), (*j, 3)] {
                h.add(p, q, &b.h.fixed_view::<3, 3>(x, y).into_owned());
                pulls.add(p, q, &b.pulls.fixed_view::<3, 3>(x, y).into_owned());
            }
            let mut target = g.rows_mut(3 * p, 3);
            target += b.g.fixed_rows::<3>(x);
        }
        squares += b.squares;
        weight += b.weight;
    }
    h.set_apart(held, &Matrix3::identity());
    held.iter().for_each(|k| g.rows_mut(3 * k, 3).fill(0.0));
    Normal { h, g, pulls, squares, weight }
}

/// Residuals of walls of b on walls of a, and the other way round, in the world frame.
fn block(a: &LocalMap, b: &LocalMap, t_w_a: &Se2, t_w_b: &Se2, scale: f64) -> Block {
    let (ra, rb) = (t_w_a.to_rigid(), t_w_b.to_rigid());
    // A wall turns with its own map, so both Jacobians are taken at the other map's point. That of a's pose is
    // `-(nx, ny, c)`, c the turn of the point about a; that of b's is the same as seen from b, which `to_b` makes of
    // it. So the sums are made of the former alone.
    let pivot = t_w_a.translation();
    let d = t_w_b.translation() - pivot;
    let to_b = Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, d.y, -d.x, 1.0);
    let (mut h, mut pulls) = (Matrix3::zeros(), Matrix3::zeros());
    let (mut g, mut squares, mut weight) = (Vector3::zeros(), 0.0, 0.0);
    let mut of_map = |from: &LocalMap,
                      to: &LocalMap,
                      t_to_from: Se2,
                      frames: (&Rigid, &Rigid),
                      sign: f64| {
        let to_axes = to.grid.origin().inverse().compose(&t_to_from).to_rigid();
        let is_near = |p: &&Patch| to.reaches(to_axes.apply(p.center), p.radius);
        for patch in from.patches.iter().filter(is_near) {
            let mut pull = Vector3::zeros();
            each_match(from, &patch.samples, to, &t_to_from, frames, |point, normal, residual| {
                let r = point - pivot;
                let j = Vector3::new(normal.x, normal.y, normal.y * r.x - normal.x * r.y);
                let w = robust_weight(residual, scale);
                let wj = w * j;
                h += wj * j.transpose();
                g += (sign * residual) * wj;
                pull += robust_weight(residual, scale.max(WIDE)) * residual * j;
                squares += w * residual * residual;
                weight += w;
            });
            pulls += pull * pull.transpose();
        }
    };
    of_map(b, a, t_w_a.between(t_w_b), (&rb, &ra), 1.0);
    of_map(a, b, t_w_b.between(t_w_a), (&ra, &rb), -1.0);
    let of_both = |own: Matrix3<f64>| {
        let mut both = Matrix6::zeros();
        let across = -own * to_b.transpose();
        both.fixed_view_mut::<3, 3>(0, 0).copy_from(&own);
        both.fixed_view_mut::<3, 3>(0, 3).copy_from(&across);
        both.fixed_view_mut::<3, 3>(3, 0).copy_from(&across.transpose());
        both.fixed_view_mut::<3, 3>(3, 3).copy_from(&(to_b * own * to_b.transpose()));
        both
    };
    let mut of_poses = Vector6::zeros();
    of_poses.fixed_rows_mut::<3>(0).copy_from(&-g);
    of_poses.fixed_rows_mut::<3>(3).copy_from(&(to_b * g));
    Block { h: of_both(h), g: of_poses, pulls: of_both(pulls), squares, weight }
}

/// Those of some samples of `from` that lie on like-oriented walls of `to`: world point, world normal,
/// residual. `frames` are the poses of both in the world.
fn each_match(
    from: &LocalMap,
    samples: &[u32],
    to: &LocalMap,
    t_to_from: &Se2,
    (t_w_from, t_w_to): (&Rigid, &Rigid),
    mut f: impl FnMut(Vec2, Vec2, f64),
) {
    let view = to.field_view(t_to_from);
    for s in samples.iter().map(|k| &from.samples[*k as usize]) {
        let Some(k) = view.nearest(s.position, s.normal) else {
            continue;
        };
        let wall = &to.boundary[k];
        let point = t_w_from.apply(s.position);
        let normal = t_w_to.rotate(wall.normal);
        f(point, normal, (point - t_w_to.apply(wall.position)).dot(&normal));
    }
}

/// Covariances of the poses relative to those held, by how much the patches of walls pull against each other:
/// `H^-1 (sum of g_c g_c^T) H^-1` over the patches c (a cluster-robust covariance: Liang, Zeger, "Longitudinal data
/// analysis using generalized linear models", 1986). Samples of one wall err together, and a bent map's patches
/// each their own way: both show. On top comes what cells cannot tell.
fn covariances(
    normal: Normal,
    held: &[usize],
    n: usize,
    resolution: f64,
    config: &Config,
) -> Vec<Matrix3<f64>> {
    let p = &config.perception;
    let sigma = FINEST * resolution;
    let discount = 0.5 * p.sample_spacing.max(resolution) / p.correlation_length;
    // What pulls: every wall from both sides, so twice; and the cells, as coarse as they are.
    let mut pulls = normal.pulls;
    for (at, block) in &mut pulls.at {
        *block *= 2.0;
        if let Some(h) = normal.h.at.get(at) {
            *block += h * (sigma * sigma / discount);
        }
    }
    let mut information = normal.h;
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
    let even = |own: Matrix3<f64>| 0.5 * (own + own.transpose());
    let all: Vec<usize> = (0..n).collect();
    if n > MOST_DENSE {
        let factor = Factor::of(&information);
        return parallel::map(&all, |k| match &factor {
            _ if held.contains(k) => Matrix3::zeros(),
            Some(factor) => even(pulls.between(&factor.columns(*k))),
            None => wide,
        });
    }
    let inverse = information.to_dense().cholesky().map(|c| c.inverse());
    let covariance = inverse.map(|inverse| &inverse * pulls.to_dense() * &inverse);
    let of_pose = |k: usize| match &covariance {
        _ if held.contains(&k) => Matrix3::zeros(),
        Some(all) => even(all.fixed_view::<3, 3>(3 * k, 3 * k).into_owned()),
        None => wide,
    };
    all.into_iter().map(of_pose).collect()
}
