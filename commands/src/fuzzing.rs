//! Private parsers, for fuzz tests only. They are not behind a feature, because a feature would compile the crate twice: for the
//! program and for the tests.

use env_core::{ActionLog, Scenario};
use llm_policy::TimeStep;
use serde_json::Value;

use crate::api::StreamedEvent;
use crate::api::event_stream::EventParser;
use crate::bench::parse_seconds;
use crate::critique::parse_actions;
use crate::demo::parse_episodes;
use crate::design::brief::parse_param;
use crate::logs::parse_log_filter;
use crate::play::session::{ServerUrls, parse_response};
use crate::runs::create::parse_field;
use crate::suite::build::parse_name;

/// Parses an event stream that arrives in chunks.
pub fn events<'a>(chunks: impl Iterator<Item = &'a [u8]>) -> Vec<StreamedEvent> {
    let mut parser = EventParser::default();
    chunks.flat_map(|chunk| parser.push(chunk)).collect()
}

/// Parses the address of a server, and returns the URLs of its pages and of its sessions.
///
/// # Errors
/// Returns why the text is no address.
pub fn server_urls(text: &str) -> Result<(String, String), String> {
    ServerUrls::parse(text).map(|urls| (urls.base.into(), urls.socket.into()))
}

/// Parses the message of an OpenEnv server.
///
/// # Errors
/// Returns the error of the message, or why the text is no message.
pub fn server_message(text: &str) -> Result<TimeStep, String> {
    parse_response(text).map_err(|error| error.to_string())
}

/// Parses a file of actions.
///
/// # Errors
/// Returns why the value is no log of the scenario.
pub fn actions_file(scenario: &Scenario, value: Value) -> Result<ActionLog, String> {
    parse_actions(scenario, value).map_err(|error| error.to_string())
}

/// Runs the parsers of single arguments and returns the number of those that accept the text.
#[must_use]
pub fn arguments(text: &str) -> usize {
    let accepted = [
        parse_seconds(text).is_ok_and(|seconds| seconds > 0.0),
        parse_episodes(text).is_ok_and(|episodes| episodes > 0),
        parse_param(text).is_ok_and(|(_, value)| value.is_finite()),
        parse_log_filter(text).is_ok(),
        parse_field(text).is_ok(),
        parse_name(text).is_ok_and(|name| name == text),
    ];
    accepted.into_iter().filter(|accepted| *accepted).count()
}
