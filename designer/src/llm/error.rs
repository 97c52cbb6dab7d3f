//! What can go wrong with a model.

use std::time::Duration;

/// Characters of a stranger's message that are kept.
const KEPT: usize = 200;

/// Why a model gave nothing.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LlmError {
    /// A setting that cannot be.
    #[error("{field}: {reason}")]
    Config {
        /// The setting.
        field: &'static str,
        /// What is wrong with it.
        reason: String,
    },
    /// The answer did not come in time.
    #[error("the model did not answer within {:.0} s", .after.as_secs_f64())]
    Timeout {
        /// How long it had.
        after: Duration,
    },
    /// No connection, or one that broke.
    #[error("the model's endpoint cannot be reached: {reason}")]
    Connection {
        /// Why.
        reason: String,
    },
    /// A connection that broke while the answer came.
    #[error("the connection to the model's endpoint broke within its answer: {reason}")]
    Broken {
        /// Why.
        reason: String,
    },
    /// The endpoint said no.
    #[error("the model's endpoint refused with status {status}: {body}")]
    Refused {
        /// The HTTP status.
        status: u16,
        /// The beginning of what it said, in one line.
        body: String,
    },
    /// The endpoint wants to be asked less.
    #[error("the model's endpoint is rate limited{}", wait(*.retry_after))]
    RateLimited {
        /// When to ask again, where it says.
        retry_after: Option<Duration>,
    },
    /// What is left of a budget does not pay for a call.
    #[error("the budget of {what} does not pay for another call: {spent} of {limit} is spent or under way")]
    Budget {
        /// Which budget.
        what: &'static str,
        /// What is spent or reserved.
        spent: f64,
        /// What may be.
        limit: f64,
    },
    /// Too many calls failed in a row: nobody asks for a while.
    #[error("the model is not asked for another {:.0} s after repeated failures: {why}", .retry_in.as_secs_f64())]
    Open {
        /// When it will be tried again.
        retry_in: Duration,
        /// The last failure.
        why: String,
    },
    /// An answer that is none.
    #[error("the model's answer makes no sense: {what}")]
    Nonsense {
        /// What is wrong with it.
        what: String,
        /// Tokens in that it is to be paid for all the same, where it says.
        tokens_in: Option<u64>,
        /// Tokens out likewise.
        tokens_out: Option<u64>,
    },
}

impl LlmError {
    /// The word it is counted by.
    #[must_use]
    pub const fn word(&self) -> &'static str {
        match self {
            Self::Config { .. } => "config",
            Self::Timeout { .. } => "timeout",
            Self::Connection { .. } | Self::Broken { .. } => "connection",
            Self::Refused { .. } => "refused",
            Self::RateLimited { .. } => "rate_limited",
            Self::Budget { .. } => "budget",
            Self::Open { .. } => "open",
            Self::Nonsense { .. } => "nonsense",
        }
    }

    /// Whether the same call may well succeed a little later.
    pub(super) const fn passes(&self) -> bool {
        match self {
            Self::Connection { .. } | Self::Broken { .. } | Self::RateLimited { .. } => true,
            Self::Refused { status, .. } => matches!(status, 408 | 409 | 500 | 502..=599),
            _ => false,
        }
    }

    /// Whether the endpoint may have worked, and be paid, for a call that ended so.
    pub(super) const fn may_cost(&self) -> bool {
        matches!(self, Self::Timeout { .. } | Self::Broken { .. } | Self::Nonsense { .. })
    }
}

fn wait(retry_after: Option<Duration>) -> String {
    retry_after.map_or_else(String::new, |after| format!(": it asks to wait {:.0} s", after.as_secs_f64()))
}

/// The beginning of what a stranger wrote (200 characters), in one line, without anything that could steer a terminal or a page.
#[must_use]
pub fn one_line(text: &str) -> String {
    shortened(text, KEPT)
}

/// At most so many characters of it.
pub(super) fn shortened(text: &str, most: usize) -> String {
    let mut line = String::new();
    let words = text.split(|c: char| c.is_whitespace() || c.is_control() || turns(c));
    for word in words.filter(|word| !word.is_empty()) {
        if !line.is_empty() {
            line.push(' ');
        }
        line.push_str(word);
        // A character has at most four bytes.
        if line.len() > 4 * most {
            break;
        }
    }
    if line.chars().count() > most {
        line = line.chars().take(most.saturating_sub(3)).chain("...".chars()).collect();
    }
    line
}

/// Characters that are not seen (Unicode's format characters), or turn the direction of those around them.
const fn turns(c: char) -> bool {
    matches!(c, '\u{ad}' | '\u{61c}' | '\u{180e}' | '\u{feff}')
        || matches!(c, '\u{200b}'..='\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2060}'..='\u{206f}')
        || matches!(c, '\u{fff9}'..='\u{fffb}' | '\u{e0000}'..='\u{e007f}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strangers_words_steer_nothing() {
        let odd = "a\u{1b}[31mb\u{9b}c\u{202e}d\u{2066}e\u{61c}f\u{2028}g\r\nh\u{e0041}i\u{0}";
        assert_eq!(one_line(odd), "a [31mb c d e f g h i");
        assert_eq!(shortened("long enough", 8), "long ...");
    }
}
