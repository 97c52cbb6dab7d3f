//! The fast path: a lease of up to 100 000 episodes, named by recipes with ranges of seeds, drawn as they come and without
//! brackets; their results are columns.
//!
//! What a trainer claims in columns is a statistic. Once its columns are on disk it is told which groups are audited, drawn
//! then by the system's randomness; their logs are due within the lease's time. When all of them have replayed to what was
//! claimed, the audited groups are groups like any other: bracketed, counted, and evidence for mastery. One log that replays
//! to another score refuses the whole claim and marks the run; logs that never come leave it unproven, and it counts for
//! nothing either: who withholds what does not replay gains nothing by it.

mod claim;
mod lease;
mod settle;
mod table;

pub(super) use self::claim::is_claimed;
pub use self::claim::{Claimed, claim, entries, standing};
pub use self::lease::{MAX_GROUPS, TakeColumns, recipe_and_seed};
pub(super) use self::settle::{Check, abandon, check, refuse, settle};
use self::table::decode;
pub use self::table::{Columns, MOST_SCORE_GAP};

/// Ranges of a lease: as many proposals are asked of the curriculum for it.
const RANGES: u32 = 64;
