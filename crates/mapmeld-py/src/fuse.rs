//! Placed maps into one, without a merge.

use crate::convert;
use mapmeld_core::fuse::fuse as fuse_maps;
use mapmeld_core::parallel;
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;
use pyo3::types::PyDict;

type Placed<'py> = (String, PyReadonlyArray2<'py, i8>, f64, [f64; 3], [f64; 3]);

/// One map of maps (name, data, resolution, origin, T_frame_map), the first of which draws the walls.
#[pyfunction]
pub fn fuse<'py>(
    py: Python<'py>,
    name: &str,
    placed: Vec<Placed<'py>>,
    config: &str,
) -> PyResult<Bound<'py, PyDict>> {
    let config = convert::config(config)?;
    let placed = placed
        .into_iter()
        .map(|(n, data, resolution, origin, t)| {
            Ok((convert::grid(n, &data, resolution, origin)?, convert::pose(t)))
        })
        .collect::<PyResult<Vec<_>>>()?;
    let fused = py.detach(|| {
        let placed: Vec<_> = placed.iter().map(|(g, t)| (g, *t)).collect();
        parallel::with_threads(config.threads, || fuse_maps(name, &placed, &config.fuse))?
    });
    let out = PyDict::new(py);
    convert::set_layers(&out, &fused.map_err(convert::to_py_err)?)?;
    Ok(out)
}
