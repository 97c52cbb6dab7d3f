//! The OpenEnv protocol of each task: JSON actions in, JSON observations out, and the JSON Schemas of both.
//!
//! The public kessler-env is served by openenv-core, which validates messages with pydantic: it reads numbers by lax rules
//! and reports errors as a list of `type`, `loc`, `msg` and `input`. Clients depend on that list, so this crate reproduces
//! it. Three things differ on purpose:
//!
//! - NaN and the infinities are rejected in every form.
//! - A list that is sent as a string which is not JSON is an ordinary error. openenv-core ends the session there.
//! - The size of an input, and of what is echoed of it, is bounded.
//!
//! Observations are written by [`Episode::write_observation`](env_core::Episode::write_observation); this crate has their
//! schemas. HTTP routes and sockets are not here: the `orchestrator` crate serves them. Start reading at [`wire_format()`].

mod action_format;
mod action_reader;
mod action_tool;
mod action_writer;
mod docking;
mod kessler;
mod number;
mod python_json;
mod registry;
mod schema;
mod tasking;
#[cfg(test)]
mod tests;
mod validation_error;
mod value_kind;
mod wire_format;

pub use self::action_reader::MAX_TEXT_BYTES;
pub use self::action_tool::ActionTool;
pub use self::number::{NumberError, parse_integer, parse_number};
pub use self::python_json::{INPUT_LIMITS, parse_python_json};
pub use self::registry::wire_format;
pub use self::validation_error::{LocSegment, MAX_ECHO_BYTES, MAX_ERRORS, ValidationError, echo_input};
pub use self::wire_format::WireFormat;
