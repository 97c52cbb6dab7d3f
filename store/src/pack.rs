//! Blobs as they are stored: compressed if that is smaller.
//!
//! The first byte tells how a blob is stored. A packed blob begins with [`PACKED`], followed by its unpacked length (u32,
//! little-endian) and a zstd frame. An unpacked blob begins with its own first byte: 1 for an action log
//! ([`env_core::ActionLog::encode`]), a brace for JSON.

use std::borrow::Cow;
use std::cell::RefCell;
use std::io;

use zstd::bulk::{Compressor, Decompressor};

use super::StoreError;

/// First byte of a packed blob.
const PACKED: u8 = 2;
/// Bytes before the zstd frame: the first byte and the length.
const HEAD_BYTES: usize = 5;
/// Compression level. Blobs have one or two kilobytes, and each result has one, so that speed matters most.
const LEVEL: i32 = 1;
/// Largest blob, bytes. A log of 10 000 steps of 64 agents has 13 MB.
const MAX_BLOB_BYTES: usize = 64 << 20;

thread_local! {
    /// Compressor of this thread. Creating one takes longer than compressing a blob.
    static COMPRESSOR: RefCell<Option<Compressor<'static>>> = const { RefCell::new(None) };
    /// Decompressor of this thread, for the same reason.
    static DECOMPRESSOR: RefCell<Option<Decompressor<'static>>> = const { RefCell::new(None) };
}

/// Packs a blob whose first byte is not [`PACKED`].
pub(crate) fn pack(blob: Vec<u8>) -> Vec<u8> {
    debug_assert_ne!(blob.first(), Some(&PACKED), "the blob would look packed");
    let Some(length) = u32::try_from(blob.len()).ok().filter(|_| blob.len() <= MAX_BLOB_BYTES) else {
        return blob;
    };
    let packed = COMPRESSOR.with_borrow_mut(|compressor| {
        let compressor = match compressor {
            Some(compressor) => compressor,
            none => none.insert(Compressor::new(LEVEL).ok()?),
        };
        compressor.compress(&blob).ok()
    });
    match packed {
        Some(packed) if packed.len() + HEAD_BYTES < blob.len() => {
            [&[PACKED][..], &length.to_le_bytes(), &packed].concat()
        }
        _ => blob,
    }
}

/// Unpacks a blob. `item` is what error messages call it.
///
/// # Errors
/// Returns [`StoreError::Corrupt`] if the blob cannot be unpacked.
pub(crate) fn unpack<'a>(item: &'static str, stored: &'a [u8]) -> Result<Cow<'a, [u8]>, StoreError> {
    let head = stored.split_first_chunk::<HEAD_BYTES>().filter(|(head, _)| head[0] == PACKED);
    let Some((head, frame)) = head else { return Ok(Cow::Borrowed(stored)) };
    let length = u32::from_le_bytes([head[1], head[2], head[3], head[4]]) as usize;
    if length > MAX_BLOB_BYTES {
        return Err(StoreError::corrupt(item, format!("it would have {length} bytes")));
    }
    let blob = decompress(frame, length).map_err(|error| StoreError::corrupt(item, error))?;
    if blob.len() != length {
        let why = format!("it has {} bytes instead of {length}", blob.len());
        return Err(StoreError::corrupt(item, why));
    }
    Ok(Cow::Owned(blob))
}

/// Decompresses a frame of at most `max_bytes` bytes.
fn decompress(frame: &[u8], max_bytes: usize) -> io::Result<Vec<u8>> {
    DECOMPRESSOR.with_borrow_mut(|decompressor| {
        let decompressor = match decompressor {
            Some(decompressor) => decompressor,
            none => none.insert(Decompressor::new()?),
        };
        decompressor.decompress(frame, max_bytes)
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn packed_blob_unpacks(mut blob in proptest::collection::vec(0u8..4, 0..3000)) {
            if blob.first() == Some(&PACKED) {
                blob[0] = 1;
            }
            let stored = pack(blob.clone());
            prop_assert!(stored.len() <= blob.len());
            prop_assert_eq!(unpack("a blob", &stored).unwrap().into_owned(), blob);
        }

        #[test]
        fn any_bytes_unpack_without_a_panic(stored in any::<Vec<u8>>()) {
            let _ = unpack("a blob", &stored);
            let _ = unpack("a blob", &[&[PACKED][..], &stored].concat());
        }
    }

    #[test]
    fn wrong_length_is_refused() {
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
