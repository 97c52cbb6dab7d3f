//! Entries of the journal as Python tuples.

use env_core::tasking::simulation::journal::{Happening, JournalEntry};
use pyo3::prelude::*;
use pyo3::types::PyTuple;

/// The tuple of an entry: kind, time, satellite, and what the kind has.
///
/// # Errors
/// Returns Python's error if it cannot make the tuple.
pub(super) fn entry_tuple<'py>(py: Python<'py>, entry: &JournalEntry) -> PyResult<Bound<'py, PyTuple>> {
    let JournalEntry { time_s, satellite, happening } = *entry;
    match happening {
        Happening::Search { from_s, to_s } => ("windows", time_s, satellite, from_s, to_s).into_pyobject(py),
        Happening::Tasked { target, open_s, close_s } => {
            ("tasked", time_s, satellite, target, open_s, close_s).into_pyobject(py)
        }
        Happening::Imaged { target } => ("imaged", time_s, satellite, target).into_pyobject(py),
        Happening::Missed { target } => ("missed", time_s, satellite, target).into_pyobject(py),
        Happening::TimeUp => ("timed", time_s, satellite).into_pyobject(py),
    }
}
