//! [`Target`]: one parser with its seeds.

/// Parser under test, with its seeds.
#[derive(Debug, Clone, Copy)]
pub struct Target {
    /// Name of the target, which is the name of its test and of its binary for libFuzzer.
    pub name: &'static str,
    /// Runs the parser and checks its law. Returns true if the parser accepted the input; panics if the law is violated.
    pub run: fn(&[u8]) -> bool,
    /// Returns inputs that the parser accepts, from which others are mutated.
    pub seeds: fn() -> Vec<Vec<u8>>,
    /// Number by which the inputs of a test are divided, for targets that simulate.
    pub divisor: u64,
}

impl Target {
    /// Target of a parser of bytes.
    #[must_use]
    pub const fn new(name: &'static str, run: fn(&[u8]) -> bool, seeds: fn() -> Vec<Vec<u8>>) -> Self {
        Self { name, run, seeds, divisor: 1 }
    }

    /// The same target with a part of the inputs in a test.
    #[must_use]
    pub const fn divided_by(self, divisor: u64) -> Self {
        Self { divisor, ..self }
    }
}

/// Runs a parser of text on bytes. Bytes that are not UTF-8 never reach such a parser, and are not accepted.
pub(crate) fn with_text(bytes: &[u8], run: impl FnOnce(&str) -> bool) -> bool {
    std::str::from_utf8(bytes).is_ok_and(run)
}

/// Runs a parser of JSON values on bytes. Bytes that are not JSON never reach such a parser, and are not accepted.
pub(crate) fn with_json(bytes: &[u8], run: impl FnOnce(serde_json::Value) -> bool) -> bool {
    serde_json::from_slice(bytes).is_ok_and(run)
}

/// Converts texts to seeds.
pub(crate) fn seeds_of(texts: &[&str]) -> Vec<Vec<u8>> {
    texts.iter().map(|text| text.as_bytes().to_vec()).collect()
}

/// Converts JSON values to seeds.
pub(crate) fn json_seeds(values: impl IntoIterator<Item = serde_json::Value>) -> Vec<Vec<u8>> {
    values.into_iter().map(|value| value.to_string().into_bytes()).collect()
}
