//! `python/sparring/_native.pyi` matches the compiled module. `scripts/python-stubs` updates the file.

use std::path::Path;

use system_tests::native_module;

const STUB_FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../python/sparring/_native.pyi");

#[test]
fn stubs_match_native_module() {
    let module = pyo3_introspection::introspect_cdylib(native_module(), "_native").unwrap();
    let files = pyo3_introspection::module_stub_files(&module);
    // Types that are given as text do not generate an import.
    let generated = files[Path::new("__init__.pyi")].replacen(
        "from typing",
        "import collections.abc\nimport numpy\nimport numpy.typing\nimport typing\nfrom typing",
        1,
    );
    if std::env::var_os("SPARRING_STUBS").is_some_and(|way| way == "write") {
        std::fs::write(STUB_FILE, &generated).unwrap();
    }
    let committed = std::fs::read_to_string(STUB_FILE).unwrap();
    assert!(
        committed == generated,
        "_native.pyi is out of date: run scripts/python-stubs\n{}",
        first_difference(&committed, &generated)
    );
}

/// Returns the first pair of lines that differ.
fn first_difference(committed: &str, generated: &str) -> String {
    let differ =
        committed.lines().zip(generated.lines()).find(|(committed, generated)| committed != generated);
    differ.map_or("one file is longer".to_owned(), |(committed, generated)| {
        format!("- {committed}\n+ {generated}")
    })
}
