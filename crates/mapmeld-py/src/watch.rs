//! Work of the core that Python watches, and may end.

use mapmeld_core::result::Stage;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::sync::Mutex;
use std::time::Duration;

/// How long Ctrl-C may wait to be heard.
const SIGNAL_POLL: Duration = Duration::from_millis(50);

/// What the core tells, as (stage, done, total).
pub struct Tell(Sender<(Stage, usize, usize)>);

impl Tell {
    /// Tells; false when nobody listens any more and the work shall end.
    pub fn tell(&self, stage: Stage, done: usize, total: usize) -> bool {
        self.0.send((stage, done, total)).is_ok()
    }
}

/// The core works on a thread of its own and never needs the interpreter; the calling thread, the
/// only one that may hear of signals, waits for what the core tells. When it leaves early (Ctrl-C,
/// or `progress` raised) the core learns so at its next piece of work, because nobody hears it.
pub fn watched<R: Send + 'static>(
    py: Python<'_>,
    progress: Option<Py<PyAny>>,
    work: impl FnOnce(Tell) -> R + Send + 'static,
) -> PyResult<R> {
    let (tell, hear) = mpsc::channel();
    let worker = std::thread::spawn(move || work(Tell(tell)));
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
    py.detach(|| worker.join())
        .map_err(|_| PyRuntimeError::new_err("the core failed; please report this as a bug"))
}
