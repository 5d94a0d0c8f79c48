//! What is known of maps' poses in one world before any wall is compared: evidence like any other.
//!
//! Maps placed in one frame tell, by their priors, where that frame lies in the world. A pose of one more map is
//! weighed by the density of its own prior there, against the even density over all poses at which two maps can
//! overlap: Bayes' rule for the verdict on its walls.

use crate::cluster::{Cluster, MAX_WORLDS};
use crate::evidence::World;
use crate::se2::{Se2, Vec2};
use crate::verdict::Verdict;
use nalgebra::{Matrix3, Vector3};
use std::f64::consts::TAU;

/// Squared Mahalanobis distance beyond which a pose contradicts a prior: four standard deviations.
pub(crate) const CONTRADICTS: f64 = 16.0;
/// How exact poses that walls find are taken to be at best, metres and radians.
pub(crate) const WALLS: (f64, f64) = (0.05, 0.01);
/// Standard deviation of a pinned pose, metres and radians.
const PINNED: f64 = 1e-6;

/// A Gaussian over `T_world_map`.
#[derive(Debug, Clone, PartialEq)]
pub struct Prior {
    /// Its mean.
    pub t_world_map: Se2,
    /// Its covariance.
    pub covariance: Matrix3<f64>,
    /// Whether the pose is exact, whatever the walls say.
    pub is_pinned: bool,
}

/// How well a pose fits a prior.
#[derive(Debug, Clone, Copy)]
pub struct Fit {
    /// Log of the prior's density there over the even density over the search volume, nats.
    pub log_odds: f64,
    /// The pose, drawn to the prior as far as the walls leave it free.
    pub pose: Se2,
}

impl Prior {
    /// With standard deviations along the world's axes, metres and radians.
    pub fn new(t_world_map: Se2, sigma: [f64; 3]) -> Self {
        let variances = Vector3::from(sigma).map(|s| s * s);
        Self { t_world_map, covariance: Matrix3::from_diagonal(&variances), is_pinned: false }
    }

    /// A pose that is exact.
    pub fn pinned(t_world_map: Se2) -> Self {
        Self { is_pinned: true, ..Self::new(t_world_map, [PINNED; 3]) }
    }

    /// Where a frame lies in the world: told by the maps that are placed in it (`T_frame_map`) and have priors.
    /// Least squares over their residuals, each weighed by its prior. None without such a map.
    pub fn of_frame(placed: &[(Se2, &Prior)]) -> Option<Prior> {
        let trace = |p: &Prior| p.covariance.trace();
        let surest = placed.iter().min_by(|a, b| trace(a.1).total_cmp(&trace(b.1)))?;
        let mut t_world_frame = surest.1.t_world_map.compose(&surest.0.inverse());
        let mut covariance = Matrix3::zeros();
        for _ in 0..20 {
            let (mut h, mut g) = (Matrix3::zeros(), Vector3::zeros());
            for (t_frame_map, prior) in placed {
                let j = lever(&t_world_frame, t_frame_map);
                let information = prior.covariance.try_inverse()?;
                let r = prior.t_world_map.minus(&t_world_frame.compose(t_frame_map));
                h += j.transpose() * information * j;
                g += j.transpose() * information * r;
            }
            covariance = h.try_inverse()?;
            let step = covariance * g;
            t_world_frame = t_world_frame.perturbed(&step);
            if step.norm() < 1e-12 {
                break;
            }
        }
        let is_pinned = placed.iter().any(|(_, p)| p.is_pinned);
        Some(Prior { t_world_map: t_world_frame, covariance, is_pinned })
    }

    /// The pose of a map in a frame, in the world that this is the frame's place in.
    pub fn place(&self, t_frame_map: &Se2, covariance: &Matrix3<f64>) -> (Se2, Matrix3<f64>) {
        let j = lever(&self.t_world_map, t_frame_map);
        let own = self.t_world_map.transport_covariance(covariance);
        (self.t_world_map.compose(t_frame_map), j * self.covariance * j.transpose() + own)
    }

