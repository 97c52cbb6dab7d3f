//! A bucket of a learning curve.

use serde::{Deserialize, Serialize};

use super::HistoryBucket;
use crate::Millis;

/// Results of a task in consecutive episodes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CurvePoint {
    /// Number of the task's episodes before the point.
    pub first_episode: i64,
    /// Number of episodes in the point: finished, or of accepted claims.
    pub episodes: i64,
    /// Number of environment steps of the task's finished episodes before the point.
    pub first_step: i64,
    /// Time of the first results, milliseconds since 1970-01-01 UTC.
    pub first_at: Millis,
    /// Time of the latest results, milliseconds since 1970-01-01 UTC.
    pub last_at: Millis,
    /// Results of the task in the point.
    pub bucket: HistoryBucket,
}

impl CurvePoint {
    /// The point after `earlier`, or the first one of a curve.
    pub(super) fn after(earlier: Option<&Self>, now: Millis, part: &HistoryBucket) -> Self {
        Self {
            first_episode: earlier.map_or(0, |at| at.first_episode + at.episodes),
            episodes: 0,
            first_step: earlier.map_or(0, |at| at.first_step + at.bucket.steps),
            first_at: now,
            last_at: now,
            bucket: HistoryBucket::default(),
        }
        .joined_with(now, part)
    }

    /// Adds results of the moment `now`.
    pub(super) fn joined_with(mut self, now: Millis, part: &HistoryBucket) -> Self {
        self.episodes += part.episodes + part.claimed_episodes;
        // The clock may have been set back.
        self.last_at = self.last_at.max(now);
        self.bucket.join(part);
        self
    }

    /// Adds the next point.
    pub(super) fn join(&mut self, later: &Self) {
        self.episodes += later.episodes;
        self.last_at = self.last_at.max(later.last_at);
        self.bucket.join(&later.bucket);
    }
}
