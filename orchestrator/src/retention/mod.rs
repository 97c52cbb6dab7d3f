//! Retention: old leases are compacted and unreferenced rows are deleted.

pub mod forget_minutes;
pub mod compact_leases;
