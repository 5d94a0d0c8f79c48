//! Joint refinement of all poses of a component over all overlapping boundaries.
//!
//! Point-to-line residuals of every pair of maps that share walls, under a Geman-McClure kernel that
//! narrows from the field's reach to the walls' noise (graduated non-convexity; Yang, Antonante,
//! Tzoumas, Carlone, "Graduated non-convexity for robust spatial perception", 2020), solved by
//! Gauss-Newton for all poses at once. The anchor's pose stays where it is.

use crate::config::Config;
use crate::local_map::LocalMap;
use crate::parallel;
use crate::perception::likelihood;
use crate::registration::climb::robust_weight;
use crate::se2::{Rigid, Se2, Vec2};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

/// Poses after refinement.
#[derive(Debug, Clone)]
pub struct Refined {
    /// `T_world_map` of each map, in the order given.
    pub poses: Vec<Se2>,
    /// Covariance of each pose relative to the anchor, whose own is zero.
    pub covariances: Vec<Matrix3<f64>>,
    /// Root mean square of the matched walls' residuals, metres; none without a match.
    pub rms: Option<f64>,
    /// Pairs of positions in the list whose walls took part.
    pub edges: Vec<(usize, usize)>,
    /// Iterations taken.
    pub iterations: usize,
}

/// A pair's share of the normal equations, for the poses of its two maps.
#[derive(Clone)]
struct Block {
    h: nalgebra::Matrix6<f64>,
    g: nalgebra::Vector6<f64>,
    squares: f64,
    weight: f64,
}

