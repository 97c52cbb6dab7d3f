//! The chat policy: a language model flies. What it sees becomes a message ([`prompt`]), what it says an action
//! ([`Actions`]); what was said and what it took is kept for each step ([`Turn`]).
//!
//! Nothing here knows where the episode is flown, prints or writes: the command line flies one on a server with it, a
//! background worker may fly one of its own. Policies without a model live in env-core.

mod actions;
mod answer;
mod chat;
mod history;
mod kessler;
pub mod prompt;
#[cfg(test)]
mod tests;

pub use self::actions::Actions;
pub use self::chat::{ChatPolicy, ChatSettings, Completion, Lack, Seen, Turn};
pub use self::prompt::{Briefing, Telemetry};
