//! Observations as bytes.

use serde::{Serialize, Serializer};

/// Appends a value's JSON.
pub(crate) fn write(out: &mut Vec<u8>, value: &impl Serialize) {
    let start = out.len();
    if serde_json::to_writer(&mut *out, value).is_err() {
        // Memory takes every byte and observations have names for keys, so nothing gets here; a half-written one would be
        // worse than none.
        out.truncate(start);
        out.extend_from_slice(b"null");
    }
}

/// A list whose elements are made as they are written.
pub(crate) struct Each<F>(pub(crate) F);

impl<F, I> Serialize for Each<F>
where
    F: Fn() -> I,
    I: Iterator<Item: Serialize>,
{
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq((self.0)())
    }
}
