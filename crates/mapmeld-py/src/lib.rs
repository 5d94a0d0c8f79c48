//! Python bindings: convert, call, map errors. No algorithm lives here.

mod convert;
mod events;
mod fuse;
mod known;
mod local_map;
mod merge;
mod session;
mod store;
mod watch;

use pyo3::prelude::*;

#[pymodule]
fn _core(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add("__version__", env!("CARGO_PKG_VERSION"))?;
    m.add("SAME_WORLD", mapmeld_core::registration::SAME_WORLD)?;
    m.add_class::<local_map::LocalMap>()?;
    m.add_class::<session::Session>()?;
    m.add_function(wrap_pyfunction!(local_map::default_config, m)?)?;
    m.add_function(wrap_pyfunction!(local_map::least_probability, m)?)?;
    m.add_function(wrap_pyfunction!(local_map::effective_config, m)?)?;
    m.add_function(wrap_pyfunction!(local_map::register, m)?)?;
    m.add_function(wrap_pyfunction!(local_map::weigh, m)?)?;
    m.add_function(wrap_pyfunction!(local_map::perceive, m)?)?;
    m.add_function(wrap_pyfunction!(local_map::candidates, m)?)?;
    m.add_function(wrap_pyfunction!(local_map::partners, m)?)?;
    m.add_function(wrap_pyfunction!(fuse::fuse, m)?)?;
    m.add_class::<store::Store>()?;
    m.add_function(wrap_pyfunction!(store::plan, m)?)?;
    m.add_function(wrap_pyfunction!(store::register_batch, m)?)?;
    m.add_function(wrap_pyfunction!(store::registration_digest, m)?)?;
    m.add_function(wrap_pyfunction!(merge::merge, m)?)?;
    Ok(())
}
