//! Runs: their settings, and the use cases that create and change them.

pub mod change_run;
pub mod create_run;
pub mod settings_schema;
pub mod settings;
pub mod run_status;
pub mod policy_version;
