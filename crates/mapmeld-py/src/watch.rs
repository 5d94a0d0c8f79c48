//! Work of the core that Python watches, and may end.

use crate::events;
use mapmeld_core::events::Event;
use mapmeld_core::result::Stage;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// How long Ctrl-C may wait to be heard.
const SIGNAL_POLL: Duration = Duration::from_millis(50);

enum Told {
    Progress(Stage, usize, usize),
    /// With the seconds since the start.
    Event(f64, Event),
}

/// What the core tells.
pub struct Tell(Sender<Told>, Instant);

impl Tell {
    /// Tells how far it is; false when nobody listens any more and the work shall end.
    pub fn tell(&self, stage: Stage, done: usize, total: usize) -> bool {
        self.0.send(Told::Progress(stage, done, total)).is_ok()
    }

    /// Tells what happened. That nobody hears it is known when the progress is told next.
    pub fn event(&self, event: Event) {
        let _ = self.0.send(Told::Event(self.1.elapsed().as_secs_f64(), event));
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
    watched_told(py, progress, None, work)
}

/// The same; `listener` is called with (name, seconds since the start, dict) of every event.
pub fn watched_told<R: Send + 'static>(
    py: Python<'_>,
    progress: Option<Py<PyAny>>,
    listener: Option<Py<PyAny>>,
    work: impl FnOnce(Tell) -> R + Send + 'static,
) -> PyResult<R> {
    let (tell, hear) = mpsc::channel();
    let worker = std::thread::spawn(move || work(Tell(tell, Instant::now())));
    let hear = Mutex::new(hear);
    loop {
        py.check_signals()?;
        let told = py.detach(|| hear.lock().expect("no other listener").recv_timeout(SIGNAL_POLL));
        match told {
            Ok(Told::Progress(stage, done, total)) => {
                if let Some(f) = &progress {
                    f.call1(py, (stage.name(), done, total))?;
                }
            }
            Ok(Told::Event(seconds, event)) => {
                if let Some(f) = &listener {
                    let (name, data) = events::to_dict(py, &event)?;
                    f.call1(py, (name, seconds, data))?;
                }
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    // A panic is a bug of the core: an exception like any other, so that callers can report it.
    py.detach(|| worker.join())
        .map_err(|_| PyRuntimeError::new_err("the core failed; please report this as a bug"))
}
