//! Between the core's types and Python's.

use mapmeld_core::config::Config;
use mapmeld_core::error::Error;
use mapmeld_core::fuse::Fused;
use mapmeld_core::grid::OccupancyGrid;
use mapmeld_core::se2::{Se2, Vec2};
use nalgebra::Matrix3;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// The one place where a core error becomes a Python exception.
pub fn to_py_err(error: Error) -> PyErr {
    let class = match error {
        Error::Interrupted => return PyKeyboardInterrupt::new_err(()),
        Error::Config { .. } => "ConfigError",
        Error::Grid { .. } => "MapmeldError",
    };
    Python::attach(|py| {
        let raise = || -> PyResult<PyErr> {
            let class = py.import("mapmeld.errors")?.getattr(class)?;
            Ok(PyErr::from_value(class.call1((error.to_string(),))?))
        };
        raise().unwrap_or_else(|e| e)
    })
}

pub fn config(json: &str) -> PyResult<Config> {
    Config::from_json(json).map_err(to_py_err)
}

pub fn pose(v: [f64; 3]) -> Se2 {
    Se2::from(v)
}

/// A grid of the core; errors name the map and the field.
pub fn grid(
    name: String,
    data: &PyReadonlyArray2<'_, i8>,
    resolution: f64,
    origin: [f64; 3],
) -> PyResult<OccupancyGrid> {
    let (height, width) = data.as_array().dim();
    // Row by row in memory nearly always: then it is one copy.
    let cells = match data.as_slice() {
        Ok(cells) => cells.to_vec(),
        Err(_) => data.as_array().iter().copied().collect(),
    };
    OccupancyGrid::new(name, width, height, resolution, pose(origin), cells).map_err(to_py_err)
}

/// Puts a grid's cells and place into a dict.
pub fn set_grid(out: &Bound<'_, PyDict>, grid: &OccupancyGrid) -> PyResult<()> {
    let cells = PyArray1::from_slice(out.py(), grid.cells());
    out.set_item("data", cells.reshape([grid.height(), grid.width()])?)?;
    out.set_item("resolution", grid.resolution())?;
    out.set_item("origin", grid.origin().to_array())
}

/// Puts a merged map and the layers behind it into a dict.
pub fn set_layers(out: &Bound<'_, PyDict>, fused: &Fused) -> PyResult<()> {
    let (py, shape) = (out.py(), [fused.grid.height(), fused.grid.width()]);
    set_grid(out, &fused.grid)?;
    let sources = fused.sources.iter().map(|s| s.map_or(-1, i32::from));
    out.set_item("sources", PyArray1::from_iter(py, sources).reshape(shape)?)?;
    out.set_item("disputed", PyArray1::from_slice(py, &fused.disputed).reshape(shape)?)
}

pub fn points<'py>(
    py: Python<'py>,
    points: impl Iterator<Item = Vec2>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    rows(py, 2, points.flat_map(|p| [p.x, p.y]).collect())
}

/// An array of shape (len / columns, columns).
pub fn rows(py: Python<'_>, columns: usize, flat: Vec<f64>) -> PyResult<Bound<'_, PyArray2<f64>>> {
    let n = flat.len() / columns;
    PyArray1::from_vec(py, flat).reshape([n, columns])
}

pub fn matrix(m: &Matrix3<f64>) -> [[f64; 3]; 3] {
    std::array::from_fn(|r| std::array::from_fn(|c| m[(r, c)]))
}
