//! Rigid transforms of the plane, SE(2).
//!
//! Convention: `T_a_b` takes coordinates of frame b to frame a, `p_a = T_a_b * p_b`.
//! Perturbations and covariances are in the *left* tangent space at the transform's own
//! translation: `(dx, dy, dtheta)` means "move by (dx, dy) in frame a and turn by dtheta about the
//! transform's origin". That is what a person reads as a covariance of (x, y, theta).

use nalgebra::{Matrix3, Vector2, Vector3};
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// A point or direction of the plane, metres.
pub type Vec2 = Vector2<f64>;

/// The angle in (-pi, pi].
pub fn wrap(angle: f64) -> f64 {
    // Mostly so; to round is a call of the mathematical library.
    if angle > -PI && angle <= PI {
        return angle;
    }
    let a = angle - TAU * (angle / TAU).round();
    if a <= -PI {
        a + TAU
    } else {
        a
    }
}

/// A rigid transform of the plane: a rotation by `theta` (radians), then a translation (metres).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Se2 {
    /// Translation along x, metres.
    pub x: f64,
    /// Translation along y, metres.
    pub y: f64,
    /// Rotation, radians, in (-pi, pi].
    pub theta: f64,
}

impl Se2 {
    /// The identity. It never stands for failure.
    pub const IDENTITY: Se2 = Se2 { x: 0.0, y: 0.0, theta: 0.0 };

    /// From x, y (metres) and theta (radians, any turn).
    pub fn new(x: f64, y: f64, theta: f64) -> Self {
        Self { x, y, theta: wrap(theta) }
    }

    /// From a rotation and the translation that follows it.
    pub fn from_parts(t: Vec2, theta: f64) -> Self {
        Self::new(t.x, t.y, theta)
    }

    /// The translation, metres.
    pub fn translation(&self) -> Vec2 {
        Vec2::new(self.x, self.y)
    }

    /// A map-ready form with the sine and cosine worked out once.
    pub fn to_rigid(&self) -> Rigid {
        let (s, c) = self.theta.sin_cos();
        Rigid { c, s, x: self.x, y: self.y }
    }

    /// `p_a` of `p_b`.
    pub fn apply(&self, p: Vec2) -> Vec2 {
        self.to_rigid().apply(p)
    }

    /// The direction `v` turned by theta.
    pub fn rotate(&self, v: Vec2) -> Vec2 {
        self.to_rigid().rotate(v)
    }

    /// `T_a_c = T_a_b * T_b_c`.
    pub fn compose(&self, other: &Se2) -> Se2 {
        let t = self.apply(other.translation());
        Se2::new(t.x, t.y, self.theta + other.theta)
    }

    /// `T_b_a` of `T_a_b`.
    pub fn inverse(&self) -> Se2 {
        let (s, c) = self.theta.sin_cos();
        Se2::new(-(c * self.x + s * self.y), s * self.x - c * self.y, -self.theta)
    }

    /// `T_b_c` of `T_a_b` (self) and `T_a_c`.
    pub fn between(&self, other: &Se2) -> Se2 {
        self.inverse().compose(other)
    }

    /// Exponential map of the twist `(vx, vy, omega)` (metres, metres, radians).
    pub fn exp(twist: &Vector3<f64>) -> Se2 {
        let w = twist.z;
        // sin(w)/w and (1-cos(w))/w, by series where the quotient loses digits.
        let (a, b) = if w.abs() < 1e-6 {
            (1.0 - w * w / 6.0, w / 2.0 - w * w * w / 24.0)
        } else {
            (w.sin() / w, (1.0 - w.cos()) / w)
        };
        Se2::new(a * twist.x - b * twist.y, b * twist.x + a * twist.y, w)
    }

    /// Logarithm: the twist whose exponential is this transform, theta in (-pi, pi].
    pub fn log(&self) -> Vector3<f64> {
        let w = self.theta;
        let half = w / 2.0;
        // (w/2) / tan(w/2), by series near zero.
        let k = if w.abs() < 1e-6 { 1.0 - w * w / 12.0 } else { half / half.tan() };
        Vector3::new(k * self.x + half * self.y, -half * self.x + k * self.y, w)
    }

    /// Moves the transform by `(dx, dy)` in frame a and turns it by `dtheta` about its own origin.
    pub fn perturbed(&self, d: &Vector3<f64>) -> Se2 {
        Se2::new(self.x + d.x, self.y + d.y, self.theta + d.z)
    }

