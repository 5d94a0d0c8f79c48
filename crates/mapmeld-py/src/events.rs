//! Events of a merge as Python hears them: a name and a dict.

use crate::convert;
use crate::merge::pair;
use mapmeld_core::events::{Event, Prepared, Refined, Stepped};
use mapmeld_core::se2::Se2;
use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

type Told<'py> = PyResult<(&'static str, Bound<'py, PyDict>)>;

pub fn to_dict<'py>(py: Python<'py>, event: &Event) -> Told<'py> {
    let out = PyDict::new(py);
    let name = match event {
        Event::Prepared(maps) => {
            out.set_item("maps", list(py, maps, prepared)?)?;
            "prepared"
        }
        Event::Registered(pairs) => {
            out.set_item("pairs", list(py, pairs, pair)?)?;
            "registered"
        }
        Event::Stepped(step) => {
            stepped(py, &out, step)?;
            "stepped"
        }
        Event::Refined(components) => {
            out.set_item("components", list(py, components, refined)?)?;
            "refined"
        }
    };
    Ok((name, out))
}

fn list<'py, T>(
    py: Python<'py>,
    items: &[T],
    f: impl Fn(Python<'py>, &T) -> PyResult<Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyList>> {
    let items = items.iter().map(|item| f(py, item)).collect::<PyResult<Vec<_>>>()?;
    PyList::new(py, items)
}

fn prepared<'py>(py: Python<'py>, m: &Prepared) -> PyResult<Bound<'py, PyDict>> {
    let d = PyDict::new(py);
    d.set_item("map", m.map)?;
    d.set_item("boundary", convert::points(py, m.boundary.iter().copied())?)?;
    d.set_item("corners", convert::points(py, m.corners.iter().copied())?)?;
    Ok(d)
}

fn stepped<'py>(py: Python<'py>, out: &Bound<'py, PyDict>, s: &Stepped) -> PyResult<()> {
    out.set_item("travel", s.travel)?;
    out.set_item("step", s.step)?;
    out.set_item("joining", s.joining)?;
    out.set_item("effective_sample_size", s.fared.effective_sample_size)?;
    out.set_item("resampled", s.fared.resampled)?;
    out.set_item("log_evidence", s.fared.log_evidence)?;
    let candidates = list(py, &s.candidates, |py, c| {
        let d = PyDict::new(py);
        d.set_item("maps", placed(&c.maps))?;
        d.set_item("log_mass", c.log_mass)?;
        d.set_item("psi", c.psi)?;
        d.set_item("gamma", c.gamma)?;
        Ok(d)
    })?;
    out.set_item("candidates", candidates)?;
    let particles = list(py, &s.particles, |py, p| {
        let d = PyDict::new(py);
        d.set_item("maps", placed(&p.maps))?;
        d.set_item("weight", p.weight)?;
        Ok(d)
    })?;
    out.set_item("particles", particles)
}

fn refined<'py>(py: Python<'py>, r: &Refined) -> PyResult<Bound<'py, PyDict>> {
    let poses = |poses: &[Se2]| poses.iter().map(|t| t.to_array()).collect::<Vec<_>>();
    let d = PyDict::new(py);
    d.set_item("maps", &r.maps)?;
    d.set_item("before", poses(&r.before))?;
    d.set_item("after", poses(&r.after))?;
    let flat = r.covariances.iter().flat_map(|c| c.transpose().iter().copied().collect::<Vec<_>>());
    let covariances = PyArray1::from_iter(py, flat).reshape([r.covariances.len(), 3, 3])?;
    d.set_item("covariances", covariances)?;
    d.set_item("rms", r.rms)?;
    Ok(d)
}

fn placed(maps: &[(usize, Se2)]) -> Vec<(usize, [f64; 3])> {
    maps.iter().map(|(m, t)| (*m, t.to_array())).collect()
}
