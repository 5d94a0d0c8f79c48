//! The session as Python holds it.

use crate::convert;
use crate::known::{known, GivenPrior, GivenRelation};
use crate::local_map::evidence;
use crate::merge::to_dict;
use crate::watch::{watched, Tell};
use mapmeld_core::error::Error;
use mapmeld_core::result::Known;
use mapmeld_core::standing::Question;
use mapmeld_core::Session as CoreSession;
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A map and its pose.
type Placed = (String, [f64; 3]);

/// Maps in one frame, others in another one, and places of this in that, T_base_moved.
type Asked = (Vec<Placed>, Vec<Placed>, Vec<[f64; 3]>);

/// Each place's probability and the first place that is the same, and the probability of the best other place.
type Weighed = (Vec<(f64, usize)>, f64);

/// Maps that come, change and go. Calls wait for one another: a merge that was left early ends with its piece of
/// work first.
#[pyclass(module = "mapmeld._core", frozen)]
pub struct Session(Arc<Mutex<CoreSession>>);

/// The session; what a panic left behind is whole, because maps that were lent are made anew.
fn locked(session: &Mutex<CoreSession>) -> MutexGuard<'_, CoreSession> {
    session.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Session {
    /// Works on the session without holding the interpreter, which the one who has the session never needs.
    fn with<R: Send>(&self, py: Python<'_>, f: impl FnOnce(&mut CoreSession) -> R + Send) -> R {
        py.detach(|| f(&mut locked(&self.0)))
    }
}

#[pymethods]
impl Session {
    #[new]
    fn new(config: &str) -> PyResult<Self> {
        let session = CoreSession::new(convert::config(config)?).map_err(convert::to_py_err)?;
        Ok(Self(Arc::new(Mutex::new(session))))
    }

    /// Takes a map; false when it is as it was.
    fn update(
        &self,
        py: Python<'_>,
        name: String,
        data: PyReadonlyArray2<'_, i8>,
        resolution: f64,
        origin: [f64; 3],
    ) -> PyResult<bool> {
        let grid = convert::grid(name, &data, resolution, origin)?;
        Ok(self.with(py, |s| s.update(grid)))
    }

    /// Forgets a map; false when there is none of that name.
    fn remove(&self, py: Python<'_>, name: &str) -> bool {
        self.with(py, |s| s.remove(name))
    }

    /// Names of the maps, in the order of their indices.
    fn names(&self, py: Python<'_>) -> Vec<String> {
        self.with(py, |s| s.names().into_iter().map(str::to_owned).collect())
    }

    /// Merges the maps as they are; `progress` as in merge. References are names of maps, those that shall lend
    /// their frames first; priors, relations and forbidden pairs: see `known`.
    #[pyo3(signature = (references, priors, progress=None, relations=vec![], forbidden=vec![]))]
    fn merge<'py>(
        &self,
        py: Python<'py>,
        references: Vec<String>,
        priors: Vec<GivenPrior>,
        progress: Option<Py<PyAny>>,
        relations: Vec<GivenRelation>,
        forbidden: Vec<(String, String)>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let session = Arc::clone(&self.0);
        let work = move |tell: Tell| {
            let mut session = locked(&session);
            let index = |name: &str| session.index(name);
            let told = known(session.names().len(), index, &priors, &relations, &forbidden)?;
            let references =
                references.iter().map(|n| session.index(n)).collect::<Result<_, _>>()?;
            let known = Known { references, ..told };
            session.merge(&known, &|s, d, t| tell.tell(s, d, t))
        };
        let found = watched(py, progress, work)?;
        to_dict(py, &found.map_err(convert::to_py_err)?)
    }

    /// How probable places of some maps to others are by the maps as they are: for each question (base, moved,
    /// places), with maps as (name, T_base_map) and (name, T_moved_map) and places as T_base_moved, for each place its
    /// probability and which of them is the same, by index; and the probability of the best other place.
    #[pyo3(signature = (questions, priors, progress=None))]
    fn weigh(
        &self,
        py: Python<'_>,
        questions: Vec<Asked>,
        priors: Vec<GivenPrior>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Vec<Weighed>> {
        let session = Arc::clone(&self.0);
        let work = move |tell: Tell| {
            let mut session = locked(&session);
            let index = |name: &str| session.index(name);
            let known = known(session.names().len(), index, &priors, &[], &[])?;
            let placed = |maps: &[Placed]| -> Result<Vec<_>, Error> {
                maps.iter().map(|(n, t)| Ok((session.index(n)?, convert::pose(*t)))).collect()
            };
            let question = |(base, moved, places): &Asked| {
                let places = places.iter().map(|t| convert::pose(*t)).collect();
                Ok(Question { base: placed(base)?, moved: placed(moved)?, places })
            };
            let questions = questions.iter().map(question).collect::<Result<Vec<_>, Error>>()?;
            session.weigh(&known, &questions, &|s, d, t| tell.tell(s, d, t))
        };
        let answers = watched(py, progress, work)?.map_err(convert::to_py_err)?;
        Ok(answers.into_iter().map(|a| (a.places, a.rival)).collect())
    }

    /// Where some maps come to rest when they are let go at `start` (T_base_moved) near others: the pose, its
    /// probability and what the walls say, see the core's snap. None where no walls meet.
    #[pyo3(signature = (base, moved, start, decoy=0.0))]
    fn snap<'py>(
        &self,
        py: Python<'py>,
        base: Vec<Placed>,
        moved: Vec<Placed>,
        start: [f64; 3],
        decoy: f64,
    ) -> PyResult<Option<Bound<'py, PyDict>>> {
        let found = self.with(py, |s| {
            let placed = |maps: &[Placed]| -> Result<Vec<_>, Error> {
                maps.iter().map(|(n, t)| Ok((s.index(n)?, convert::pose(*t)))).collect()
            };
            let (base, moved) = (placed(&base)?, placed(&moved)?);
            let places = vec![convert::pose(start)];
            s.snap(&Question { base, moved, places }, decoy, &|_, _, _| true)
        });
        let Some(found) = found.map_err(convert::to_py_err)? else { return Ok(None) };
        let out = evidence(py, &found.evidence)?;
        out.set_item("T_base_moved", found.t_base_moved.to_array())?;
        out.set_item("probability", found.probability)?;
        Ok(Some(out))
    }

    /// One map of some of the maps at poses T_frame_map, the first of which draws the walls.
    fn fuse<'py>(
        &self,
        py: Python<'py>,
        name: &str,
        placed: Vec<Placed>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let fused = self.with(py, |s| {
            let placed: Vec<_> =
                placed.iter().map(|(n, t)| (n.as_str(), convert::pose(*t))).collect();
            s.fuse(name, &placed)
        });
        let out = PyDict::new(py);
        convert::set_grid(&out, &fused.map_err(convert::to_py_err)?.grid)?;
        Ok(out)
    }
}
