//! The worlds for Python. Arrays are written in place, with the interpreter's lock let go; everything else goes through JSON.

mod arrays;
mod batch;
mod curriculum;
mod errors;
mod feed;
mod picture;
mod pool;
mod scenario;
mod state;
mod tasks;

use pyo3::prelude::pymodule;

/// What `sparring` is built on. Import `sparring` instead.
#[pymodule]
mod _native {
    #[pymodule_export]
    use super::batch::NativeBatch;
    #[pymodule_export]
    use super::curriculum::{CurriculumError, NativeCurriculum, NativeLink, is_local};
    #[pymodule_export]
    use super::scenario::{NativeScenario, bracket, critique, fly, replay};
    #[pymodule_export]
    use super::tasks::{NativePolicy, card, tasks};

    /// The version of the wheel.
    #[pymodule_export]
    #[expect(non_upper_case_globals, reason = "Python's name for it")]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
