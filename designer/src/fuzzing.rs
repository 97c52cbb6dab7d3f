//! Private parsers, for fuzz tests only. They are not behind a feature, because a feature would compile the crate twice: for the
//! program and for the tests.

pub use crate::llm_designer::extract::{ExtractedDesigns, extract_designs};
