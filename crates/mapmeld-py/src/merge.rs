//! The merge as Python calls it.

use crate::convert;
use crate::local_map::mode;
use mapmeld_core::grid::OccupancyGrid;
use mapmeld_core::merge::merge as core_merge;
use mapmeld_core::result::{Known, Merge, Stage};
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray2};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::Mutex;
use std::time::Duration;

/// How long Ctrl-C may wait to be heard.
const SIGNAL_POLL: Duration = Duration::from_millis(50);

type Given<'py> = (String, PyReadonlyArray2<'py, i8>, f64, [f64; 3]);

/// Merges maps given as (name, data, resolution, origin). `progress(stage, done, total)` is called
/// between pieces of work, on the calling thread; what it raises ends the merge, as does Ctrl-C.
#[pyfunction]
#[pyo3(signature = (maps, config, order=None, reference=None, progress=None))]
pub fn merge<'py>(
    py: Python<'py>,
    maps: Vec<Given<'py>>,
    config: &str,
    order: Option<Vec<usize>>,
    reference: Option<usize>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let config = convert::config(config)?;
    let grids = maps
        .into_iter()
        .map(|(name, data, resolution, origin)| {
            let view = data.as_array();
            let (height, width) = view.dim();
            let cells: Vec<i8> = view.iter().copied().collect();
            OccupancyGrid::new(name, width, height, resolution, convert::pose(origin), cells)
        })
        .collect::<Result<Vec<_>, _>>()
        .map_err(convert::to_py_err)?;
    let known = Known { order, reference };

    // The core works on a thread of its own and never needs the interpreter; the calling thread, the
    // only one that may hear of signals, waits for what the core tells. When it leaves early (Ctrl-C,
    // or `progress` raised) the core learns so at its next piece of work, because nobody hears it.
    let (tell, hear) = mpsc::channel();
    let worker = std::thread::spawn(move || {
        core_merge(grids, &known, &config, &|stage: Stage, done: usize, total: usize| {
            tell.send((stage, done, total)).is_ok()
        })
    });
    let hear = Mutex::new(hear);
    loop {
        py.check_signals()?;
        let told = py.detach(|| hear.lock().expect("no other listener").recv_timeout(SIGNAL_POLL));
        match (told, &progress) {
            (Ok((stage, done, total)), Some(f)) => {
                f.call1(py, (stage.name(), done, total))?;
            }
            (Ok(_), None) | (Err(RecvTimeoutError::Timeout), _) => {}
            (Err(RecvTimeoutError::Disconnected), _) => break,
        }
    }
    // A panic is a bug of the core: an exception like any other, so that callers can report it.
    let found = py
        .detach(|| worker.join())
        .map_err(|_| PyRuntimeError::new_err("the core failed; please report this as a bug"))?;
    to_dict(py, &found.map_err(convert::to_py_err)?)
}

fn to_dict<'py>(py: Python<'py>, m: &Merge) -> PyResult<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    let maps = PyList::empty(py);
    for p in &m.placements {
        let d = PyDict::new(py);
        d.set_item("component", p.component)?;
        d.set_item("T_component_map", p.t_component_map.map(|t| t.to_array()))?;
        d.set_item("covariance", convert::matrix(&p.covariance))?;
        d.set_item("status", p.status.name())?;
        d.set_item("probability", p.probability)?;
        maps.append(d)?;
    }
    out.set_item("maps", maps)?;

    let components = PyList::empty(py);
    for c in &m.components {
        let d = PyDict::new(py);
        d.set_item("reference", c.reference)?;
        d.set_item("order", &c.order)?;
        d.set_item("rms", c.rms)?;
        d.set_item("conflict_cells", c.fused.conflicts)?;
        d.set_item("shared_cells", c.fused.shared)?;
        let steps = PyList::empty(py);
        for s in &c.steps {
            let e = PyDict::new(py);
            e.set_item("effective_sample_size", s.effective_sample_size)?;
            e.set_item("resampled", s.resampled)?;
            e.set_item("log_evidence", s.log_evidence)?;
            steps.append(e)?;
        }
        d.set_item("steps", steps)?;
        let g = &c.fused.grid;
        let data = PyArray1::from_slice(py, g.cells()).reshape([g.height(), g.width()])?;
        d.set_item("data", data)?;
        d.set_item("resolution", g.resolution())?;
        d.set_item("origin", g.origin().to_array())?;
        components.append(d)?;
    }
    out.set_item("components", components)?;

    out.set_item("probability", m.probability)?;
    let hypotheses = PyList::empty(py);
    for h in &m.hypotheses {
        let d = PyDict::new(py);
        d.set_item("probability", h.probability)?;
        let placed: Vec<(usize, usize, [f64; 3])> =
            h.maps.iter().map(|(map, c, t)| (*map, *c, t.to_array())).collect();
        d.set_item("maps", placed)?;
        hypotheses.append(d)?;
    }
    out.set_item("hypotheses", hypotheses)?;

    let pairs = PyList::empty(py);
    for p in &m.pairs {
        let d = PyDict::new(py);
        d.set_item("a", p.a)?;
        d.set_item("b", p.b)?;
        d.set_item("candidates", p.candidates)?;
        d.set_item("status", p.status.name())?;
        d.set_item("probability", p.probability)?;
        let decoy = p.found.decoys.iter().map(|e| e.log_likelihood).reduce(f64::max);
        d.set_item("decoy_log_likelihood", decoy)?;
        d.set_item(
            "modes",
            p.found.modes.iter().map(|x| mode(py, x)).collect::<PyResult<Vec<_>>>()?,
        )?;
        pairs.append(d)?;
    }
    out.set_item("pairs", pairs)?;

    let seconds = PyDict::new(py);
    for (stage, s) in &m.seconds {
        seconds.set_item(*stage, *s)?;
    }
    out.set_item("seconds", seconds)?;
    Ok(out)
}
