//! Runs the target with the name of this binary under libFuzzer.

#![no_main]

use std::sync::LazyLock;

use fuzz_targets::Target;
use libfuzzer_sys::{Corpus, fuzz_target};

static TARGET: LazyLock<&Target> = LazyLock::new(|| {
    let name = env!("CARGO_BIN_NAME");
    fuzz_targets::find(name).unwrap_or_else(|| panic!("there is no target {name}"))
});

fuzz_target!(|bytes: &[u8]| -> Corpus {
    (TARGET.run)(bytes);
    // Rejected inputs stay in the corpus too: they may reach code that no accepted input reaches.
    Corpus::Keep
});
