//! Shortening of untrusted text.

/// Longest part of an input that an error message repeats, in characters.
pub const MAX_QUOTED_CHARS: usize = 60;

/// Shortens text to at most `max_chars` characters; the last one is then `…`, which marks that text is missing.
#[must_use]
pub fn shorten(text: &str, max_chars: usize) -> String {
    if text.chars().count() <= max_chars {
        text.to_owned()
    } else {
        text.chars().take(max_chars.saturating_sub(1)).chain(['…']).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::shorten;

    #[test]
    fn shortened_text_is_marked() {
        assert_eq!(shorten("déjà", 4), "déjà");
        assert_eq!(shorten("déjà vu", 4), "déj…");
        assert_eq!(shorten("", 1), "");
    }
}
