//! Checks of single values that clients send.

use crate::engine::error::ServiceError;

/// Maximum length of a run's name, in characters.
const MAX_RUN_NAME_CHARS: usize = 200;
/// Maximum length of a run's note, in characters.
const MAX_RUN_NOTE_CHARS: usize = 2000;

/// Checks an integer against its bounds, both inclusive.
///
/// # Errors
/// Returns an error that names `field` if `value` is out of bounds.
pub(crate) fn check_range(field: &str, value: u32, min: u32, max: u32) -> Result<(), ServiceError> {
    if (min..=max).contains(&value) {
        Ok(())
    } else {
        Err(ServiceError::invalid(field, format!("must be from {min} to {max}, got {value}")))
    }
}

/// Checks the number of episodes of a lease, `groups` × `group_size`.
///
/// # Errors
/// Returns an error that names the field `groups` if there are more than `max` episodes.
pub(crate) fn check_episodes(groups: u32, group_size: u32, max: u32) -> Result<(), ServiceError> {
    let episodes = groups.saturating_mul(group_size);
    if episodes > max {
        let reason = format!("`groups` × `group_size` must be at most {max}, got {episodes}");
        return Err(ServiceError::invalid("groups", reason));
    }
    Ok(())
}

/// Checks the note of a run: at most 2 000 characters.
///
/// # Errors
/// Returns an error that names the field `note` if it is too long.
pub(crate) fn check_run_note(note: &str) -> Result<(), ServiceError> {
    match note.chars().count() {
        0..=MAX_RUN_NOTE_CHARS => Ok(()),
        count => Err(ServiceError::invalid(
            "note",
            format!("must have at most {MAX_RUN_NOTE_CHARS} characters, got {count}"),
        )),
    }
}

/// Checks the name of a run: 1 to 200 characters.
///
/// # Errors
/// Returns an error that names the field `name` if the name is empty or too long.
pub(crate) fn check_run_name(name: &str) -> Result<(), ServiceError> {
    if name.is_empty() || name.chars().count() > MAX_RUN_NAME_CHARS {
        return Err(ServiceError::invalid("name", format!("must have 1 to {MAX_RUN_NAME_CHARS} characters")));
    }
    Ok(())
}