    /// How well a pose in a frame, whose place in the world is `frame`, fits this prior; none when it contradicts.
    /// `log_volume` is that of the search volume.
    pub fn fit(
        &self,
        frame: &Prior,
        t_frame_map: &Se2,
        covariance: &Matrix3<f64>,
        log_volume: f64,
    ) -> Option<Fit> {
        let (t_world_map, spread) = frame.place(t_frame_map, covariance);
        let (metres, radians) = WALLS;
        let walls = Vector3::new(metres, metres, radians).map(|s| s * s);
        let total = self.covariance + spread + Matrix3::from_diagonal(&walls);
        let inverse = total.try_inverse()?;
        let r = self.t_world_map.minus(&t_world_map);
        let squared = r.dot(&(inverse * r));
        if squared > CONTRADICTS {
            return None;
        }
        let log_density = -0.5 * (squared + 3.0 * TAU.ln() + total.determinant().ln());
        // Kalman's gain, of the walls' own uncertainty alone.
        let own = frame.t_world_map.transport_covariance(covariance);
        let drawn = t_world_map.perturbed(&(own * (inverse * r)));
        let pose = frame.t_world_map.between(&drawn);
        Some(Fit { log_odds: log_density + log_volume, pose })
    }
}

/// How `T_world_map` moves with `T_world_frame`.
fn lever(t_world_frame: &Se2, t_frame_map: &Se2) -> Matrix3<f64> {
    let arm: Vec2 = t_world_frame.rotate(t_frame_map.translation());
    Matrix3::new(1.0, 0.0, -arm.y, 0.0, 1.0, arm.x, 0.0, 0.0, 1.0)
}

/// A verdict on poses with the log-odds that priors give each: Bayes' rule, the alternative being that the map lies
/// elsewhere, where its prior leaves it.
pub fn weighed(verdict: &Verdict, log_odds: &[f64], least: f64) -> Verdict {
    let elsewhere = (1.0 - verdict.probabilities.iter().sum::<f64>()).max(1e-9);
    // Beyond e^50 all is said.
    let weigh = |(p, l): (&f64, &f64)| p * l.min(50.0).exp();
    let weights: Vec<f64> = verdict.probabilities.iter().zip(log_odds).map(weigh).collect();
    let total = elsewhere + weights.iter().sum::<f64>();
    let probabilities: Vec<f64> = weights.into_iter().map(|w| w / total).collect();
    let is_carried = probabilities.iter().sum::<f64>() >= least;
    Verdict { probabilities, is_carried }
}

/// Clusters whose maps have priors, as one in the world; those without stay as they are.
pub fn united(clusters: Vec<Cluster>, priors: &[Option<Prior>]) -> Vec<Cluster> {
    let in_world = |c: &Cluster| Prior::of_frame(&c.with_priors(priors));
    let (mut tied, mut free) = (Vec::new(), Vec::new());
    for c in clusters {
        match in_world(&c) {
            Some(frame) => tied.push((c, frame)),
            None => free.push(c),
        }
    }
    tied.sort_by_key(|(c, _)| std::cmp::Reverse(c.members.len()));
    if !tied.is_empty() {
        free.push(Cluster { in_world: true, ..gathered(&tied, priors) });
    }
    free
}

/// Clusters, at least one, as one, each where its frame lies in that of all; pinned maps exactly where they are
/// pinned.
pub fn gathered(tied: &[(Cluster, Prior)], priors: &[Option<Prior>]) -> Cluster {
    let ((first, _), rest) = tied.split_first().expect("at least one cluster");
    let mut world = Cluster {
        reference: first.reference,
        members: Vec::new(),
        poses: Vec::new(),
        covariances: Vec::new(),
        rms: first.rms,
        worlds: vec![World { probability: 1.0, ..World::default() }],
        stories: Vec::new(),
        elsewhere: None,
        steps: [first]
            .into_iter()
            .chain(rest.iter().map(|(c, _)| c))
            .flat_map(|c| c.steps.clone())
            .collect(),
        in_world: false,
        by_prior: Vec::new(),
    };
    for (c, frame) in tied {
        for ((m, t), covariance) in c.members.iter().zip(&c.poses).zip(&c.covariances) {
            let (mut pose, mut covariance) = frame.place(t, covariance);
            if let Some(pin) = priors.get(*m).and_then(Option::as_ref).filter(|p| p.is_pinned) {
                (pose, covariance) = (pin.t_world_map, Matrix3::zeros());
            }
            world.members.push(*m);
            world.poses.push(pose);
            world.covariances.push(covariance);
        }
        let combine = |a: &World| -> Vec<World> {
            c.worlds.iter().map(|b| a.with(b, &frame.t_world_map, 1.0)).collect()
        };
        world.worlds = world.worlds.iter().flat_map(combine).collect();
        // The first stays first: it is the one that is told.
        world.worlds[1..].sort_by(|a, b| b.probability.total_cmp(&a.probability));
        world.worlds.truncate(MAX_WORLDS);
        if let [only] = c.members[..] {
            world.by_prior.push(only);
        }
    }
    world.stories = world.worlds.clone();
    world
}

