//! Prepared maps and what can be asked of one or two of them.

use crate::convert;
use mapmeld_core as core;
use mapmeld_core::config::Config;
use mapmeld_core::perception::psi::Comparison;
use mapmeld_core::perception::{gamma, likelihood, pool, psi, Overlay};
use mapmeld_core::se2::Se2;
use numpy::{PyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::Arc;

/// All options with their defaults, as JSON.
#[pyfunction]
pub fn default_config() -> String {
    Config::default().to_json()
}

/// Least probability of a merge among so many maps, where two alone are asked for `min_probability`.
#[pyfunction]
pub fn least_probability(min_probability: f64, maps: usize) -> f64 {
    core::config::EvidenceConfig { min_probability, ..Default::default() }
        .among(maps)
        .min_probability
}

/// All options as JSON: those given, and the defaults for the rest.
#[pyfunction]
pub fn effective_config(config: &str) -> PyResult<String> {
    Ok(convert::config(config)?.to_json())
}

/// A prepared local map.
#[pyclass(frozen, module = "mapmeld._core")]
pub struct LocalMap {
    pub inner: Arc<core::local_map::LocalMap>,
}

#[pymethods]
impl LocalMap {
    #[new]
    fn new(
        py: Python<'_>,
        name: String,
        data: PyReadonlyArray2<'_, i8>,
        resolution: f64,
        origin: [f64; 3],
        config: &str,
    ) -> PyResult<Self> {
        let config = convert::config(config)?;
        let grid = convert::grid(name, &data, resolution, origin)?;
        let inner = py.detach(|| core::local_map::LocalMap::new(grid, &config));
        Ok(Self { inner: Arc::new(inner) })
    }

    /// Oriented wall points: position and normal, float64 (n, 2) each, map frame.
    fn boundary<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let d = PyDict::new(py);
        let b = &self.inner.boundary;
        d.set_item("position", convert::points(py, b.iter().map(|p| p.position))?)?;
        d.set_item("normal", convert::points(py, b.iter().map(|p| p.normal))?)?;
        Ok(d)
    }

    /// Lines: start, end, normal, float64 (n, 2) each, map frame.
    fn lines<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let d = PyDict::new(py);
        let lines = &self.inner.lines;
        d.set_item("start", convert::points(py, lines.iter().map(|l| l.start))?)?;
        d.set_item("end", convert::points(py, lines.iter().map(|l| l.end))?)?;
        d.set_item("normal", convert::points(py, lines.iter().map(|l| l.normal))?)?;
        Ok(d)
    }

    /// Corners: vertex, arm0, arm1 (n, 2), lengths (n, 2) and opening, opening_sigma, map frame.
    fn corners<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let d = PyDict::new(py);
        let c = &self.inner.corners;
        d.set_item("vertex", convert::points(py, c.iter().map(|c| c.vertex))?)?;
        d.set_item("arm0", convert::points(py, c.iter().map(|c| c.arms[0]))?)?;
        d.set_item("arm1", convert::points(py, c.iter().map(|c| c.arms[1]))?)?;
        d.set_item("lengths", convert::rows(py, 2, c.iter().flat_map(|c| c.lengths).collect())?)?;
        d.set_item("opening", c.iter().map(|c| c.opening).collect::<Vec<_>>())?;
        d.set_item("opening_sigma", c.iter().map(|c| c.opening_sigma).collect::<Vec<_>>())?;
        Ok(d)
    }

    /// The mirror image: like the map in every statistic, and like no place it was made in.
    fn mirrored(&self) -> Self {
        Self { inner: Arc::new(self.inner.mirrored()) }
    }

    /// Number of free and of occupied cells.
    fn class_counts(&self) -> (usize, usize) {
        use core::grid::Class;
        let g = &self.inner.grid;
        (g.count(Class::Free), g.count(Class::Occupied))
    }

    /// Cells that are taken for free floor since the map is full of specks.
    fn specks(&self) -> usize {
        self.inner.specks
    }
}

pub fn evidence<'py>(
    py: Python<'py>,
    e: &core::perception::WallEvidence,
) -> PyResult<Bound<'py, PyDict>> {
    let d = PyDict::new(py);
    d.set_item("log_likelihood", e.log_likelihood)?;
    d.set_item("hits", e.hits)?;
    d.set_item("spread", e.spread)?;
    d.set_item("misses", e.misses)?;
    d.set_item("opposed", e.opposed)?;
    d.set_item("conflicts", e.conflicts)?;
    d.set_item("straight_conflicts", e.straight_conflicts)?;
    d.set_item("distinct_hits", e.distinct_hits)?;
    d.set_item("bending", e.bending)?;
    d.set_item("shared_floor", e.shared_floor)?;
    d.set_item("shared_length", e.shared_length)?;
    d.set_item("agreement", e.agreement())?;
    d.set_item("second_direction", e.second_direction())?;
    Ok(d)
}

pub fn mode<'py>(py: Python<'py>, m: &core::registration::Mode) -> PyResult<Bound<'py, PyDict>> {
    let d = evidence(py, &m.evidence)?;
    d.set_item("T_a_b", m.t_a_b.to_array())?;
    d.set_item("covariance", convert::matrix(&m.covariance))?;
    d.set_item("log_odds", m.log_odds)?;
    d.set_item("source", m.source.name())?;
    Ok(d)
}

