//! The merge as Python calls it.

use crate::convert;
use crate::known::{known, GivenPrior, GivenRelation};
use crate::local_map::mode;
use crate::store::Store;
use crate::watch::{watched_told, Tell};
use mapmeld_core::error::Error;
use mapmeld_core::events::Event;
use mapmeld_core::grid::OccupancyGrid;
use mapmeld_core::merge::merge_told;
use mapmeld_core::registration::PairModes;
use mapmeld_core::result::{Known, Merge};
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

pub type Given<'py> = (String, PyReadonlyArray2<'py, i8>, f64, [f64; 3]);

/// Merges maps given as (name, data, resolution, origin). `progress(stage, done, total)` is called
/// between pieces of work, on the calling thread; what it raises ends the merge, as does Ctrl-C. So is
/// `listener(name, seconds, data)`, with every event. Priors, relations and forbidden pairs name maps: see `known`.
/// `store` keeps registered pairs.
#[pyfunction]
#[pyo3(signature = (maps, config, order=None, reference=None, progress=None, priors=vec![], relations=vec![],
    forbidden=vec![], listener=None, store=None))]
#[allow(clippy::too_many_arguments)] // Python's keywords
pub fn merge<'py>(
    py: Python<'py>,
    maps: Vec<Given<'py>>,
    config: &str,
    order: Option<Vec<usize>>,
    reference: Option<usize>,
    progress: Option<Py<PyAny>>,
    priors: Vec<GivenPrior>,
    relations: Vec<GivenRelation>,
    forbidden: Vec<(String, String)>,
    listener: Option<Py<PyAny>>,
    store: Option<PyRef<'py, Store>>,
) -> PyResult<Bound<'py, PyDict>> {
    let config = convert::config(config)?;
    let grids = grids(maps)?;
    let index = |name: &str| {
        let missing =
            || Error::Config { key: "known".into(), problem: format!("no map is {name}") };
        grids.iter().position(|g| g.name() == name).ok_or_else(missing)
    };
    let told = known(grids.len(), index, &priors, &relations, &forbidden);
    let store = store.map(|store| store.shared());
    let references = reference.into_iter().collect();
    let known = Known { order, references, ..told.map_err(convert::to_py_err)? };
    let is_heard = listener.is_some();
    let work = move |tell: Tell| {
        let event = |e: Event| tell.event(e);
        let heard = is_heard.then_some(&event as &(dyn Fn(Event) + Sync));
        merge_told(grids, &known, &config, store, (&|s, d, t| tell.tell(s, d, t), heard))
    };
    let found = watched_told(py, progress, listener, work)?;
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
            e.set_item("weights", &s.weights)?;
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
            Some(f) => convert::set_layers(&d, f)?,
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
        pairs.append(pair(py, p)?)?;
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

pub fn pair<'py>(py: Python<'py>, p: &PairModes) -> PyResult<Bound<'py, PyDict>> {
    let d = PyDict::new(py);
    d.set_item("a", p.a)?;
    d.set_item("b", p.b)?;
    d.set_item("candidates", p.candidates)?;
    d.set_item("status", p.status.name())?;
    d.set_item("probability", p.probability)?;
    let decoy = p.found.decoy;
    d.set_item("decoy_log_likelihood", decoy)?;
    d.set_item("scale", p.stretch.map(|s| s.scale))?;
    d.set_item("scale_deviation", p.stretch.map(|s| s.deviation))?;
    let modes = p.found.modes.iter().map(|x| mode(py, x)).collect::<PyResult<Vec<_>>>()?;
    d.set_item("modes", modes)?;
    Ok(d)
}
