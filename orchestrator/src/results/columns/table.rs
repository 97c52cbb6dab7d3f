//! Columns: the claimed results of all episodes of a lease, one entry per episode, in order.

use store::columns::{RangeTotals, SeedRangeRow};
use store::{StoreError, digest};

use crate::engine::error::ServiceError;
use crate::leases::columns::MAX_COLUMN_GROUPS;

/// Codec of stored columns: zstd of the scores (f32), the steps (u32, if claimed), and one byte per episode that says whether it failed
/// (if any did).
const CODEC: u8 = 1;
/// Level of zstd: scores hardly compress at any level, and the rest compresses at every level.
const ZSTD_LEVEL: i32 = 1;

/// Claimed results of the episodes of a lease.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Columns {
    /// Score of each episode.
    pub scores: Vec<f32>,
    /// True for each episode that the infrastructure lost; empty if none was lost.
    pub failed: Vec<bool>,
    /// Steps of each episode; empty if the trainer does not report them.
    pub steps: Vec<u32>,
}

impl Columns {
    /// True if the infrastructure lost the episode.
    #[must_use]
    pub fn has_failed(&self, index: usize) -> bool {
        self.failed.get(index).copied().unwrap_or(false)
    }

    /// Checks that each column has an entry for each of the `episodes`, and that every score is finite.
    ///
    /// # Errors
    /// Returns [`ServiceError::Invalid`] with the column, and the index, at fault.
    pub fn check(&self, episodes: usize) -> Result<(), ServiceError> {
        let lengths = [
            ("score", self.scores.len(), false),
            ("failed", self.failed.len(), true),
            ("steps", self.steps.len(), true),
        ];
        for (column, length, optional) in lengths {
            if length != episodes && !(optional && length == 0) {
                let why =
                    format!("must have {episodes} entries, one for each episode of the lease, got {length}");
                return Err(ServiceError::invalid(column, why));
            }
        }
        match self.scores.iter().position(|score| !score.is_finite()) {
            Some(at) => Err(ServiceError::invalid(format!("score.{at}"), "must be a finite number")),
            None => Ok(()),
        }
    }

    /// Returns the canonical form: the column `failed` is empty if no episode failed.
    #[must_use]
    pub fn canonical(mut self) -> Self {
        if !self.failed.contains(&true) {
            self.failed.clear();
        }
        self
    }

    /// Returns a digest, which tells repeated columns from contradicting ones.
    #[must_use]
    pub fn digest(&self) -> Vec<u8> {
        digest(&self.bytes()).to_vec()
    }

    fn bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(12 + self.scores.len() * 9);
        for length in [self.scores.len(), self.steps.len(), self.failed.len()] {
            bytes.extend_from_slice(&u32::try_from(length).unwrap_or(u32::MAX).to_le_bytes());
        }
        self.scores.iter().for_each(|score| bytes.extend_from_slice(&score.to_le_bytes()));
        self.steps.iter().for_each(|steps| bytes.extend_from_slice(&steps.to_le_bytes()));
        bytes.extend(self.failed.iter().map(|&failed| u8::from(failed)));
        bytes
    }

    /// Encodes the columns for the store.
    ///
    /// # Errors
    /// Returns [`StoreError::Corrupt`] if the compression fails.
    pub fn encode(&self) -> Result<Vec<u8>, StoreError> {
        let packed = zstd::bulk::compress(&self.bytes(), ZSTD_LEVEL)
            .map_err(|error| StoreError::corrupt("columns", error))?;
        Ok([&[CODEC][..], &packed].concat())
    }
}

/// Returns the indices of a range's episodes in the lease.
pub(crate) fn range_episodes(range: &SeedRangeRow, group_size: usize) -> std::ops::Range<usize> {
    let at = |group: i64| usize::try_from(group).unwrap_or_default() * group_size;
    at(range.first_group)..at(range.first_group + range.groups)
}

/// Returns the totals of the claimed episodes of a range.
pub(crate) fn range_totals(columns: &Columns, range: &SeedRangeRow, group_size: usize) -> RangeTotals {
    let mut totals = RangeTotals { number: range.number, finished: 0, failed: 0, score_sum: 0.0 };
    for at in range_episodes(range, group_size) {
        if columns.has_failed(at) {
            totals.failed += 1;
        } else {
            totals.finished += 1;
            totals.score_sum += f64::from(columns.scores[at]);
        }
    }
    totals
}

/// Decodes stored columns.
///
/// # Errors
/// Returns [`StoreError::Corrupt`] if the bytes are no columns.
pub fn decode(stored: &[u8]) -> Result<Columns, StoreError> {
    let broken = |why: &str| StoreError::corrupt("columns", why);
    let Some((&CODEC, packed)) = stored.split_first() else { return Err(broken("the codec is unknown")) };
    let max_bytes = 12 + MAX_COLUMN_GROUPS as usize * 9;
    let bytes =
        zstd::bulk::decompress(packed, max_bytes).map_err(|error| StoreError::corrupt("columns", error))?;
    let (head, rest) = bytes.split_first_chunk::<12>().ok_or_else(|| broken("the data ends too early"))?;
    let mut lengths = head.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
    let (scores, steps, failed) =
        (lengths.next().unwrap_or(0), lengths.next().unwrap_or(0), lengths.next().unwrap_or(0));
    if rest.len() != scores * 4 + steps * 4 + failed {
        return Err(broken("the lengths of the columns contradict the data"));
    }
    let (score_bytes, rest) = rest.split_at(scores * 4);
    let (step_bytes, failed_bytes) = rest.split_at(steps * 4);
    let words = |bytes: &[u8]| bytes.chunks_exact(4).map(|b| [b[0], b[1], b[2], b[3]]).collect::<Vec<_>>();
    Ok(Columns {
        scores: words(score_bytes).into_iter().map(f32::from_le_bytes).collect(),
        steps: words(step_bytes).into_iter().map(u32::from_le_bytes).collect(),
        failed: failed_bytes.iter().map(|&byte| byte != 0).collect(),
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn encoded_columns_decode_to_themselves(scores in proptest::collection::vec(-1.0f32..2.0, 0..200), steps: bool, failed: bool) {
            let n = scores.len();
            let steps = if steps { (0..n as u32).collect() } else { Vec::new() };
            let failed = if failed { (0..n).map(|i| i % 3 == 0).collect() } else { Vec::new() };
            let columns = Columns { scores, failed, steps };
            prop_assert_eq!(decode(&columns.encode().unwrap()).unwrap(), columns.clone());
            prop_assert!(columns.check(n).is_ok());
            prop_assert!(columns.check(n + 1).is_err());
        }

        #[test]
        fn no_stored_bytes_cause_a_panic(bytes: Vec<u8>) {
            let _ = decode(&bytes);
            let mut framed = vec![CODEC];
            framed.extend(zstd::bulk::compress(&bytes, ZSTD_LEVEL).unwrap());
            let _ = decode(&framed);
        }
    }

    #[test]
    fn invalid_entries_are_refused_with_their_field() {
        let columns = Columns { scores: vec![0.5, f32::NAN], ..Columns::default() };
        let ServiceError::Invalid { field, .. } = columns.check(2).unwrap_err() else { panic!() };
        assert_eq!(field, "score.1");
        let columns = Columns { scores: vec![0.5; 2], steps: vec![1], ..Columns::default() };
        let ServiceError::Invalid { field, .. } = columns.check(2).unwrap_err() else { panic!() };
        assert_eq!(field, "steps");
    }
}