/// The modes of a pair, most likely first, and the number of candidates they came from.
#[pyfunction]
pub fn register<'py>(
    py: Python<'py>,
    a: &LocalMap,
    b: &LocalMap,
    config: &str,
) -> PyResult<(usize, Vec<Bound<'py, PyDict>>)> {
    let config = convert::config(config)?;
    let (a, b) = (a.inner.clone(), b.inner.clone());
    let found =
        py.detach(|| [core::registration::pair::register(&a, &b, None, &[], (0, 1), &config)]);
    let rung = core::perception::noise::how_bent(&found, &[&*a, &*b]);
    let [found] = found;
    let modes = found.rungs[rung].modes.iter().map(|m| mode(py, m)).collect::<PyResult<_>>()?;
    Ok((found.candidates, modes))
}

/// What the verdict on two maps alone is made of: the degree of bending that fits them (`rung`), their modes
/// at it, and the features of the likeliest one (see `verdict::features`; None without a mode).
#[pyfunction]
pub fn weigh<'py>(
    py: Python<'py>,
    a: &LocalMap,
    b: &LocalMap,
    mirrored_b: &LocalMap,
    config: &str,
) -> PyResult<Bound<'py, PyDict>> {
    let config = convert::config(config)?;
    let (a, b, m) = (a.inner.clone(), b.inner.clone(), mirrored_b.inner.clone());
    let found =
        py.detach(|| [core::registration::pair::register(&a, &b, Some(&m), &[], (0, 1), &config)]);
    let rung = core::perception::noise::how_bent(&found, &[&*a, &*b]);
    let pair = &found[0].rungs[rung];
    let d = PyDict::new(py);
    d.set_item("rung", rung)?;
    d.set_item("modes", pair.modes.iter().map(|m| mode(py, m)).collect::<PyResult<Vec<_>>>()?)?;
    let model = &config.perception.rungs()[rung];
    let background =
        core::verdict::Background::new([&*a, &*b].into_iter(), (rung, model), pair.decoy());
    let chance = pair.chance(b.center.unwrap_or_default());
    let features =
        |m: &core::registration::Mode| core::verdict::features(&m.evidence, chance, &background);
    d.set_item("features", pair.modes.first().map(features))?;
    Ok(d)
}

/// Both perception models of a pool of poses T_a_b: the paper's Psi and gamma with their normalised
/// forms and product (float64, one a pose), and the wall evidence of each pose.
#[pyfunction]
pub fn perceive<'py>(
    py: Python<'py>,
    a: &LocalMap,
    b: &LocalMap,
    poses: Vec<[f64; 3]>,
    config: &str,
) -> PyResult<Bound<'py, PyDict>> {
    let config = convert::config(config)?;
    let p = &config.perception;
    let maps = std::slice::from_ref(&*a.inner);
    let merged = Overlay::default().with(maps, 0, Se2::IDENTITY, 1.0, true);
    let (mut psis, mut gammas, mut walls) = (Vec::new(), Vec::new(), Vec::new());
    for t in poses {
        let t = convert::pose(t);
        let comparison = Comparison::new(maps, &merged, &b.inner, t, p.sigma_cells);
        psis.push(psi::psi(&comparison, p.classes));
        gammas.push(gamma::gamma(&comparison));
        walls.push(evidence(py, &likelihood::pair(&a.inner, &b.inner, &t, usize::MAX, p))?);
    }
    let normalised = pool::normalise(&psis, &gammas, p.gamma_floor);
    let d = PyDict::new(py);
    d.set_item("psi", PyArray1::from_vec(py, psis))?;
    d.set_item("gamma", PyArray1::from_vec(py, gammas))?;
    d.set_item("psi_normalised", PyArray1::from_vec(py, normalised.psi))?;
    d.set_item("gamma_normalised", PyArray1::from_vec(py, normalised.gamma))?;
    d.set_item("product", PyArray1::from_vec(py, normalised.product))?;
    d.set_item("walls", walls)?;
    Ok(d)
}

/// Unrefined candidates for T_a_b: source and pose of each.
#[pyfunction]
pub fn candidates(
    a: &LocalMap,
    b: &LocalMap,
    config: &str,
) -> PyResult<Vec<(&'static str, [f64; 3])>> {
    let config = convert::config(config)?;
    Ok(core::registration::search::candidates(&a.inner, &b.inner, &config.registration)
        .into_iter()
        .map(|c| (c.source.name(), c.t_a_b.to_array()))
        .collect())
}

/// Every map's partners by the index, the most promising first: (index, log-likelihood ratio in nats).
#[pyfunction]
pub fn partners(
    py: Python<'_>,
    maps: Vec<PyRef<'_, LocalMap>>,
    config: &str,
) -> PyResult<Vec<Vec<(usize, f64)>>> {
    let config = convert::config(config)?;
    let maps: Vec<_> = maps.iter().map(|m| (*m.inner).clone()).collect();
    Ok(py.detach(|| core::partners::ranked(&maps, &config)))
}
