//! Language models in episodes: the chat policy chooses actions, and judges score steps.
//!
//! [`prompt`] turns an observation into a message, [`ActionCodec`] turns the reply into an action, and [`ChatPolicy`] keeps
//! the conversation and records every step as a [`ChatTurn`]. Start reading at [`ChatPolicy::act`].
//!
//! [`judging`] has the judges of single steps.
//!
//! This crate does not know where the episode runs, and it neither prints nor writes files: the command line uses it
//! against a server, and a background worker uses it for rollouts. Built-in policies without a model live in env-core.

mod action_codec;
mod chat;
#[doc(hidden)]
pub mod fuzzing;
mod history;
pub mod judging;
mod kessler;
pub mod prompt;
mod reply;
#[cfg(test)]
mod tests;
mod time_step;

pub use self::action_codec::ActionCodec;
pub use self::chat::{ActionFailure, ChatPolicy, ChatSettings, ChatTurn, Completion, TurnUsage};
pub use self::prompt::{ObservationFormat, TaskPrompt};
pub use self::time_step::TimeStep;
