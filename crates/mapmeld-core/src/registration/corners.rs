//! Similar corners: the paper's source of motions (section 3, fig. 1b).

use crate::config::RegistrationConfig;
use crate::registration::closed_form::rigid_transform;
use crate::registration::{Candidate, Source};
use crate::structure::Corner;

/// True when the opening angles agree within the fit's uncertainty. Arms need not be equally long:
/// how much of a wall is seen depends on where the robot stood.
pub fn similar(a: &Corner, b: &Corner, config: &RegistrationConfig) -> bool {
    let sigma = a.opening_sigma.hypot(b.opening_sigma);
    (a.opening - b.opening).abs() <= config.opening_tolerance + 3.0 * sigma
}

/// One candidate for every similar pair, in closed form from the vertex and the two arms, which are
/// followed as far as both maps show them.
pub fn candidates(a: &[Corner], b: &[Corner], config: &RegistrationConfig) -> Vec<Candidate> {
    let mut out = Vec::new();
    for ca in a {
        for cb in b.iter().filter(|cb| similar(ca, cb, config)) {
            let arm = |k: usize| {
                let l = ca.lengths[k].min(cb.lengths[k]);
                (ca.vertex + ca.arms[k] * l, cb.vertex + cb.arms[k] * l, 1.0)
            };
            let matched = [(ca.vertex, cb.vertex, 1.0), arm(0), arm(1)];
            if let Some(t_a_b) = rigid_transform(&matched) {
                out.push(Candidate { t_a_b, source: Source::Corners });
            }
        }
    }
    out
}
