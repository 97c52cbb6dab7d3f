//! [`OutputTarget`]: where text goes, and how wide it may be.

use std::io::IsTerminal;

/// Largest width of prose, in columns. Longer lines are hard to read.
const MAX_PROSE_WIDTH: usize = 100;
/// Smallest width that output is formatted for, in columns; narrower terminals wrap lines themselves.
const MIN_WIDTH: usize = 40;

/// Destination of text output.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OutputTarget {
    /// A terminal of this many columns: text is wrapped, and tables fit the width.
    Terminal(usize),
    /// A pipe or a file: tables are tab-separated values, and nothing is wrapped or left out.
    Piped,
}

impl OutputTarget {
    /// Returns the target of stdout.
    pub fn stdout() -> Self {
        Self::of(&std::io::stdout())
    }

    /// Returns the target of stderr.
    pub fn stderr() -> Self {
        Self::of(&std::io::stderr())
    }

    fn of(stream: &impl IsTerminal) -> Self {
        if stream.is_terminal() { Self::Terminal(textwrap::termwidth().max(MIN_WIDTH)) } else { Self::Piped }
    }

    /// Wraps prose at spaces. Lines after the first one are indented by `indent`. A pipe gets one line.
    pub fn wrap(self, text: &str, indent: &str) -> String {
        match self {
            Self::Piped => text.to_owned(),
            Self::Terminal(width) => {
                // Ids and paths contain hyphens and slashes; only spaces are line breaks.
                let options = textwrap::Options::new(width.min(MAX_PROSE_WIDTH))
                    .word_separator(textwrap::WordSeparator::AsciiSpace)
                    .word_splitter(textwrap::WordSplitter::NoHyphenation)
                    .break_words(false)
                    .subsequent_indent(indent);
                textwrap::fill(&join_code(text), options).replace(CODE_SPACE, " ")
            }
        }
    }
}

/// Stands for a space within code while text is wrapped.
const CODE_SPACE: char = '\u{e000}';
/// Largest length of code that is kept on one line, in characters.
const MAX_JOINED_CODE: usize = 40;

/// Joins the words of code such as `sparring runs list`, so that it is not wrapped.
fn join_code(text: &str) -> String {
    let parts = text.split('`').enumerate();
    let join = |(at, part): (usize, &str)| {
        let is_code = at % 2 == 1 && part.chars().count() <= MAX_JOINED_CODE;
        if is_code { part.replace(' ', &CODE_SPACE.to_string()) } else { part.to_owned() }
    };
    parts.map(join).collect::<Vec<_>>().join("`")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prose_wraps_at_spaces_only() {
        let text = "run-1a2b3c4d5e6f of kessler/survival and docking/multiagent has a very-long-identifier-that-does-not-fit-anywhere";
        insta::assert_snapshot!(OutputTarget::Terminal(40).wrap(text, "  "), @r"
        run-1a2b3c4d5e6f of kessler/survival and
          docking/multiagent has a
          very-long-identifier-that-does-not-fit-anywhere
        ");
        assert_eq!(OutputTarget::Piped.wrap(text, "  "), text);
        let code =
            OutputTarget::Terminal(40).wrap("name one of the runs that `sparring runs list` prints", "  ");
        assert_eq!(code, "name one of the runs that\n  `sparring runs list` prints");
    }
}
