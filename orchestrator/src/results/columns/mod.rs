//! The fast path: a lease of up to 100 000 episodes, named by recipes with ranges of seeds, without brackets; its results are columns.
//!
//! The columns of a trainer are a claim, a statistic without proof. Once they are stored, the server draws groups to audit by the
//! system's randomness, and their logs are due before the lease ends. If all of them replay as claimed, the claim is accepted, and
//! the audited groups are groups like any other: bracketed, counted, and evidence of mastery. A log with another score refuses the
//! whole claim and adds a warning to the run. A claim whose logs never arrive stays unproven and counts for nothing, so that a
//! trainer gains nothing by withholding logs.
//!
//! Start reading at [`claim`] (storing), then [`draw`] (the audit sample) and [`settle`] (the end of a claim).

pub(crate) mod check;
pub mod claim;
mod draw;
pub(crate) mod settle;
pub mod status;
pub mod table;
