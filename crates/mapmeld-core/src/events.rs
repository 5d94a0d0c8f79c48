//! What happens in a merge, told to whoever records it.
//!
//! A listener hears of everything after the fact and changes nothing. Without one, no event is made: the merge
//! pays for a look at an empty option a step.

use crate::canonical::Canonical;
use crate::cluster::Cluster;
use crate::filter::{LogWeight, Step, Told};
use crate::local_map::LocalMap;
use crate::pair_table::PairTable;
use crate::perception::pool;
use crate::registration::PairModes;
use crate::se2::{Se2, Vec2};
use crate::virtual_robot::VirtualRobot;
use nalgebra::Matrix3;

/// Hears of events, on the thread of the merge.
pub type Listener<'a> = Option<&'a (dyn Fn(Event) + Sync)>;

/// What a map is prepared to.
#[derive(Debug, Clone)]
pub struct Prepared {
    /// The map.
    pub map: usize,
    /// Boundary points, map coordinates, metres.
    pub boundary: Vec<Vec2>,
    /// Corners: where two walls meet, map coordinates, metres.
    pub corners: Vec<Vec2>,
}

/// A pose that the virtual robot can go to in a step.
#[derive(Debug, Clone)]
pub struct Candidate {
    /// Maps that would be merged with their `T_world_map`: one, or those of a merged map.
    pub maps: Vec<(usize, Se2)>,
    /// Log of its mass in the step, which particles draw by.
    pub log_mass: f64,
    /// Psi~ over the step's candidates.
    pub psi: f64,
    /// gamma~ over the step's candidates.
    pub gamma: f64,
}

/// A particle after a step and before resampling.
#[derive(Debug, Clone)]
pub struct Particle {
    /// The maps merged so far with their `T_world_map`, in its order: its trajectory.
    pub maps: Vec<(usize, Se2)>,
    /// Its weight; those of a step sum to one.
    pub weight: f64,
}

/// A step of the filter.
#[derive(Debug, Clone)]
pub struct Stepped {
    /// Which travel, from 0: the robot starts anew for each component, and again among merged maps.
    pub travel: usize,
    /// Which of its steps, from 1.
    pub step: u64,
    /// Whether the robot travels among merged maps.
    pub joining: bool,
    /// Where it can go.
    pub candidates: Vec<Candidate>,
    /// Where its particles went.
    pub particles: Vec<Particle>,
    /// How the filter fared.
    pub fared: Step,
}

/// Maps placed together: before and after the joint refinement.
#[derive(Debug, Clone)]
pub struct Refined {
    /// The maps, in merge order.
    pub maps: Vec<usize>,
    /// `T_reference_map` of each, as the particles found it.
    pub before: Vec<Se2>,
    /// The same, refined.
    pub after: Vec<Se2>,
    /// Covariance of each relative to the reference.
    pub covariances: Vec<Matrix3<f64>>,
    /// Root mean square of the walls' residuals, metres.
    pub rms: Option<f64>,
}

/// What happened.
#[derive(Debug, Clone)]
pub enum Event {
    /// The maps are prepared.
    Prepared(Vec<Prepared>),
    /// All pairs are registered.
    Registered(Vec<PairModes>),
    /// The filter has made a step.
    Stepped(Stepped),
    /// The placed maps are refined; again after merged maps have joined.
    Refined(Vec<Refined>),
}

impl Event {
    pub(crate) fn prepared(maps: &[LocalMap]) -> Event {
        let of_map = |(map, m): (usize, &LocalMap)| Prepared {
            map,
            boundary: m.boundary.iter().map(|b| b.position).collect(),
            corners: m.corners.iter().map(|c| c.vertex).collect(),
        };
        Event::Prepared(maps.iter().enumerate().map(of_map).collect())
    }

    pub(crate) fn registered(pairs: &PairTable) -> Event {
        Event::Registered(pairs.pairs().to_vec())
    }

    pub(crate) fn refined(clusters: &[Cluster]) -> Event {
        let of_cluster = |c: &Cluster| Refined {
            maps: c.members.clone(),
            before: c.worlds[0].poses.iter().map(|(_, t)| *t).collect(),
            after: c.poses.clone(),
            covariances: c.covariances.clone(),
            rms: c.rms,
        };
        let several = clusters.iter().filter(|c| c.members.len() > 1);
        Event::Refined(several.map(of_cluster).collect())
    }

    /// A step of the filter. `clusters`: what the robot's maps are merged of, if they are merged maps.
    pub(crate) fn stepped(
        robot: &VirtualRobot,
        (told, fared): (&Told<VirtualRobot>, &Step),
        travel: usize,
        clusters: Option<&[Cluster]>,
    ) -> Event {
        let spread = |map: usize, t: Se2| -> Vec<(usize, Se2)> {
            let Some(c) = clusters.map(|c| &c[map]) else { return vec![(map, t)] };
            c.members.iter().zip(&c.poses).map(|(m, p)| (*m, t.compose(p))).collect()
        };
        let (mut candidates, mut psi, mut gamma) = (Vec::new(), Vec::new(), Vec::new());
        for ((leader, modes), masses) in told.leaders.iter().zip(told.modes).zip(told.masses) {
            let terms = robot.terms(&told.before[*leader].state, modes);
            for ((mode, LogWeight(log_mass)), (p, g)) in modes.iter().zip(masses).zip(terms) {
                let maps = spread(mode.map, mode.t_world_map);
                candidates.push(Candidate { maps, log_mass: *log_mass, psi: 0.0, gamma: 0.0 });
                psi.push(p);
                gamma.push(g);
            }
        }
        let shares = pool::normalise(&psi, &gamma, robot.config.perception.gamma_floor);
        for (c, (p, g)) in candidates.iter_mut().zip(shares.psi.iter().zip(&shares.gamma)) {
            (c.psi, c.gamma) = (*p, *g);
        }
        let particle = |(p, weight): (&crate::filter::Particle<_>, &f64)| {
            let mut maps: Vec<_> = crate::perception::Overlay::layers(&p.state).collect();
            maps.reverse();
            let maps = maps.into_iter().flat_map(|l| spread(l.map, l.t_world_map)).collect();
            Particle { maps, weight: *weight }
        };
        Event::Stepped(Stepped {
            travel,
            step: told.step,
            joining: clusters.is_some(),
            candidates,
            particles: told.after.iter().zip(&fared.weights).map(particle).collect(),
            fared: fared.clone(),
        })
    }

    /// An event of maps in canonical order, told of the maps as given.
    pub(crate) fn restored(self, canonical: &Canonical) -> Event {
        let given = |m: usize| canonical.given(m);
        let placed =
            |maps: Vec<(usize, Se2)>| maps.into_iter().map(|(m, t)| (given(m), t)).collect();
        match self {
            Event::Prepared(mut maps) => {
                maps.iter_mut().for_each(|m| m.map = given(m.map));
                maps.sort_by_key(|m| m.map);
                Event::Prepared(maps)
            }
            Event::Registered(pairs) => Event::Registered(canonical.pairs(pairs)),
            Event::Stepped(mut s) => {
                for c in &mut s.candidates {
                    c.maps = placed(std::mem::take(&mut c.maps));
                }
                for p in &mut s.particles {
                    p.maps = placed(std::mem::take(&mut p.maps));
                }
                Event::Stepped(s)
            }
            Event::Refined(mut all) => {
                all.iter_mut().flat_map(|r| &mut r.maps).for_each(|m| *m = given(*m));
                Event::Refined(all)
            }
        }
    }
}
