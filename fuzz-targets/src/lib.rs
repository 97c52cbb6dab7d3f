//! Fuzz targets of all parsers of bytes and text that come from clients, files, the database, models and the command line.
//!
//! A [`Target`] feeds bytes to one parser, or to a few parsers of the same text, and checks a law: no input makes it panic,
//! and, where there is one, that a parsed value has the documented form or survives being written and parsed again.
//!
//! - [`targets`] has one file for each group of parsers, and [`TARGETS`] lists all targets.
//! - [`driver`] runs a target on mutated [`corpus`] inputs without coverage; `tests/mutations/main.rs` runs all of them.
//! - [`mutation`] has the mutations, which the system tests use as well.
//!
//! The folder `fuzz/` runs the same targets under libFuzzer. Start reading at [`Target`].

pub mod corpus;
pub mod driver;
pub mod mutation;
pub mod random;
mod target;
pub mod targets;

pub use self::target::Target;
pub use self::targets::TARGETS;

/// Returns the target with a name, or `None` if there is none.
#[must_use]
pub fn find(name: &str) -> Option<&'static Target> {
    TARGETS.iter().find(|target| target.name == name)
}
