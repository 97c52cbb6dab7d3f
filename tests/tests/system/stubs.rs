//! `python/sparring/_native.pyi` says what the compiled module has, as that tells of itself. `scripts/python-stubs` has it written.

use std::path::Path;

use system_tests::native;

const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../python/sparring/_native.pyi");

#[test]
fn the_stubs_are_what_the_module_says() {
    let module = pyo3_introspection::introspect_cdylib(native(), "_native").unwrap();
    let files = pyo3_introspection::module_stub_files(&module);
    // Types that are written as text bring no import of theirs.
    let told = files[Path::new("__init__.pyi")].replacen(
        "from typing",
        "import numpy\nimport numpy.typing\nfrom typing",
        1,
    );
    if std::env::var_os("SPARRING_STUBS").is_some_and(|way| way == "write") {
        std::fs::write(FILE, &told).unwrap();
    }
    let kept = std::fs::read_to_string(FILE).unwrap();
    assert!(
        kept == told,
        "_native.pyi is not what the crate says: run scripts/python-stubs\n{}",
        difference(&kept, &told)
    );
}

/// The first lines that differ.
fn difference(kept: &str, told: &str) -> String {
    let differ = kept.lines().zip(told.lines()).find(|(kept, told)| kept != told);
    differ.map_or("one is longer".to_owned(), |(kept, told)| format!("- {kept}\n+ {told}"))
}
