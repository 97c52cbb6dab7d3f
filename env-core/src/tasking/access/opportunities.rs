//! The list of upcoming opportunities with the semantics of BSK-RL's `AccessSatellite`.
//!
//! Opportunities are computed in blocks of time and sorted by their close; ties are in the order of insertion. A window that
//! crosses the end of the computed time is cut there, and joined with its rest when the next block is computed.
//!
//! The windows of a block are those of [`WindowSearch`], between its first and its last sample of the trajectory.

use super::finder::AccessWindow;
use super::locations::Locations;
use super::trajectory::SearchedTrajectory;
use super::window_search::WindowSearch;

/// Windows that close less than this after the current time have closed, s.
const CLOSED_TOLERANCE_S: f64 = 1e-12;

/// Kind of an opportunity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum OpportunityKind {
    /// A target can be imaged.
    Target,
    /// A ground station can receive data.
    GroundStation,
}

/// A time during which an object is accessible.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Opportunity {
    /// Kind of the object.
    pub kind: OpportunityKind,
    /// Index of the object among those of its kind.
    pub object: usize,
    /// Time of opening, s.
    pub open_s: f64,
    /// Time of closing, s.
    pub close_s: f64,
}

/// Opportunities of a satellite in the order of their close.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct OpportunityList {
    /// Opportunities of each kind, in order.
    items: [Vec<Opportunity>; 2],
    /// Time up to which opportunities are computed, s.
    computed_s: f64,
}

impl OpportunityList {
    /// All opportunities so far, in order.
    #[must_use]
    pub fn all(&self) -> Vec<Opportunity> {
        let mut all = self.items.concat();
        all.sort_by(|a, b| a.close_s.total_cmp(&b.close_s));
        all
    }

    /// Time up to which opportunities are computed, s.
    #[must_use]
    pub const fn computed_s(&self) -> f64 {
        self.computed_s
    }

    /// Opportunities of a kind that have not closed at a time, s.
    #[must_use]
    pub fn upcoming(&self, kind: OpportunityKind, now_s: f64) -> &[Opportunity] {
        let items = &self.items[kind as usize];
        &items[items.partition_point(|item| item.close_s < now_s + CLOSED_TOLERANCE_S)..]
    }

    /// End of the block that a computation of `duration_s` more would fill, s; `None` if it computes nothing.
    #[must_use]
    pub fn next_block_end(&self, duration_s: f64, generation_s: f64) -> Option<f64> {
        /// Two steps of the trajectory that BSK-RL searches.
        const MIN_DURATION_S: f64 = 60.0;
        if duration_s <= 0.0 {
            return None;
        }
        let end = self.computed_s + duration_s.max(MIN_DURATION_S).max(generation_s);
        Some(generation_s * (end / generation_s).ceil())
    }

    /// Adds the windows of locations in the block up to `end_s`. The trajectory must extend to it.
    pub fn add_block(
        &mut self,
        end_s: f64,
        places: [(OpportunityKind, &Locations); 2],
        trajectory: &SearchedTrajectory,
    ) {
        let block = trajectory.block(self.computed_s, end_s);
        for (kind, locations) in places {
            let items = &mut self.items[kind as usize];
            for window in WindowSearch::new(locations, trajectory, block).windows() {
                let AccessWindow { location: object, open_s, close_s } = window;
                join_or_push(items, Opportunity { kind, object, open_s, close_s }, block.start_s());
            }
            // The sort is stable: a new opportunity comes after those that close at the same time.
            items.sort_by(|a, b| a.close_s.total_cmp(&b.close_s));
        }
        self.computed_s = end_s;
    }
}

/// Appends an opportunity. One that begins with the block is joined with the part that ended there.
fn join_or_push(items: &mut Vec<Opportunity>, mut item: Opportunity, block_start_s: f64) {
    if item.open_s == block_start_s {
        let earlier =
            items.iter().position(|other| other.object == item.object && other.close_s == item.open_s);
        if let Some(index) = earlier {
            item.open_s = items.remove(index).open_s;
        }
    }
    items.push(item);
}
