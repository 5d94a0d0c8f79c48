//! Where a person says that two maps lie to each other: a point of one is a point of the other.
//!
//! It is evidence of the pose like a prior: the density of a pose under it, against the even density over all poses
//! at which two maps can overlap, is Bayes' factor for the verdict on the walls.

use crate::cluster::Cluster;
use crate::error::{Error, Result};
use crate::prior::{self, Fit, Prior, CONTRADICTS, WALLS};
use crate::result::Known;
use crate::se2::{wrap, Se2, Vec2};
use nalgebra::{Matrix2, Matrix3, Vector3};
use std::f64::consts::TAU;

/// A Gaussian over `T_a_b` around a point, which it takes to a point.
#[derive(Debug, Clone, PartialEq)]
pub struct Relation {
    /// Index of map a.
    pub a: usize,
    /// Index of map b.
    pub b: usize,
    /// The point in map a, metres.
    pub in_a: Vec2,
    /// The same point in map b.
    pub in_b: Vec2,
    /// Standard deviation of the distance between the two along each axis, metres.
    pub sigma: f64,
    /// The heading of b in a and its standard deviation, radians; none when it is not known.
    pub heading: Option<(f64, f64)>,
}

impl Relation {
    /// As told of some map against another one, whichever comes first; none when it is about others.
    pub fn between(&self, from: usize, to: usize) -> Option<Relation> {
        match (self.a == from && self.b == to, self.a == to && self.b == from) {
            (true, _) => Some(self.clone()),
            (_, true) => Some(Relation {
                a: from,
                b: to,
                in_a: self.in_b,
                in_b: self.in_a,
                sigma: self.sigma,
                heading: self.heading.map(|(theta, sigma)| (-theta, sigma)),
            }),
            _ => None,
        }
    }

    /// As told of the frames `a` and `b` that the maps lie in.
    pub fn of_frames(&self, a: (usize, &Se2), b: (usize, &Se2)) -> Relation {
        Relation {
            a: a.0,
            b: b.0,
            in_a: a.1.apply(self.in_a),
            in_b: b.1.apply(self.in_b),
            sigma: self.sigma,
            heading: self.heading.map(|(t, s)| (wrap(a.1.theta + t - b.1.theta), s)),
        }
    }

    /// The likeliest `T_a_b`; none when the heading is not known.
    pub fn t_a_b(&self) -> Option<Se2> {
        let (theta, _) = self.heading?;
        let turned = Se2::new(0.0, 0.0, theta).rotate(self.in_b);
        Some(Se2::from_parts(self.in_a - turned, theta))
    }

    /// The same as a Gaussian over `T_a_b` at its origin.
    pub fn prior(&self) -> Option<Prior> {
        let (t_a_b, (_, heading)) = (self.t_a_b()?, self.heading?);
        let back = lever(&t_a_b, self.in_b).try_inverse()?;
        let variances = Vector3::new(self.sigma, self.sigma, heading).map(|s| s * s);
        let covariance = back * Matrix3::from_diagonal(&variances) * back.transpose();
        Some(Prior { t_world_map: t_a_b, covariance, is_pinned: false })
    }

    /// How well a pose fits; none when it contradicts. `log_volume` is that of the search volume.
    pub fn fit(&self, t_a_b: &Se2, covariance: &Matrix3<f64>, log_volume: f64) -> Option<Fit> {
        let j = lever(t_a_b, self.in_b);
        let (metres, radians) = WALLS;
        let walls = Vector3::new(metres, metres, radians).map(|s| s * s);
        let seen = j * covariance * j.transpose() + Matrix3::from_diagonal(&walls);
        let off = self.in_a - t_a_b.apply(self.in_b);
        let own = self.sigma * self.sigma;
        let (squared, log_density, gain) = match self.heading {
            Some((theta, sigma)) => {
                let total = seen + Matrix3::from_diagonal(&Vector3::new(own, own, sigma * sigma));
                let inverse = total.try_inverse()?;
                let r = Vector3::new(off.x, off.y, wrap(theta - t_a_b.theta));
                let squared = r.dot(&(inverse * r));
                let log_density = -0.5 * (squared + 3.0 * TAU.ln() + total.determinant().ln());
                (squared, log_density, covariance * j.transpose() * (inverse * r))
            }
            // Any heading is as good as another.
            None => {
                let total: Matrix2<f64> =
                    seen.fixed_view::<2, 2>(0, 0) + Matrix2::from_diagonal_element(own);
                let inverse = total.try_inverse()?;
                let squared = off.dot(&(inverse * off));
                let log_density = -0.5 * (squared + 2.0 * TAU.ln() + total.determinant().ln());
                let j = j.fixed_rows::<2>(0);
                (squared, log_density - TAU.ln(), covariance * j.transpose() * (inverse * off))
            }
        };
        (squared <= CONTRADICTS)
            .then(|| Fit { log_odds: log_density + log_volume, pose: t_a_b.perturbed(&gain) })
    }
}

