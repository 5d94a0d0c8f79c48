//! The merge as Python calls it.

use crate::convert;
use crate::local_map::mode;
use crate::store::Store;
use crate::watch::{watched, Tell};
use mapmeld_core::grid::OccupancyGrid;
use mapmeld_core::merge::merge_stored;
use mapmeld_core::result::{Known, Merge};
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

pub type Given<'py> = (String, PyReadonlyArray2<'py, i8>, f64, [f64; 3]);

/// Merges maps given as (name, data, resolution, origin). `progress(stage, done, total)` is called
/// between pieces of work, on the calling thread; what it raises ends the merge, as does Ctrl-C. `store` keeps
/// registered pairs.
#[pyfunction]
#[pyo3(signature = (maps, config, order=None, reference=None, progress=None, store=None))]
pub fn merge<'py>(
    py: Python<'py>,
    maps: Vec<Given<'py>>,
    config: &str,
    order: Option<Vec<usize>>,
    reference: Option<usize>,
    progress: Option<Py<PyAny>>,
    store: Option<PyRef<'py, Store>>,
) -> PyResult<Bound<'py, PyDict>> {
    let config = convert::config(config)?;
    let grids = grids(maps)?;
    let store = store.map(|store| store.shared());
    let references = reference.into_iter().collect();
    let known = Known { order, references, ..Known::default() };
    let work = move |tell: Tell| {
        merge_stored(grids, &known, &config, store, &|s, d, t| tell.tell(s, d, t))
    };
    let found = watched(py, progress, work)?;
    to_dict(py, &found.map_err(convert::to_py_err)?)
}

pub fn grids(maps: Vec<Given>) -> PyResult<Vec<OccupancyGrid>> {
    let grid =
        |(name, data, resolution, origin): Given| convert::grid(name, &data, resolution, origin);
    maps.into_iter().map(grid).collect()
}

pub fn to_dict<'py>(py: Python<'py>, m: &Merge) -> PyResult<Bound<'py, PyDict>> {
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
        d.set_item("in_world", c.in_world)?;
        d.set_item("order", &c.order)?;
        d.set_item("rms", c.rms)?;
        let steps = PyList::empty(py);
        for s in &c.steps {
            let e = PyDict::new(py);
            e.set_item("effective_sample_size", s.effective_sample_size)?;
            e.set_item("resampled", s.resampled)?;
            e.set_item("log_evidence", s.log_evidence)?;
            steps.append(e)?;
        }
        d.set_item("steps", steps)?;
        // A map that cannot be drawn has no cells.
        let fused = c.fused.as_ref().ok();
        d.set_item("conflict_cells", fused.map(|f| f.conflicts))?;
        d.set_item("shared_cells", fused.map(|f| f.shared))?;
        match fused {
            Some(f) => {
                convert::set_grid(&d, &f.grid)?;
                let shape = [f.grid.height(), f.grid.width()];
                let sources = f.sources.iter().map(|s| s.map_or(-1, i32::from));
                d.set_item("sources", PyArray1::from_iter(py, sources).reshape(shape)?)?;
                d.set_item("disputed", PyArray1::from_slice(py, &f.disputed).reshape(shape)?)?;
            }
            None => d.set_item("data", py.None())?,
        }
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

    out.set_item("registered_pairs", m.registered_pairs)?;

    let seconds = PyDict::new(py);
    for (stage, s) in &m.seconds {
        seconds.set_item(*stage, *s)?;
    }
    out.set_item("seconds", seconds)?;
    Ok(out)
}
