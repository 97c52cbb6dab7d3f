//! The last exchanges of a conversation.

use std::collections::VecDeque;

use designer::llm::{Message, Role};

/// A window of exchanges, the newest last.
#[derive(Debug, Clone, Default)]
pub(super) struct History {
    exchanges: VecDeque<(String, String)>,
    most: usize,
}

impl History {
    /// A window of so many exchanges.
    pub(super) fn new(most: usize) -> Self {
        Self { exchanges: VecDeque::new(), most }
    }

    /// What was asked, and the action that was taken.
    pub(super) fn push(&mut self, asked: String, done: String) {
        self.exchanges.push_back((asked, done));
        while self.exchanges.len() > self.most {
            self.exchanges.pop_front();
        }
    }

    /// The conversation so far, as far as it is remembered.
    pub(super) fn messages(&self) -> impl Iterator<Item = Message> {
        self.exchanges
            .iter()
            .flat_map(|(asked, done)| [Message::new(Role::User, asked), Message::new(Role::Assistant, done)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_are_remembered() {
        for (most, left) in [(0, ""), (1, "c3"), (2, "b2c3"), (9, "a1b2c3")] {
            let mut history = History::new(most);
            for (asked, done) in [("a", "1"), ("b", "2"), ("c", "3")] {
                history.push(asked.to_owned(), done.to_owned());
            }
            assert_eq!(history.messages().map(|message| message.content).collect::<String>(), left);
        }
    }
}
