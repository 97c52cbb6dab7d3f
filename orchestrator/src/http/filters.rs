//! Filters of lists that accept one of several known words.

use std::collections::BTreeSet;

use env_core::TaskSpec;
use env_core::text::{MAX_QUOTED_CHARS, shorten};

use super::problem::Problem;

/// Parses a word of a query that must be one of `known`.
///
/// # Errors
/// Returns a problem with the known words for any other word.
pub(super) fn parse_filter_word<T: Copy + std::fmt::Display>(
    field: &str,
    word: Option<&str>,
    known: &[T],
) -> Result<Option<T>, Problem> {
    let Some(word) = word else { return Ok(None) };
    let value = known.iter().copied().find(|value| value.to_string() == word);
    value.map(Some).ok_or_else(|| unknown_word(field, word, known.iter().map(ToString::to_string)))
}

/// Checks that one of the tasks has a failure mode.
///
/// # Errors
/// Returns a problem with the failure modes of the tasks if none has it.
pub(super) fn check_failure_mode(
    field: &str,
    mode: Option<&String>,
    tasks: &[&'static dyn TaskSpec],
) -> Result<(), Problem> {
    let modes: BTreeSet<&str> =
        tasks.iter().flat_map(|task| task.failure_modes()).map(|mode| mode.name).collect();
    match mode {
        Some(mode) if !modes.contains(mode.as_str()) => {
            Err(unknown_word(field, mode, modes.into_iter().map(str::to_owned)))
        }
        _ => Ok(()),
    }
}

fn unknown_word(field: &str, word: &str, known: impl Iterator<Item = String>) -> Problem {
    let (known, word) = (known.collect::<Vec<_>>().join(", "), shorten(word, MAX_QUOTED_CHARS));
    Problem::invalid(field, format!("must be one of {known}, got {word:?}"))
}
