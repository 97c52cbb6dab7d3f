//! Keys of rows that are numbered within their lease.

use serde::{Serialize, Serializer};

/// Key of an episode. It is serialised as `[lease, number]`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct EpisodeKey {
    /// Number of the lease.
    pub lease: i64,
    /// Index of the episode in the lease, from 0.
    pub number: i64,
}

/// Key of a group. It is serialised as `[lease, number]`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct GroupKey {
    /// Number of the lease.
    pub lease: i64,
    /// Index of the group in the lease, from 0.
    pub number: i64,
}

/// Consecutive episodes of a lease. They are serialised as `[lease, from, to]`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EpisodeSpan {
    /// Number of the lease.
    pub lease: i64,
    /// Index of the first episode.
    pub from: i64,
    /// Index after the last episode.
    pub to: i64,
}

impl Serialize for EpisodeKey {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        (self.lease, self.number).serialize(serializer)
    }
}

impl Serialize for GroupKey {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        (self.lease, self.number).serialize(serializer)
    }
}

impl Serialize for EpisodeSpan {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        (self.lease, self.from, self.to).serialize(serializer)
    }
}
