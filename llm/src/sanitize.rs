//! Untrusted text as one line for logs, error messages and prompts.

/// Length limit of [`sanitize_line`], in characters.
const MAX_LINE_CHARS: usize = 200;

/// Returns the first 200 characters of untrusted text as one line, without characters that could control a terminal or a
/// page.
#[must_use]
pub fn sanitize_line(text: &str) -> String {
    sanitize_line_to(text, MAX_LINE_CHARS)
}

/// Like [`sanitize_line`], with a limit of `max_chars` characters. Text that is cut ends in `...`.
#[must_use]
pub fn sanitize_line_to(text: &str, max_chars: usize) -> String {
    let mut line = String::new();
    let words = text.split(|c: char| c.is_whitespace() || c.is_control() || is_format_character(c));
    for word in words.filter(|word| !word.is_empty()) {
        if !line.is_empty() {
            line.push(' ');
        }
        line.push_str(word);
        // A character has at most four bytes.
        if line.len() > 4 * max_chars {
            break;
        }
    }
    if line.chars().count() > max_chars {
        line = line.chars().take(max_chars.saturating_sub(3)).chain("...".chars()).collect();
    }
    line
}

/// Returns true for invisible characters (Unicode category Cf) and those that change the direction of text around them.
const fn is_format_character(c: char) -> bool {
    matches!(c, '\u{ad}' | '\u{61c}' | '\u{180e}' | '\u{feff}')
        || matches!(c, '\u{200b}'..='\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2060}'..='\u{206f}')
        || matches!(c, '\u{fff9}'..='\u{fffb}' | '\u{e0000}'..='\u{e007f}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_and_format_characters_are_removed() {
        let hostile = "a\u{1b}[31mb\u{9b}c\u{202e}d\u{2066}e\u{61c}f\u{2028}g\r\nh\u{e0041}i\u{0}";
        assert_eq!(sanitize_line(hostile), "a [31mb c d e f g h i");
        assert_eq!(sanitize_line_to("long enough", 8), "long ...");
    }
}
