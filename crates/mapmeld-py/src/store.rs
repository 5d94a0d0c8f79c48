//! Registered pairs on disk or in memory, and pairs that are registered elsewhere.

use crate::convert;
use crate::merge::{grids, Given};
use crate::watch::{watched, Tell};
use mapmeld_core::batch;
use mapmeld_core::result::Known;
use mapmeld_core::stored::{self, Store as CoreStore};
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::collections::HashMap;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// One file a pair, in folders by the first digits of its key. Files are written beside and renamed, so that a
/// process sees a whole file or none; two that write the same pair write the same bytes.
struct OnDisk {
    folder: PathBuf,
    /// Number of files that this process has begun.
    begun: AtomicU64,
    unreadable: AtomicUsize,
    unwritable: AtomicUsize,
}

impl OnDisk {
    fn path(&self, key: &str) -> PathBuf {
        self.folder.join(&key[..2]).join(format!("{key}.pair"))
    }

    fn try_write(&self, path: &Path, bytes: &[u8]) -> std::io::Result<()> {
        let folder = path.parent().expect("a folder of pairs");
        fs::create_dir_all(folder)?;
        let number = self.begun.fetch_add(1, Ordering::Relaxed);
        let beside = folder.join(format!(".{}-{number}.tmp", std::process::id()));
        let written = fs::write(&beside, bytes).and_then(|()| fs::rename(&beside, path));
        if written.is_err() {
            let _ = fs::remove_file(&beside);
        }
        written
    }
}

impl CoreStore for OnDisk {
    fn read(&self, key: &str) -> Option<Vec<u8>> {
        match fs::read(self.path(key)) {
            Ok(bytes) => Some(bytes),
            Err(e) => {
                if e.kind() != ErrorKind::NotFound {
                    self.unreadable(key);
                }
                None
            }
        }
    }

    fn write(&self, key: &str, bytes: &[u8]) {
        if self.try_write(&self.path(key), bytes).is_err() {
            self.unwritable.fetch_add(1, Ordering::Relaxed);
        }
    }

    fn unreadable(&self, _key: &str) {
        self.unreadable.fetch_add(1, Ordering::Relaxed);
    }
}

#[derive(Default)]
struct InMemory(Mutex<HashMap<String, Vec<u8>>>);

impl InMemory {
    fn pairs(&self) -> MutexGuard<'_, HashMap<String, Vec<u8>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl CoreStore for InMemory {
    fn read(&self, key: &str) -> Option<Vec<u8>> {
        self.pairs().get(key).cloned()
    }
    fn write(&self, key: &str, bytes: &[u8]) {
        self.pairs().insert(key.to_owned(), bytes.to_vec());
    }
    fn unreadable(&self, _key: &str) {}
}

enum Kind {
    OnDisk(Arc<OnDisk>),
    InMemory(Arc<InMemory>),
}

/// Registered pairs by their keys: in a folder, or in memory without one.
#[pyclass(module = "mapmeld._core", frozen)]
pub struct Store(Kind);

impl Store {
    pub fn shared(&self) -> Arc<dyn CoreStore> {
        match &self.0 {
            Kind::OnDisk(store) => store.clone(),
            Kind::InMemory(store) => store.clone(),
        }
    }
}

#[pymethods]
impl Store {
    #[new]
    #[pyo3(signature = (folder=None))]
    fn new(folder: Option<PathBuf>) -> PyResult<Self> {
        let Some(folder) = folder else { return Ok(Self(Kind::InMemory(Arc::default()))) };
        fs::create_dir_all(&folder).map_err(PyOSError::new_err)?;
        Ok(Self(Kind::OnDisk(Arc::new(OnDisk {
            folder,
            begun: AtomicU64::new(0),
            unreadable: AtomicUsize::new(0),
            unwritable: AtomicUsize::new(0),
        }))))
    }

    /// Keeps the bytes of a pair.
    fn put(&self, key: &str, bytes: &[u8]) {
        self.shared().write(key, bytes);
    }

    /// Whether the pair is kept, and whole.
    fn has(&self, py: Python<'_>, key: &str) -> bool {
        let store = self.shared();
        py.detach(|| store.read(key).is_some_and(|bytes| stored::decode(&bytes, (0, 1)).is_some()))
    }

    /// How many pairs could not be read since the store was made, and how many not be written.
    fn failures(&self) -> (usize, usize) {
        match &self.0 {
            Kind::OnDisk(s) => {
                (s.unreadable.load(Ordering::Relaxed), s.unwritable.load(Ordering::Relaxed))
            }
            Kind::InMemory(_) => (0, 0),
        }
    }
}

/// Transforms as Python has them.
type Hints = Vec<[f64; 3]>;

/// The pairs that a merge of maps begins with: (first, second, hints, key); maps are given as to merge.
#[pyfunction]
#[pyo3(signature = (maps, config, order=None, progress=None))]
pub fn plan(
    py: Python<'_>,
    maps: Vec<Given<'_>>,
    config: &str,
    order: Option<Vec<usize>>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Vec<(usize, usize, Hints, String)>> {
    let (config, grids) = (convert::config(config)?, grids(maps)?);
    let known = Known { order, ..Known::default() };
    let work =
        move |tell: Tell| batch::plan(&grids, &known, &config, &|s, d, t| tell.tell(s, d, t));
    let found = watched(py, progress, work)?.map_err(convert::to_py_err)?;
    let hints = |p: &batch::Planned| p.hints.iter().map(|t| t.to_array()).collect();
    Ok(found.into_iter().map(|p| (p.a, p.b, hints(&p), p.key)).collect())
}

/// Registers pairs of maps, (first, second, hints), each as the bytes that a store keeps.
#[pyfunction]
pub fn register_batch<'py>(
    py: Python<'py>,
    maps: Vec<Given<'py>>,
    pairs: Vec<(usize, usize, Hints)>,
    config: &str,
) -> PyResult<Vec<Bound<'py, PyBytes>>> {
    let (config, grids) = (convert::config(config)?, grids(maps)?);
    let posed = |hints: Hints| hints.into_iter().map(convert::pose).collect();
    let pairs: Vec<_> = pairs.into_iter().map(|(a, b, hints)| (a, b, posed(hints))).collect();
    let found = py.detach(|| batch::register(&grids, &pairs, &config, &|_, _, _| true));
    Ok(found.map_err(convert::to_py_err)?.iter().map(|bytes| PyBytes::new(py, bytes)).collect())
}

/// What the keys of a configuration have in common: cores that say the same register alike.
#[pyfunction]
pub fn registration_digest(config: &str) -> PyResult<String> {
    let root = stored::root(&convert::config(config)?);
    Ok(root.iter().map(|byte| format!("{byte:02x}")).collect())
}