/// How a point of b, and the heading, move in a with `T_a_b`.
fn lever(t_a_b: &Se2, in_b: Vec2) -> Matrix3<f64> {
    let arm = t_a_b.rotate(in_b);
    Matrix3::new(1.0, 0.0, -arm.y, 0.0, 1.0, arm.x, 0.0, 0.0, 1.0)
}

/// What is told of the maps of some clusters, as told of the clusters: by their indices, in their frames.
pub fn of_clusters(clusters: &[Cluster], relations: &[Relation]) -> Vec<Relation> {
    let place = |map: usize| {
        let at = |(k, c): (usize, &Cluster)| Some((k, c.pose(map)?));
        clusters.iter().enumerate().find_map(at)
    };
    let across = relations.iter().filter_map(|r| {
        let ((a, t_a), (b, t_b)) = (place(r.a)?, place(r.b)?);
        (a != b).then(|| r.of_frames((a, &t_a), (b, &t_b)))
    });
    across.collect()
}

/// Clusters that no wall joins, as one where a relation tells how they lie; a world that priors give tells more.
pub fn tied(clusters: Vec<Cluster>, known: &Known) -> Vec<Cluster> {
    let mut relations = of_clusters(&clusters, &known.relations);
    relations.sort_by(|x, y| x.sigma.total_cmp(&y.sigma));
    let is_in_world = |k: usize| !clusters[k].with_priors(&known.priors).is_empty();
    relations.retain(|r| r.heading.is_some() && !(is_in_world(r.a) && is_in_world(r.b)));
    let mut order: Vec<usize> = (0..clusters.len()).collect();
    order.sort_by_key(|k| (!is_in_world(*k), std::cmp::Reverse(clusters[*k].members.len())));

    let mut taken = vec![false; clusters.len()];
    let mut out = Vec::new();
    for root in order {
        if std::mem::replace(&mut taken[root], true) {
            continue;
        }
        let here =
            Prior { t_world_map: Se2::IDENTITY, covariance: Matrix3::zeros(), is_pinned: false };
        let mut group = vec![(clusters[root].clone(), here)];
        let mut reached = vec![root];
        let mut next = 0;
        while next < reached.len() {
            let (from, frame) = (reached[next], group[next].1.clone());
            next += 1;
            for to in 0..clusters.len() {
                let told = || relations.iter().find_map(|r| r.between(from, to)?.prior());
                let Some(prior) = (!taken[to]).then(told).flatten() else { continue };
                let (t, covariance) = frame.place(&prior.t_world_map, &prior.covariance);
                group.push((
                    clusters[to].clone(),
                    Prior { t_world_map: t, covariance, is_pinned: false },
                ));
                taken[to] = true;
                reached.push(to);
            }
        }
        out.push(match group.len() {
            1 => group.swap_remove(0).0,
            _ => prior::gathered(&group, &[]),
        });
    }
    out
}

