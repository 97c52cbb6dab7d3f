//! Locks that are taken with and without the interpreter lock.

use std::sync::{Mutex, MutexGuard, PoisonError};

use pyo3::prelude::*;
use pyo3::sync::MutexExt;

/// Locks a mutex in a thread that has released the interpreter lock.
pub(super) fn lock_detached<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // After a panic in a step, the batch itself rejects further steps.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Locks a mutex in a thread that holds the interpreter lock, which it releases while it waits.
///
/// The holder of the mutex may be waiting for the interpreter lock, so keeping it would deadlock.
pub(super) fn lock_attached<'a, T>(py: Python<'_>, mutex: &'a Mutex<T>) -> MutexGuard<'a, T> {
    mutex.lock_py_attached(py).unwrap_or_else(PoisonError::into_inner)
}
