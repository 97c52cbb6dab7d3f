//! The last exchanges of a conversation.

use std::collections::VecDeque;

use llm::{Message, Role};

/// Window of the last exchanges, oldest first.
#[derive(Debug, Clone, Default)]
pub(super) struct ChatHistory {
    exchanges: VecDeque<Exchange>,
    max_exchanges: usize,
}

/// One message of the user and the action that answered it.
#[derive(Debug, Clone)]
struct Exchange {
    request: String,
    action: String,
}

impl ChatHistory {
    /// Creates an empty window of up to `max_exchanges` exchanges.
    pub(super) fn new(max_exchanges: usize) -> Self {
        Self { exchanges: VecDeque::new(), max_exchanges }
    }

    /// Appends an exchange and drops the oldest ones beyond the window.
    pub(super) fn push(&mut self, request: String, action: String) {
        self.exchanges.push_back(Exchange { request, action });
        while self.exchanges.len() > self.max_exchanges {
            self.exchanges.pop_front();
        }
    }

    /// Returns the messages of the window, oldest first.
    pub(super) fn messages(&self) -> impl Iterator<Item = Message> {
        self.exchanges.iter().flat_map(|exchange| {
            [Message::new(Role::User, &exchange.request), Message::new(Role::Assistant, &exchange.action)]
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn newest_exchanges_are_kept() {
        for (max_exchanges, expected) in [(0, ""), (1, "c3"), (2, "b2c3"), (9, "a1b2c3")] {
            let mut history = ChatHistory::new(max_exchanges);
            for (request, action) in [("a", "1"), ("b", "2"), ("c", "3")] {
                history.push(request.to_owned(), action.to_owned());
            }
            assert_eq!(history.messages().map(|message| message.content).collect::<String>(), expected);
        }
    }
}
