//! Entries of the journal as Python tuples.

use env_core::tasking::simulation::journal::{JournalEntry, SatelliteEvent};
use pyo3::prelude::*;
use pyo3::types::PyTuple;

/// The tuple of an entry: kind, time, satellite, and what the kind has.
///
/// # Errors
/// Returns Python's error if it cannot make the tuple.
pub(super) fn entry_tuple<'py>(py: Python<'py>, entry: &JournalEntry) -> PyResult<Bound<'py, PyTuple>> {
    let JournalEntry { time_s, satellite, event } = *entry;
    match event {
        SatelliteEvent::Search { from_s, to_s } => {
            ("windows", time_s, satellite, from_s, to_s).into_pyobject(py)
        }
        SatelliteEvent::Tasked { target, open_s, close_s } => {
            ("tasked", time_s, satellite, target, open_s, close_s).into_pyobject(py)
        }
        SatelliteEvent::Imaged { target } => ("imaged", time_s, satellite, target).into_pyobject(py),
        SatelliteEvent::Missed { target } => ("missed", time_s, satellite, target).into_pyobject(py),
        SatelliteEvent::TimeUp => ("timed", time_s, satellite).into_pyobject(py),
    }
}
