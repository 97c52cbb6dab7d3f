//! Results: reported episodes are replayed and stored, and closed groups are passed to the curriculum.
//!
//! Start reading at [`audit`] (replay), then [`report`] (storing, in one change) and [`close`] (effects of a closed group).
//! [`columns`] is the fast path of results as columns.

pub mod audit;
pub mod audit_outcome;
pub mod close;
pub mod columns;
pub mod correct_results;
pub mod episode_lookup;
pub mod episode_row;
pub mod observe;
pub mod receipt;
pub mod refusal;
pub mod report;
pub mod report_batch;
pub mod report_order;
pub mod report_summary;
pub mod reported;
mod score_tolerance;
pub(crate) mod slot_value;
pub(crate) mod stalled;
pub mod store_verdict;

pub(crate) use self::score_tolerance::score_tolerance;