/// Positions of the members that stay in place in a refinement: the first, and those that are pinned where it is.
pub fn held(members: &[usize], priors: &[Option<Prior>]) -> Vec<usize> {
    let is_pinned =
        |m: &usize| priors.get(*m).and_then(Option::as_ref).is_some_and(|p| p.is_pinned);
    let pinned: Vec<usize> = (0..members.len()).filter(|k| is_pinned(&members[*k])).collect();
    match pinned[..] {
        // A single pin may as well be where its walls lead it in this frame.
        [] | [_] => vec![0],
        _ => pinned,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn two_priors_with_a_long_baseline_know_the_heading() {
        let t_world_frame = Se2::new(3.0, -2.0, 0.7);
        let placed = [Se2::new(0.0, 0.0, 0.2), Se2::new(50.0, 0.0, -1.0)];
        let priors = placed.map(|t| Prior::new(t_world_frame.compose(&t), [0.3, 0.3, 0.1]));
        let frame = Prior::of_frame(&[(placed[0], &priors[0]), (placed[1], &priors[1])]).unwrap();
        assert_relative_eq!(frame.t_world_map.minus(&t_world_frame).norm(), 0.0, epsilon = 1e-9);
        let heading = frame.covariance[(2, 2)].sqrt();
        assert_relative_eq!(heading, 0.3 * 2f64.sqrt() / 50.0, max_relative = 0.01);
    }

    #[test]
    fn the_surer_prior_decides_where_two_disagree() {
        let (a, b) = (Se2::new(1.0, 0.0, 0.0), Se2::new(0.0, 0.0, 0.0));
        let (sure, vague) = (Prior::pinned(a), Prior::new(b, [1.0, 1.0, 0.5]));
        let frame = Prior::of_frame(&[(Se2::IDENTITY, &vague), (Se2::IDENTITY, &sure)]).unwrap();
        assert_relative_eq!(frame.t_world_map.minus(&a).norm(), 0.0, epsilon = 1e-9);
        assert!(frame.is_pinned);
    }

    #[test]
    fn a_pose_beyond_four_deviations_contradicts() {
        let frame = Prior::pinned(Se2::IDENTITY);
        let prior = Prior::new(Se2::new(2.0, 1.0, 0.3), [0.5, 0.5, 0.1]);
        let fit = |x: f64| {
            let exact = Matrix3::from_diagonal_element(1e-6);
            prior.fit(&frame, &Se2::new(2.0 + x, 1.0, 0.3), &exact, 9.0)
        };
        assert!(fit(2.1).is_none());
        let (near, far) = (fit(0.1).unwrap().log_odds, fit(1.5).unwrap().log_odds);
        // The ratio of densities; what walls leave open widens it a little.
        assert_relative_eq!(near - far, 0.5 * (9.0 - 0.04) / 1.01, max_relative = 0.01);
        // The peak: density over the volume.
        let peak = 9.0 - 1.5 * TAU.ln() - (0.5f64 * 0.5 * 0.1).ln();
        assert_relative_eq!(fit(0.0).unwrap().log_odds, peak, epsilon = 0.03);
    }

    #[test]
    fn walls_that_leave_an_axis_free_are_drawn_to_the_prior_along_it() {
        let frame = Prior::pinned(Se2::IDENTITY);
        let prior = Prior::new(Se2::new(2.0, 1.0, 0.0), [0.3, 0.3, 0.05]);
        let corridor = Matrix3::from_diagonal(&Vector3::new(25.0, 1e-4, 1e-5));
        let fit = prior.fit(&frame, &Se2::new(5.0, 1.05, 0.0), &corridor, 9.0).unwrap();
        assert!((fit.pose.x - 2.0).abs() < 0.05, "{:?}", fit.pose);
        assert!((fit.pose.y - 1.05).abs() < 1e-3, "{:?}", fit.pose);
    }

    #[test]
    fn bayes_rule_lifts_what_the_prior_likes_and_drops_the_rest() {
        let verdict = Verdict { probabilities: vec![0.6, 0.1], is_carried: false };
        let after = weighed(&verdict, &[f64::NEG_INFINITY, 5.0], 0.8);
        assert_eq!(after.probabilities[0], 0.0);
        let odds = 0.1 * 5f64.exp() / 0.3;
        assert_relative_eq!(after.probabilities[1], odds / (1.0 + odds), epsilon = 1e-12);
        assert!(after.is_carried);
    }
}
