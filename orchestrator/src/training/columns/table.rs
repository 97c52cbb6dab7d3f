//! Columns: what is claimed of all episodes of a lease, one entry an episode, in order.

use super::MAX_GROUPS;
use crate::store::{StoreError, digest};
use crate::training::TrainingError;

/// How far a claimed score may be from its replay, as a share of the score's range: a trainer that sums a thousand rewards in
/// single precision is off by 1e-5 of it at most (each addition errs by 2^-24 of the sum).
pub const MOST_SCORE_GAP: f64 = 1e-4;
/// The codec of stored columns: zstd of scores (f32), steps (u32, where claimed), then one byte an episode that failed or not.
const CODEC: u8 = 1;
/// How hard they are compressed: scores hardly are, the rest is at any level.
const LEVEL: i32 = 1;

/// What is claimed of the episodes of a lease.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Columns {
    /// The score of each.
    pub scores: Vec<f32>,
    /// Which were lost to infrastructure; empty if none was.
    pub failed: Vec<bool>,
    /// Steps flown; empty where the trainer does not say.
    pub steps: Vec<u32>,
}

impl Columns {
    /// Whether an episode was lost to infrastructure.
    #[must_use]
    pub fn has_failed(&self, index: usize) -> bool {
        self.failed.get(index).copied().unwrap_or(false)
    }

    /// Checks that there is one entry for each of so many episodes, and that every number is one.
    ///
    /// # Errors
    /// The column and the place at fault.
    pub fn check(&self, episodes: usize) -> Result<(), TrainingError> {
        let lengths = [
            ("score", self.scores.len(), false),
            ("failed", self.failed.len(), true),
            ("steps", self.steps.len(), true),
        ];
        for (column, length, optional) in lengths {
            if length != episodes && !(optional && length == 0) {
                let why = format!("it has {length} entries, but the lease has {episodes} episodes");
                return Err(TrainingError::invalid(column, why));
            }
        }
        match self.scores.iter().position(|score| !score.is_finite()) {
            Some(at) => Err(TrainingError::invalid(format!("score.{at}"), "it is no finite number")),
            None => Ok(()),
        }
    }

    /// As it is kept: where nothing failed nothing is said of it.
    #[must_use]
    pub fn plain(mut self) -> Self {
        if !self.failed.contains(&true) {
            self.failed.clear();
        }
        self
    }

    /// What tells a repeat from a contradiction.
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

    /// The form in which they are stored.
    ///
    /// # Errors
    /// No memory to compress them.
    pub fn encode(&self) -> Result<Vec<u8>, StoreError> {
        let packed = zstd::bulk::compress(&self.bytes(), LEVEL)
            .map_err(|error| StoreError::unreadable("columns", error))?;
        Ok([&[CODEC][..], &packed].concat())
    }
}

/// Reads stored columns.
///
/// # Errors
/// Bytes that are none.
pub(super) fn decode(stored: &[u8]) -> Result<Columns, StoreError> {
    let broken = |why: &str| StoreError::unreadable("columns", why);
    let Some((&CODEC, packed)) = stored.split_first() else { return Err(broken("their codec is unknown")) };
    let most = 12 + MAX_GROUPS as usize * 9;
    let bytes =
        zstd::bulk::decompress(packed, most).map_err(|error| StoreError::unreadable("columns", error))?;
    let (head, rest) = bytes.split_first_chunk::<12>().ok_or_else(|| broken("they end too early"))?;
    let mut lengths = head.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
    let (scores, steps, failed) =
        (lengths.next().unwrap_or(0), lengths.next().unwrap_or(0), lengths.next().unwrap_or(0));
    if rest.len() != scores * 4 + steps * 4 + failed {
        return Err(broken("their lengths do not add up"));
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
        fn columns_read_back(scores in proptest::collection::vec(-1.0f32..2.0, 0..200), steps: bool, failed: bool) {
            let n = scores.len();
            let steps = if steps { (0..n as u32).collect() } else { Vec::new() };
            let failed = if failed { (0..n).map(|i| i % 3 == 0).collect() } else { Vec::new() };
            let columns = Columns { scores, failed, steps };
            prop_assert_eq!(decode(&columns.encode().unwrap()).unwrap(), columns.clone());
            prop_assert!(columns.check(n).is_ok());
            prop_assert!(columns.check(n + 1).is_err());
        }

        #[test]
        fn no_bytes_panic(bytes: Vec<u8>) {
            let _ = decode(&bytes);
            let mut framed = vec![CODEC];
            framed.extend(zstd::bulk::compress(&bytes, LEVEL).unwrap());
            let _ = decode(&framed);
        }
    }

    #[test]
    fn what_is_no_number_is_told_by_its_place() {
        let columns = Columns { scores: vec![0.5, f32::NAN], ..Columns::default() };
        let TrainingError::Invalid { field, .. } = columns.check(2).unwrap_err() else { panic!() };
        assert_eq!(field, "score.1");
        let columns = Columns { scores: vec![0.5; 2], steps: vec![1], ..Columns::default() };
        let TrainingError::Invalid { field, .. } = columns.check(2).unwrap_err() else { panic!() };
        assert_eq!(field, "steps");
    }
}
