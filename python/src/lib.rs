//! Native module of the Python package `sparring`, `sparring._native`.
//!
//! Environments write NumPy arrays in place, with the interpreter lock released. Everything else crosses the boundary as
//! JSON. The public API is the Python code in `python/sparring`; nothing here is meant to be imported by users.
//!
//! Start with [`batch`], which steps environments, and [`curriculum`], which leases their episodes from a server.

mod arrays;
mod batch;
mod batch_state;
mod curriculum;
mod errors;
mod renderer;
mod scenario;
mod scenario_sequence;
mod step_threads;
mod tasking;
mod tasks;

use pyo3::prelude::pymodule;

/// Compiled part of `sparring`. Import `sparring` instead.
#[pymodule]
mod _native {
    #[pymodule_export]
    use super::batch::NativeBatch;
    #[pymodule_export]
    use super::curriculum::{
        CurriculumError, NativeCurriculum, NativeHttpClient, is_loopback, server_version_problem,
    };
    #[pymodule_export]
    use super::scenario::{NativeScenario, bracket, critique, replay, rollout};
    #[pymodule_export]
    use super::tasking::{NativeTaskingBatch, NativeTaskingEpisode, NativeTaskingStep};
    #[pymodule_export]
    use super::tasks::{NativePolicy, task_info, tasks};

    /// Version of the wheel.
    #[pymodule_export]
    #[expect(non_upper_case_globals, reason = "Python's name for it")]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
