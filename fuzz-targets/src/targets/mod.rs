//! All targets, one file for each group of parsers.
//!
//! A new parser gets a target in the file of its group, and its name in `tests/mutations/main.rs` and `fuzz/Cargo.toml`.

mod command_line;
mod curricula;
mod designs;
mod models;
mod openenv;
mod policy_files;
mod requests;
mod stored;
mod strict_input;
pub mod tasking;
mod worker_messages;
mod worlds;

use std::sync::LazyLock;

use crate::target::Target;

/// All targets, group by group.
pub static TARGETS: LazyLock<Vec<Target>> = LazyLock::new(|| {
    [
        strict_input::TARGETS,
        openenv::TARGETS,
        worlds::TARGETS,
        tasking::TARGETS,
        requests::TARGETS,
        stored::TARGETS,
        curricula::TARGETS,
        designs::TARGETS,
        models::TARGETS,
        command_line::TARGETS,
        policy_files::TARGETS,
        worker_messages::TARGETS,
    ]
    .concat()
});