    /// The perturbation that takes `other` to `self`, see [`Se2::perturbed`].
    pub fn minus(&self, other: &Se2) -> Vector3<f64> {
        Vector3::new(self.x - other.x, self.y - other.y, wrap(self.theta - other.theta))
    }

    /// Covariance of `T_w_a * T_a_b` from that of `T_a_b`, with `T_w_a` (self) exact.
    pub fn transport_covariance(&self, cov_a_b: &Matrix3<f64>) -> Matrix3<f64> {
        let (s, c) = self.theta.sin_cos();
        let r = Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0);
        r * cov_a_b * r.transpose()
    }

    /// Covariance of `T_b_a` from that of `T_a_b` (self).
    pub fn inverse_covariance(&self, cov_a_b: &Matrix3<f64>) -> Matrix3<f64> {
        let inv = self.inverse();
        let (s, c) = inv.theta.sin_cos();
        // t_inv = -R^T t: d t_inv = -R^T dt - d(R^T)/dtheta t dtheta.
        let j = Matrix3::new(-c, s, inv.y, -s, -c, -inv.x, 0.0, 0.0, -1.0);
        j * cov_a_b * j.transpose()
    }

    /// True when the two differ by less than `distance` metres at `at` (a point of frame b) and by
    /// less than `angle` radians.
    pub fn is_close_at(&self, other: &Se2, at: Vec2, distance: f64, angle: f64) -> bool {
        wrap(self.theta - other.theta).abs() <= angle
            && (self.apply(at) - other.apply(at)).norm() <= distance
    }

    /// As `[x, y, theta]`.
    pub fn to_array(&self) -> [f64; 3] {
        [self.x, self.y, self.theta]
    }
}

impl From<[f64; 3]> for Se2 {
    fn from(v: [f64; 3]) -> Self {
        Se2::new(v[0], v[1], v[2])
    }
}

/// An [`Se2`] with its sine and cosine at hand, for inner loops.
#[derive(Debug, Clone, Copy)]
pub struct Rigid {
    c: f64,
    s: f64,
    x: f64,
    y: f64,
}

impl Rigid {
    /// From the translation, and the sine and cosine of the angle.
    pub fn from_parts(t: Vec2, (s, c): (f64, f64)) -> Self {
        Self { c, s, x: t.x, y: t.y }
    }

    /// Sine and cosine of its angle.
    pub fn sin_cos(&self) -> (f64, f64) {
        (self.s, self.c)
    }

    /// Its translation, metres.
    pub fn translation(&self) -> Vec2 {
        Vec2::new(self.x, self.y)
    }

    /// As [`Se2::compose`].
    pub fn compose(&self, other: &Rigid) -> Rigid {
        let t = self.apply(other.translation());
        let (s, c) = (self.s * other.c + self.c * other.s, self.c * other.c - self.s * other.s);
        Self::from_parts(t, (s, c))
    }

    /// `p_a` of `p_b`.
    #[inline(always)]
    pub fn apply(&self, p: Vec2) -> Vec2 {
        Vec2::new(self.c * p.x - self.s * p.y + self.x, self.s * p.x + self.c * p.y + self.y)
    }

    /// The direction `v` turned.
    #[inline(always)]
    pub fn rotate(&self, v: Vec2) -> Vec2 {
        Vec2::new(self.c * v.x - self.s * v.y, self.s * v.x + self.c * v.y)
    }
}

/// Covariance of the pose of a frame whose origin lies at the end of an arm, from that of a frame, turned alike, at its
/// beginning: a turn swings it.
pub fn swung(covariance: &Matrix3<f64>, arm: Vec2) -> Matrix3<f64> {
    let j = Matrix3::new(1.0, 0.0, -arm.y, 0.0, 1.0, arm.x, 0.0, 0.0, 1.0);
    let swung = j * covariance * j.transpose();
    0.5 * (swung + swung.transpose())
}

