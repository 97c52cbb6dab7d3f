//! Runs: their settings, and the changes that create and modify them.
//!
//! [`settings`] has the complete settings as stored. [`run_request`] and [`change_run`] read what a client sends; both turn it into
//! settings by [`settings_update`]. The other modules have one change of the database each. A run in memory is
//! `engine::run_state`; reads for the API are in `queries`.

pub mod change_run;
pub mod create_run;
pub mod delete_run;
pub mod log_metrics;
pub mod policy_version;
pub mod retention_settings;
pub mod run_request;
pub mod run_status;
pub mod set_members;
pub mod set_note;
pub mod set_policy_version;
pub mod set_retention;
pub mod set_tags;
pub mod settings;
mod settings_update;
pub(crate) mod validate;
pub mod version_step;
