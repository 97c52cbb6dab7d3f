//! The canonical binary form that ids are hashes of, and digests of states.

/// Writer of the canonical form: little-endian, lengths before contents, `−0.0` as `0.0`. Equal values have equal bytes.
#[derive(Default)]
pub(crate) struct Canonical(Vec<u8>);

impl Canonical {
    pub(crate) fn new(magic: &str) -> Self {
        let mut canonical = Self::default();
        canonical.text(magic);
        canonical
    }

    pub(crate) fn count(&mut self, value: usize) {
        self.0.extend_from_slice(&(value as u64).to_le_bytes());
    }

    pub(crate) fn whole(&mut self, value: u64) {
        self.0.extend_from_slice(&value.to_le_bytes());
    }

    pub(crate) fn number(&mut self, value: f64) {
        self.0.extend_from_slice(&(value + 0.0).to_bits().to_le_bytes());
    }

    pub(crate) fn text(&mut self, value: &str) {
        self.count(value.len());
        self.0.extend_from_slice(value.as_bytes());
    }

    pub(crate) fn finish(self) -> Vec<u8> {
        self.0
    }
}

/// Hasher of every bit of a state. Unlike in the canonical form, −0 differs from 0.
pub(crate) struct StateHasher(blake3::Hasher);

impl StateHasher {
    pub(crate) fn new() -> Self {
        Self(blake3::Hasher::new())
    }

    pub(crate) fn put(&mut self, value: f64) {
        self.0.update(&value.to_bits().to_le_bytes());
    }

    pub(crate) fn finish(self) -> [u8; 32] {
        *self.0.finalize().as_bytes()
    }
}
