//! Value of a slot, from the counts of its group.

use curriculum::{EpisodeTally, SuccessInterval};
use store::groups::GroupRow;
use store::to_u32;

/// Returns the interval of success rates that the results of a group allow.
pub(crate) fn slot_value(group: &GroupRow, group_size: i64) -> SuccessInterval {
    SuccessInterval::of_episodes(EpisodeTally {
        size: to_u32(group_size),
        finished: to_u32(group.counted),
        successes: to_u32(group.counted_successes),
        abandoned: to_u32(group.abandoned),
    })
}
