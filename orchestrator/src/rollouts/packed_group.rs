//! The stored form of a trajectory group: JSON, compressed once and unpacked as it is delivered.

use api_types::{MessageContent, ObservationContent};
use rollout::MAX_GROUP_BYTES;
use store::trajectories::FeedGroup;

use crate::rollouts::group_record::GroupRecord;

/// Maximum size of a group as JSON, in bytes, without observations and conversations.
const MAX_BARE_GROUP_BYTES: usize = 64 << 20;
/// Compression level of zstd: its own default.
const COMPRESSION_LEVEL: i32 = 3;

/// A group as it is stored.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PackedGroup {
    /// Size of the group as JSON, in bytes.
    pub bytes: usize,
    /// The JSON, compressed by zstd.
    pub body: Vec<u8>,
}

/// Error of packing or unpacking a group.
#[derive(Debug, thiserror::Error)]
pub enum PackError {
    /// The group is too large even without observations and conversations.
    #[error("the group has {} MiB of JSON without observations and conversations; the maximum is {} MiB", .0 >> 20, MAX_BARE_GROUP_BYTES >> 20)]
    TooLarge(usize),
    /// The group cannot be written as JSON.
    #[error("the group cannot be written: {0}")]
    Json(#[from] serde_json::Error),
    /// The group cannot be compressed, or the stored body is damaged.
    #[error("the group cannot be (de)compressed: {0}")]
    Zstd(#[from] std::io::Error),
}

impl GroupRecord {
    /// Packs the group. Above 16 MiB it loses its observations, then its conversations.
    ///
    /// # Errors
    /// Returns [`PackError::TooLarge`] if the group is above 64 MiB even then, and another error if it cannot be written.
    pub fn pack(mut self) -> Result<PackedGroup, PackError> {
        let mut json = serde_json::to_vec(&self)?;
        if json.len() > MAX_GROUP_BYTES && self.observations == ObservationContent::Telemetry {
            self.drop_observations();
            json = serde_json::to_vec(&self)?;
        }
        if json.len() > MAX_GROUP_BYTES && self.messages == MessageContent::Kept {
            self.drop_messages();
            json = serde_json::to_vec(&self)?;
        }
        if json.len() > MAX_BARE_GROUP_BYTES {
            return Err(PackError::TooLarge(json.len()));
        }
        Ok(PackedGroup { bytes: json.len(), body: zstd::bulk::compress(&json, COMPRESSION_LEVEL)? })
    }
}

/// Unpacks a stored group to JSON of at most `bytes` bytes, whatever is stored.
///
/// # Errors
/// Returns [`PackError::Zstd`] if the body is damaged or unpacks to more bytes.
pub fn unpack(body: &[u8], bytes: usize) -> Result<Vec<u8>, PackError> {
    Ok(zstd::bulk::decompress(body, bytes.min(MAX_BARE_GROUP_BYTES))?)
}

/// Unpacks a group of a feed to JSON with its id and its number of deliveries, as trainers receive it.
///
/// # Errors
/// Returns [`PackError::Zstd`] if the body is damaged.
pub fn feed_group_json(head: FeedGroup, body: &[u8]) -> Result<Vec<u8>, PackError> {
    let json = unpack(body, usize::try_from(head.bytes).unwrap_or(0))?;
    let mut out = format!(r#"{{"id":{},"deliveries":{},"#, head.id, head.deliveries).into_bytes();
    out.extend_from_slice(json.strip_prefix(b"{").unwrap_or(&json));
    Ok(out)
}

#[cfg(test)]
mod tests {
    use rollout::StepRecord;
    use serde_json::Value;
    use serde_json::value::RawValue;

    use super::*;
    use crate::rollouts::group_record::tests::group_with_all_fields;

    /// Group of one step whose observation has `observation` bytes of text.
    fn group(observation: usize) -> GroupRecord {
        let step = StepRecord {
            observation: RawValue::from_string(format!("\"{}\"", "x".repeat(observation))).ok(),
            action: None,
            reward: 0.5,
            agents: Vec::new(),
            done: true,
            error: None,
            completions: None,
        };
        let mut group = group_with_all_fields();
        group.episodes[0].steps = vec![step];
        group
    }

    #[test]
    fn unpacking_restores_the_json_and_respects_its_bound() {
        let json = serde_json::to_vec(&group(1000)).unwrap();
        let packed = group(1000).pack().unwrap();
        assert_eq!(packed.bytes, json.len());
        assert!(packed.body.len() < json.len() / 2);
        assert_eq!(unpack(&packed.body, packed.bytes).unwrap(), json);
        assert!(unpack(&packed.body, packed.bytes - 1).is_err(), "a larger body is not unpacked");
        assert!(unpack(b"no zstd", 100).is_err());
    }

    #[test]
    fn a_large_group_loses_its_observations() {
        let packed = group(MAX_GROUP_BYTES).pack().unwrap();
        let unpacked: Value = serde_json::from_slice(&unpack(&packed.body, packed.bytes).unwrap()).unwrap();
        assert_eq!(unpacked["observations"], "dropped");
        assert!(unpacked["episodes"][0]["steps"][0].get("observation").is_none());
        assert_eq!(unpacked["episodes"][0]["steps"][0]["reward"], 0.5);
    }
}
