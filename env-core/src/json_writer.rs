//! Writes serialisable values as JSON bytes without building a tree of values first.

use serde::{Serialize, Serializer};

/// Appends the JSON of a value.
pub(crate) fn append_json(out: &mut Vec<u8>, value: &impl Serialize) {
    let start = out.len();
    if serde_json::to_writer(&mut *out, value).is_err() {
        // Unreachable: a Vec accepts every byte and keys of observations are strings. Half a value would be worse than null.
        out.truncate(start);
        out.extend_from_slice(b"null");
    }
}

/// A list whose elements are computed while it is serialised.
pub(crate) struct LazySeq<F>(pub(crate) F);

impl<F, I> Serialize for LazySeq<F>
where
    F: Fn() -> I,
    I: Iterator<Item: Serialize>,
{
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq((self.0)())
    }
}
