//! Blobs as they are stored: compressed where that is smaller.
//!
//! The first byte says how. What is packed begins with [`PACKED`], then has its length unpacked (u32, little-endian) and a zstd
//! frame. What is not begins with its own first byte: 1 of an action log ([`env_core::ActionLog::encode`]), a brace of JSON.

use std::borrow::Cow;
use std::cell::RefCell;

use zstd::bulk::Compressor;

use super::StoreError;

/// First byte of what is packed.
const PACKED: u8 = 2;
/// That byte and the length.
const HEAD: usize = 5;
/// How hard: blobs are of a kilobyte or two, and each result has one.
const LEVEL: i32 = 1;
/// Largest blob. A log of 10 000 steps of 64 agents has 13 MB.
const MOST: usize = 64 << 20;

thread_local! {
    /// Making one costs more than what it does.
    static COMPRESSOR: RefCell<Option<Compressor<'static>>> = const { RefCell::new(None) };
}

/// Packs a blob whose first byte is not [`PACKED`].
pub(crate) fn pack(blob: Vec<u8>) -> Vec<u8> {
    debug_assert_ne!(blob.first(), Some(&PACKED), "it would be taken for packed");
    let Some(length) = u32::try_from(blob.len()).ok().filter(|_| blob.len() <= MOST) else { return blob };
    let packed = COMPRESSOR.with_borrow_mut(|compressor| {
        let compressor = match compressor {
            Some(compressor) => compressor,
            none => none.insert(Compressor::new(LEVEL).ok()?),
        };
        compressor.compress(&blob).ok()
    });
    match packed {
        Some(packed) if packed.len() + HEAD < blob.len() => {
            [&[PACKED][..], &length.to_le_bytes(), &packed].concat()
        }
        _ => blob,
    }
}

/// What was packed, as it was.
///
/// # Errors
/// A blob that cannot be unpacked; `what` it is.
pub(crate) fn unpack<'a>(what: &'static str, stored: &'a [u8]) -> Result<Cow<'a, [u8]>, StoreError> {
    let Some((head, frame)) = stored.split_first_chunk::<HEAD>().filter(|(head, _)| head[0] == PACKED) else {
        return Ok(Cow::Borrowed(stored));
    };
    let length = u32::from_le_bytes([head[1], head[2], head[3], head[4]]) as usize;
    if length > MOST {
        return Err(StoreError::unreadable(what, format!("it would have {length} bytes")));
    }
    let blob = zstd::bulk::decompress(frame, length).map_err(|error| StoreError::unreadable(what, error))?;
    if blob.len() != length {
        let why = format!("it has {} bytes, and should have {length}", blob.len());
        return Err(StoreError::unreadable(what, why));
    }
    Ok(Cow::Owned(blob))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn what_is_packed_unpacks(mut blob in proptest::collection::vec(0u8..4, 0..3000)) {
            if blob.first() == Some(&PACKED) {
                blob[0] = 1;
            }
            let stored = pack(blob.clone());
            prop_assert!(stored.len() <= blob.len());
            prop_assert_eq!(unpack("a blob", &stored).unwrap().into_owned(), blob);
        }

        #[test]
        fn nothing_panics(stored in any::<Vec<u8>>()) {
            let _ = unpack("a blob", &stored);
            let _ = unpack("a blob", &[&[PACKED][..], &stored].concat());
        }
    }

    #[test]
    fn a_blob_that_says_too_much_is_refused() {
        let stored = pack(vec![1; 1000]);
        assert!(stored.len() < 40, "{}", stored.len());
        let mut longer = stored.clone();
        longer[1] += 1;
        let mut huge = stored.clone();
        huge[4] = 255;
        for wrong in [&longer, &huge, &stored[..stored.len() - 1].to_vec()] {
            assert!(unpack("a blob", wrong).is_err());
        }
    }
}
