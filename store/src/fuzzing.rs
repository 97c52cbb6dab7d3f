//! Private parsers of stored blobs and their writers, for fuzz tests only. They are not behind a feature, because a feature would
//! compile the crate twice: for the program and for the tests.

use env_core::{ActionLog, Bracket};

use crate::StoreError;
use crate::brackets::{PackedBracket, pack_bracket, unpack_bracket};
pub use crate::compacted_leases::packing::{PackedLeases, pack_leases, unpack_leases};
use crate::episodes::decode_log;
use crate::pack::pack;

/// Packs an action log as it is stored.
#[must_use]
pub fn pack_log(log: &ActionLog) -> Vec<u8> {
    pack(log.encode())
}

/// Unpacks a stored action log.
///
/// # Errors
/// Returns [`StoreError::Corrupt`] or the error of the log if the bytes are no packed log.
pub fn unpack_log(stored: &[u8]) -> Result<ActionLog, StoreError> {
    decode_log(stored)
}

/// Packs the outcomes of a bracket as they are stored.
///
/// # Errors
/// Returns [`StoreError::Corrupt`] if a number has no JSON form.
pub fn pack_outcomes(bracket: &Bracket) -> Result<Vec<u8>, StoreError> {
    Ok(pack_bracket(bracket)?.body)
}

/// Unpacks the stored outcomes of a bracket, whose reference plan is `plan`.
///
/// # Errors
/// Returns [`StoreError::Corrupt`] if the bytes are no packed bracket.
pub fn unpack_outcomes(stored: &[u8], plan: &ActionLog) -> Result<Bracket, StoreError> {
    unpack_bracket(1, &PackedBracket { body: stored.to_vec(), reference_plan: pack_log(plan) })
}