/// Weighted mean of transforms that lie close together: the fixed point of the average perturbation.
/// Weights must be non-negative with a positive sum.
pub fn mean(transforms: &[Se2], weights: &[f64]) -> Se2 {
    let total: f64 = weights.iter().sum();
    let mut m = transforms[0];
    for _ in 0..10 {
        let d: Vector3<f64> =
            transforms.iter().zip(weights).map(|(t, w)| t.minus(&m) * (w / total)).sum();
        m = m.perturbed(&d);
        if d.norm() < 1e-12 {
            break;
        }
    }
    m
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    /// Elements near zero, near pi, far out: where implementations break.
    fn nasty() -> Vec<Se2> {
        let angles = [0.0, 1e-12, -1e-7, 1e-3, 0.5, PI / 2.0, PI - 1e-7, -PI + 1e-9, PI, 3.0, -2.0];
        let shifts = [(0.0, 0.0), (1e-9, -1e-9), (1.0, 2.0), (-300.0, 41.5)];
        angles.iter().flat_map(|a| shifts.iter().map(move |(x, y)| Se2::new(*x, *y, *a))).collect()
    }

    fn assert_same(a: &Se2, b: &Se2) {
        assert_relative_eq!(a.x, b.x, epsilon = 1e-6, max_relative = 1e-9);
        assert_relative_eq!(a.y, b.y, epsilon = 1e-6, max_relative = 1e-9);
        assert!(wrap(a.theta - b.theta).abs() < 1e-8, "{a:?} {b:?}");
    }

    #[test]
    fn rigid_transforms_compose_as_others_do() {
        let (a, b) = (Se2::new(1.0, -2.0, 2.5), Se2::new(0.3, 0.7, 1.9));
        let (got, expected) = (a.to_rigid().compose(&b.to_rigid()), a.compose(&b));
        assert!((got.translation() - expected.translation()).norm() < 1e-12);
        let (s, c) = got.sin_cos();
        assert!((wrap(s.atan2(c) - expected.theta)).abs() < 1e-12);
    }

    #[test]
    fn group_laws() {
        for a in nasty() {
            assert_same(&a.compose(&a.inverse()), &Se2::IDENTITY);
            assert_same(&Se2::exp(&a.log()), &a);
            for b in nasty() {
                assert_same(&a.compose(&a.between(&b)), &b);
                let p = Vec2::new(3.0, -4.0);
                assert_relative_eq!(a.compose(&b).apply(p), a.apply(b.apply(p)), epsilon = 1e-8);
            }
        }
    }

    #[test]
    fn covariances_match_finite_differences() {
        let cov = Matrix3::new(0.04, 0.01, 0.002, 0.01, 0.09, -0.003, 0.002, -0.003, 0.01);
        for a in nasty() {
            // d(inverse)/d(perturbation) by central differences.
            let mut j = Matrix3::zeros();
            for k in 0..3 {
                let mut d = Vector3::zeros();
                d[k] = 1e-5;
                let diff = a.perturbed(&d).inverse().minus(&a.perturbed(&-d).inverse()) / 2e-5;
                j.set_column(k, &diff);
            }
            let expected = j * cov * j.transpose();
            assert_relative_eq!(
                a.inverse_covariance(&cov),
                expected,
                epsilon = 1e-6,
                max_relative = 1e-4
            );
        }
    }

    #[test]
    fn a_frame_that_is_held_at_a_point_swings_about_it() {
        let cov = Matrix3::new(0.04, 0.01, 0.002, 0.01, 0.09, -0.003, 0.002, -0.003, 0.01);
        for t in nasty() {
            // The arm turns with the frame.
            let arm = Vec2::new(30.0, -8.0);
            let origin = |d: &Vector3<f64>| {
                let turned = Se2::new(0.0, 0.0, d.z).rotate(arm);
                Se2::from_parts(t.translation() + d.xy() + turned, t.theta + d.z)
            };
            let mut j = Matrix3::zeros();
            for k in 0..3 {
                let mut d = Vector3::zeros();
                d[k] = 1e-5;
                j.set_column(k, &(origin(&d).minus(&origin(&-d)) / 2e-5));
            }
            let expected = j * cov * j.transpose();
            assert_relative_eq!(swung(&cov, arm), expected, epsilon = 1e-6, max_relative = 1e-4);
        }
    }

    #[test]
    fn mean_of_symmetric_pair_is_the_centre_even_across_pi() {
        let m = mean(&[Se2::new(0.0, 0.0, PI - 0.1), Se2::new(2.0, 4.0, -PI + 0.1)], &[1.0, 1.0]);
        assert_same(&m, &Se2::new(1.0, 2.0, PI));
    }
}
