//! Retention: old leases are compacted, and rows that nothing refers to are deleted.
//!
//! Each module has one change of the database or a setting; `workers::retention` decides when they run. Start reading at [`compact_leases`].

pub mod archived;
pub mod collect_garbage;
pub mod compact_leases;
pub mod delete_old_minutes;
pub mod delete_run_rows;
mod move_evidence;
