//! How tasks speak OpenEnv: actions come in as the JSON object that `step` carries, observations go out as JSON.
//!
//! The public kessler-env is served by openenv-core, whose messages pydantic reads: numbers by its lax rules, and faults
//! as its list of `type`, `loc`, `msg`, `input`. Clients know that list, so it is kept. Deliberately otherwise: NaN and
//! the infinities are refused in any form, a list given as a string that is not JSON is a fault like any other (there the
//! session dies), and what is read is bounded.

mod fault;
mod number;
mod reader;
pub(crate) mod schema;
mod strict;
#[cfg(test)]
pub(crate) mod tests;
mod text;
mod write;

use serde_json::Value;

pub use self::fault::{MAX_ECHO_BYTES, MAX_FAULTS, Place, WireFault, echo};
pub use self::number::{Wrong, integer, number};
pub(crate) use self::reader::Entries;
pub use self::reader::MAX_TEXT_BYTES;
pub use self::text::read_json;
pub(crate) use self::write::{Each, write};
use crate::log::{ActionLog, JointAction};

/// How a task speaks OpenEnv: actions in, observations out, and the JSON Schemas of both.
pub trait Wire: Send + Sync {
    /// JSON Schema of an action.
    fn action_schema(&self) -> &'static Value;
    /// JSON Schema of an observation (with `done`, `reward`, `metadata`, as openenv-core has it).
    fn observation_schema(&self) -> &'static Value;
    /// Reads an action (the object that `step` carries) as one step of a log, closing the step. Actions of agents that no
    /// episode of the task has are dropped; of those that only this episode lacks, [`ActionLog::keep_agents`] drops them.
    ///
    /// # Errors
    /// What is wrong with it, at most [`MAX_FAULTS`] faults, each located from the action on; nothing is appended then.
    fn read_action(&self, action: &Value, log: &mut ActionLog) -> Result<(), Vec<WireFault>>;
    /// JSON Schema that a writer of actions can be held to: within [`action_schema`](Self::action_schema), without what
    /// readers let pass but nobody means.
    fn strict_schema(&self) -> &'static Value;
    /// A step as an action in JSON, in the order of the action space, its values clamped as the environment clamps them.
    fn write_action(&self, step: JointAction<'_>) -> String;
}
