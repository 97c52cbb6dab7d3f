//! The store: all SQL of the service, in one file for each family of tables.
//!
//! Functions take a connection and read or write rows; they make no decisions. Transactions are begun and committed by the writer
//! (`engine`). Rows are typed: words are enums ([`text_enum`](mod@text_enum)), flags are `bool`, keys are [`keys`]. Columns have
//! the names of the fields of their row types; each file says which tables it reads and writes.
//!
//! Start reading at [`runs`], [`leases`], [`groups`] and [`episodes`]. [`open`](mod@open) opens a database, [`gc`] deletes what is
//! not needed any more, and the test `query_plans` keeps statements from reading whole tables.

pub mod alert_conditions;
pub mod alerts;
pub mod audit_log;
pub mod audit_samples;
mod backup;
pub mod backup_list;
pub mod brackets;
pub mod columns;
pub mod compacted_leases;
pub mod corrections;
pub mod critiques;
pub mod curriculum;
pub mod deadlines;
pub mod design_counters;
pub mod design_queue;
pub mod design_requests;
pub mod episode_search;
pub mod episodes;
mod error;
pub mod evaluations;
pub mod events;
pub mod failure_sectors;
pub mod failures;
pub mod feeds;
mod file_watch;
#[doc(hidden)]
pub mod fuzzing;
pub mod gc;
pub mod group_counters;
pub mod group_results;
pub mod group_slots;
pub mod groups;
pub mod history;
pub mod ids;
pub mod integrity;
pub mod keys;
pub mod layout_outcomes;
pub mod layout_transitions;
pub mod layouts;
pub mod learning_signals;
pub mod leases;
pub mod listed_episodes;
pub mod llm_spend;
mod lock;
pub mod logged_episodes;
pub mod name_set;
mod open;
mod open_error;
pub mod overview;
mod pack;
pub mod policy_versions;
pub mod principals;
pub mod progress;
pub mod proposals;
#[cfg(test)]
mod query_plans;
pub mod refills;
pub mod retention;
pub mod role;
pub mod run_deletion;
pub mod run_filter;
pub mod run_list;
pub mod run_policies;
pub mod run_tags;
pub mod run_totals;
pub mod run_warnings;
pub mod runs;
pub mod scenario_use;
pub mod scenarios;
#[cfg(test)]
mod schema_changes;
pub mod servable_layouts;
pub mod shard;
pub mod step_verdicts;
#[cfg(test)]
mod stored_words;
pub mod task_counters;
mod text_enum;
pub mod token_cache;
pub mod tokens;
pub mod trainer_metrics;
pub mod trajectories;
pub mod transactions;
pub mod views;
pub mod write_probe;

pub use backup::copy;
pub use clock::Millis;
pub use error::{Outage, StoreError};
pub use file_watch::FileState;
pub use lock::DatabaseLock;
pub use open::{checkpoint, open_current_readers, open_maintenance, open_readers, open_writer, vacuum};
pub use open_error::OpenError;
pub use text_enum::UnknownWord;
pub(crate) use text_enum::text_enum;

/// Rows that one statement writes at most. Each statement is a round trip between two threads, and each number of rows is a
/// statement to prepare.
pub(crate) const MAX_ROWS: usize = 64;

/// Serialises a value to be stored as JSON.
///
/// # Errors
/// Returns [`StoreError::Corrupt`] if the value cannot be JSON, such as a map whose keys are not texts.
pub fn to_json<T: serde::Serialize>(value: &T) -> Result<String, StoreError> {
    serde_json::to_string(value).map_err(|error| StoreError::corrupt("a value", error))
}

/// Parses stored JSON. `item` is what error messages call the value.
///
/// # Errors
/// Returns [`StoreError::Corrupt`] if the text is not valid JSON of this type.
pub fn from_json<T: serde::de::DeserializeOwned>(item: &'static str, text: &str) -> Result<T, StoreError> {
    serde_json::from_str(text).map_err(|error| StoreError::corrupt(item, error))
}

/// Ids as a JSON list of hexadecimal texts, for a statement that reads them with `unhex(value)` from `json_each`.
///
/// One statement for many ids is faster: each statement is a round trip between two threads.
pub(crate) fn hex_list<T: AsRef<[u8]>>(ids: &[T]) -> Result<String, StoreError> {
    let hex = |id: &T| id.as_ref().iter().map(|byte| format!("{byte:02x}")).collect::<String>();
    to_json(&ids.iter().map(hex).collect::<Vec<_>>())
}

/// Digest that tells reports from each other.
#[must_use]
pub fn digest(bytes: &[u8]) -> [u8; 16] {
    let mut digest = [0; 16];
    digest.copy_from_slice(&blake3::hash(bytes).as_bytes()[..16]);
    digest
}

/// Converts a sequence number or seed to SQLite's signed integers. Both are below 2⁵³.
#[must_use]
pub fn to_i64(value: u64) -> i64 {
    i64::try_from(value).unwrap_or(i64::MAX)
}

/// Converts a stored sequence number or seed back; a negative number, which is never stored, gives 0.
#[must_use]
pub fn to_u64(value: i64) -> u64 {
    u64::try_from(value).unwrap_or(0)
}

/// Converts a stored count; a negative number or one above 2³² − 1, which are never stored, gives 0.
#[must_use]
pub fn to_u32(value: i64) -> u32 {
    u32::try_from(value).unwrap_or(0)
}
