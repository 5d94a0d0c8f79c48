//! The rigid transform between matched points in closed form (paper, section 3; Umeyama, "Least-squares
//! estimation of transformation parameters between two point patterns", 1991, without the scale).

use crate::se2::{Se2, Vec2};

/// `T_a_b` that minimises `sum w |p_a - T p_b|^2`; none when the points leave the rotation open.
pub fn rigid_transform(points: &[(Vec2, Vec2, f64)]) -> Option<Se2> {
    let total: f64 = points.iter().map(|(_, _, w)| w).sum();
    if total <= 0.0 {
        return None;
    }
    let mean_a = points.iter().map(|(a, _, w)| a * *w).sum::<Vec2>() / total;
    let mean_b = points.iter().map(|(_, b, w)| b * *w).sum::<Vec2>() / total;
    let (mut cross, mut dot) = (0.0, 0.0);
    for (a, b, w) in points {
        let (da, db) = (a - mean_a, b - mean_b);
        cross += w * (db.x * da.y - db.y * da.x);
        dot += w * db.dot(&da);
    }
    if cross.hypot(dot) < 1e-12 {
        return None;
    }
    let theta = cross.atan2(dot);
    let turned = Se2::new(0.0, 0.0, theta).apply(mean_b);
    Some(Se2::from_parts(mean_a - turned, theta))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn recovers_the_transform(
            x in -50.0..50.0f64, y in -50.0..50.0f64, theta in -3.1..3.1f64,
            points in prop::collection::vec((-20.0..20.0f64, -20.0..20.0f64, 0.1..5.0f64), 2..8),
        ) {
            let t = Se2::new(x, y, theta);
            let matched: Vec<_> = points.iter()
                .map(|(x, y, w)| (t.apply(Vec2::new(*x, *y)), Vec2::new(*x, *y), *w)).collect();
            let spread = points.iter().any(|p| (p.0 - points[0].0).hypot(p.1 - points[0].1) > 0.1);
            prop_assume!(spread);
            let got = rigid_transform(&matched).unwrap();
            prop_assert!(got.minus(&t).norm() < 1e-7, "{got:?} {t:?}");
        }
    }

    #[test]
    fn one_point_leaves_the_rotation_open() {
        assert!(rigid_transform(&[(Vec2::new(1.0, 2.0), Vec2::new(0.0, 0.0), 1.0)]).is_none());
        assert!(rigid_transform(&[]).is_none());
    }
}