/// Refines the poses of `members` (indices into `maps`); `members[anchor]` stays.
pub fn refine(
    maps: &[LocalMap],
    members: &[usize],
    poses: &[Se2],
    anchor: usize,
    config: &Config,
) -> Refined {
    let n = members.len();
    let mut poses = poses.to_vec();
    let edges = overlapping(maps, members, &poses, config);
    let resolution = members.iter().map(|m| maps[*m].grid.resolution()).fold(0.0, f64::max);
    let narrow = config.refine.kernel.unwrap_or(2.0 * resolution);
    let reach = members.iter().map(|m| maps[*m].reach()).fold(f64::INFINITY, f64::min);
    let mut scale = (0.5 * reach).max(narrow);
    let mut iterations = 0;
    while iterations < config.refine.max_iterations && !edges.is_empty() {
        iterations += 1;
        let (mut h, g, _, _) = normal_equations(maps, members, &poses, &edges, anchor, scale);
        // Levenberg's damping, the same along both axes: a share of each axis' own information would
        // let a bare corridor, along which there is next to none, slide by any distance.
        for k in (0..3 * n).step_by(3) {
            let d = 1e-3 * h[(k, k)].max(h[(k + 1, k + 1)]) + 1e-6;
            h[(k, k)] += d;
            h[(k + 1, k + 1)] += d;
            h[(k + 2, k + 2)] += 1e-3 * h[(k + 2, k + 2)] + 1e-6;
        }
        let Some(solved) = h.cholesky().map(|c| c.solve(&g)) else { break };
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
    let (h, _, squares, weight) = normal_equations(maps, members, &poses, &edges, anchor, narrow);
    let rms = (weight > 0.0).then(|| (squares / weight).sqrt());
    Refined {
        covariances: covariances(h, anchor, n, resolution, config),
        poses,
        rms,
        edges,
        iterations,
    }
}

/// Pairs of members whose walls agree at the given poses.
fn overlapping(
    maps: &[LocalMap],
    members: &[usize],
    poses: &[Se2],
    config: &Config,
) -> Vec<(usize, usize)> {
    let all: Vec<(usize, usize)> =
        (0..members.len()).flat_map(|i| (i + 1..members.len()).map(move |j| (i, j))).collect();
    let perception = config.perception.rigid();
    let keep = parallel::map(&all, |(i, j)| {
        let (a, b) = (&maps[members[*i]], &maps[members[*j]]);
        let stride = (b.samples.len() / 250).max(1);
        let e = likelihood::pair(a, b, &poses[*i].between(&poses[*j]), stride, &perception);
        e.log_likelihood > 0.0 && e.hits >= 2.0
    });
    all.into_iter().zip(keep).filter(|(_, k)| *k).map(|(e, _)| e).collect()
}

/// Normal equations of all edges, summed in the edges' order; the anchor's pose is held.
fn normal_equations(
    maps: &[LocalMap],
    members: &[usize],
    poses: &[Se2],
    edges: &[(usize, usize)],
    anchor: usize,
    scale: f64,
) -> (DMatrix<f64>, DVector<f64>, f64, f64) {
    let n = members.len();
    let blocks = parallel::map(edges, |(i, j)| {
        block(&maps[members[*i]], &maps[members[*j]], &poses[*i], &poses[*j], scale)
    });
    let (mut h, mut g) = (DMatrix::zeros(3 * n, 3 * n), DVector::zeros(3 * n));
    let (mut squares, mut weight) = (0.0, 0.0);
    for ((i, j), b) in edges.iter().zip(&blocks) {
        for (p, x) in [(*i, 0), (*j, 3)] {
            for (q, y) in [(*i, 0), (*j, 3)] {
                let mut target = h.view_mut((3 * p, 3 * q), (3, 3));
                target += b.h.fixed_view::<3, 3>(x, y);
            }
            let mut target = g.rows_mut(3 * p, 3);
            target += b.g.fixed_rows::<3>(x);
        }
        squares += b.squares;
        weight += b.weight;
    }
    h.rows_mut(3 * anchor, 3).fill(0.0);
    h.columns_mut(3 * anchor, 3).fill(0.0);
    h.view_mut((3 * anchor, 3 * anchor), (3, 3)).fill_diagonal(1.0);
    g.rows_mut(3 * anchor, 3).fill(0.0);
    (h, g, squares, weight)
}

/// Residuals of walls of b on walls of a, and the other way round, in the world frame.
fn block(a: &LocalMap, b: &LocalMap, t_w_a: &Se2, t_w_b: &Se2, scale: f64) -> Block {
    let mut out = Block {
        h: nalgebra::Matrix6::zeros(),
        g: nalgebra::Vector6::zeros(),
        squares: 0.0,
        weight: 0.0,
    };
    let (ra, rb) = (t_w_a.to_rigid(), t_w_b.to_rigid());
    // The wall turns with its own map, so both Jacobians are taken at the other map's point.
    let mut add = |point: Vec2, normal: Vec2, residual: f64, sign: f64| {
        let row = |t: Vec2| {
            let r = point - t;
            Vector3::new(normal.x, normal.y, normal.y * r.x - normal.x * r.y)
        };
        let mut j = nalgebra::Vector6::zeros();
        j.fixed_rows_mut::<3>(0).copy_from(&(-sign * row(t_w_a.translation())));
        j.fixed_rows_mut::<3>(3).copy_from(&(sign * row(t_w_b.translation())));
        let w = robust_weight(residual, scale);
        out.h += w * j * j.transpose();
        out.g += w * residual * j;
        out.squares += w * residual * residual;
        out.weight += w;
    };
    each_match(b, a, &t_w_a.between(t_w_b), &rb, &ra, |p, n, r| add(p, n, r, 1.0));
    each_match(a, b, &t_w_b.between(t_w_a), &ra, &rb, |p, n, r| add(p, n, r, -1.0));
    out
}

/// Samples of `from` that lie on like-oriented walls of `to`: world point, world normal, residual.
fn each_match(
    from: &LocalMap,
    to: &LocalMap,
    t_to_from: &Se2,
    t_w_from: &Rigid,
    t_w_to: &Rigid,
    mut f: impl FnMut(Vec2, Vec2, f64),
) {
    let view = to.field_view(t_to_from);
    for s in &from.samples {
        let Some(k) = view.cell(s.position).and_then(|c| view.nearest(c, s.normal)) else {
            continue;
        };
        let wall = &to.boundary[k];
        let point = t_w_from.apply(s.position);
        let normal = t_w_to.rotate(wall.normal);
        f(point, normal, (point - t_w_to.apply(wall.position)).dot(&normal));
    }
}

/// Covariances of the poses relative to the anchor: the blocks of the inverse information. Neighbouring
/// samples are correlated and every wall is matched from both sides, so the information is discounted.
fn covariances(
    mut h: DMatrix<f64>,
    anchor: usize,
    n: usize,
    resolution: f64,
    config: &Config,
) -> Vec<Matrix3<f64>> {
    let p = &config.perception;
    let sigma = p.wall_sigma.max(resolution);
    h *= 0.5 * p.sample_spacing.max(resolution) / p.correlation_length / (sigma * sigma);
    for k in (0..3 * n).filter(|k| k / 3 != anchor) {
        // A wide prior (10 m, 1 rad) keeps free directions finite, and large.
        h[(k, k)] += if k % 3 == 2 { 1.0 } else { 0.01 };
    }
    h.view_mut((3 * anchor, 3 * anchor), (3, 3)).fill_diagonal(1.0);
    let inverse = h.cholesky().map(|c| c.inverse());
    (0..n)
        .map(|k| match &inverse {
            _ if k == anchor => Matrix3::zeros(),
            Some(inverse) => inverse.fixed_view::<3, 3>(3 * k, 3 * k).into_owned(),
            None => Matrix3::from_diagonal(&Vector3::new(100.0, 100.0, 1.0)),
        })
        .collect()
}
