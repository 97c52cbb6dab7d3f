//! The fast path: a lease of up to 100 000 episodes, named by recipes with ranges of seeds, without brackets; its results are columns.
//!
//! The columns of a trainer are a claim, a statistic without proof. The server draws the groups to audit with the lease, by the
//! system's randomness, and discloses them once the columns are stored. Their logs are due before the lease ends. If all of them
//! replay as claimed, the claim is accepted, and the audited groups are groups like any other: bracketed, counted, and evidence of
//! mastery. A log with another score refuses the whole claim and adds a warning to the run. A claim whose logs never arrive stays
//! unproven. The sampled groups of a lease that ends in another way are missing, so a trainer gains nothing by an early end.
//!
//! Start reading at [`claim`] (storing), then [`sample`] (the audited groups) and [`settle`] (the end of a claim). The sample is drawn
//! in `leases/audit_sample`.

pub(crate) mod check;
pub mod claim;
mod sample;
pub(crate) mod settle;
pub mod status;
pub mod table;
