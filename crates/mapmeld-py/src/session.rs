//! The session as Python holds it.

use crate::convert;
use crate::merge::to_dict;
use crate::watch::{watched, Tell};
use mapmeld_core::result::Known;
use mapmeld_core::Session as CoreSession;
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

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

    /// Merges the maps as they are; `progress` as in merge.
    #[pyo3(signature = (progress=None))]
    fn merge<'py>(
        &self,
        py: Python<'py>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let session = Arc::clone(&self.0);
        let work = move |tell: Tell| {
            locked(&session).merge(&Known::default(), &|s, d, t| tell.tell(s, d, t))
        };
        let found = watched(py, progress, work)?;
        to_dict(py, &found.map_err(convert::to_py_err)?)
    }

    /// One map of some of the maps at poses T_frame_map, the first of which draws the walls.
    fn fuse<'py>(
        &self,
        py: Python<'py>,
        name: &str,
        placed: Vec<(String, [f64; 3])>,
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