/// Whether relations and forbidden pairs are of maps that there are, `n` of them, and do not contradict each other.
pub fn check(known: &Known, n: usize) -> Result<()> {
    let fail = |key: &str, problem: String| Err(Error::Config { key: key.into(), problem });
    for (key, a, b) in known
        .relations
        .iter()
        .map(|r| ("relations", r.a, r.b))
        .chain(known.forbidden.iter().map(|(a, b)| ("forbidden", *a, *b)))
    {
        if a.max(b) >= n {
            return fail(key, format!("index {} of {n} maps", a.max(b)));
        }
        if a == b {
            return fail(key, format!("map {a} and itself"));
        }
    }
    if let Some(r) = known.relations.iter().find(|r| known.is_forbidden(r.a, r.b)) {
        return fail("relations", format!("maps {} and {} are forbidden", r.a, r.b));
    }
    let is_deviation = |s: f64| s.is_finite() && s > 0.0;
    let is_whole = |r: &Relation| {
        is_deviation(r.sigma)
            && r.heading.is_none_or(|(theta, s)| theta.is_finite() && is_deviation(s))
            && [r.in_a, r.in_b].iter().all(|p| p.x.is_finite() && p.y.is_finite())
    };
    if !known.relations.iter().all(is_whole) {
        return fail("relations", "standard deviations must be positive, all else finite".into());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    fn relation(heading: Option<(f64, f64)>) -> Relation {
        let (in_a, in_b) = (Vec2::new(3.0, 1.0), Vec2::new(-2.0, 5.0));
        Relation { a: 0, b: 1, in_a, in_b, sigma: 0.2, heading }
    }

    #[test]
    fn the_likeliest_pose_takes_the_point_to_the_point_from_either_side() {
        let r = relation(Some((0.7, 0.05)));
        let t = r.t_a_b().unwrap();
        assert_relative_eq!((t.apply(r.in_b) - r.in_a).norm(), 0.0, epsilon = 1e-12);
        let back = r.between(1, 0).unwrap().t_a_b().unwrap();
        assert_relative_eq!(back.minus(&t.inverse()).norm(), 0.0, epsilon = 1e-12);
        assert!(r.between(0, 2).is_none());
    }

    #[test]
    fn frames_change_nothing_of_what_is_told() {
        let r = relation(Some((0.7, 0.05)));
        let (x_a, x_b) = (Se2::new(4.0, -1.0, 2.0), Se2::new(-3.0, 0.5, -1.1));
        let told = r.of_frames((0, &x_a), (1, &x_b)).t_a_b().unwrap();
        let expected = x_a.compose(&r.t_a_b().unwrap()).compose(&x_b.inverse());
        assert_relative_eq!(told.minus(&expected).norm(), 0.0, epsilon = 1e-12);
    }

    #[test]
    fn a_pose_is_weighed_at_the_point_and_contradicts_four_deviations_off() {
        let (r, exact) = (relation(Some((0.7, 0.05))), Matrix3::from_diagonal_element(1e-9));
        let t = r.t_a_b().unwrap();
        let peak = 9.0 - 1.5 * TAU.ln() - (0.2f64 * 0.2 * 0.05).ln();
        let best = r.fit(&t, &exact, 9.0).unwrap().log_odds;
        // What walls leave open widens it a little.
        assert!((best - peak).abs() < 0.1, "{best} against {peak}");
        assert!(r.fit(&t.perturbed(&Vector3::new(0.9, 0.0, 0.0)), &exact, 9.0).is_none());
        assert!(r.fit(&t.perturbed(&Vector3::new(0.3, 0.0, 0.0)), &exact, 9.0).is_some());
        // Turned about the point, not about the origin, which is five metres off.
        let turned = Relation { heading: Some((0.75, 0.05)), ..r.clone() }.t_a_b().unwrap();
        assert!((turned.translation() - t.translation()).norm() > 0.2);
        let fit = r.fit(&turned, &exact, 9.0).unwrap().log_odds;
        assert_relative_eq!(best - fit, 0.5, max_relative = 0.1);
    }

    #[test]
    fn one_point_leaves_the_heading_free() {
        let (r, exact) = (relation(None), Matrix3::from_diagonal_element(1e-9));
        assert!(r.t_a_b().is_none() && r.prior().is_none());
        let at = |theta: f64| {
            let t = Relation { heading: Some((theta, 1.0)), ..r.clone() }.t_a_b().unwrap();
            r.fit(&t, &exact, 9.0).unwrap().log_odds
        };
        assert_relative_eq!(at(0.3), at(-2.0), epsilon = 1e-9);
    }

    #[test]
    fn the_gaussian_at_the_origin_is_the_one_at_the_point() {
        let p = relation(Some((0.7, 0.05))).prior().unwrap();
        let j = lever(&p.t_world_map, relation(None).in_b);
        let at_point = j * p.covariance * j.transpose();
        let expected = Vector3::new(0.04, 0.04, 0.0025);
        assert_relative_eq!(at_point, Matrix3::from_diagonal(&expected), epsilon = 1e-12);
    }
}
