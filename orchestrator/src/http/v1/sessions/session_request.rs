//! Request of a session, read from its first message or from a reset.

use std::collections::BTreeMap;
use std::str::FromStr;

use env_core::batch::{Autoreset, ObservationMode};
use env_core::text::{MAX_QUOTED_CHARS, shorten};
use env_core::{Scenario, TaskSpec};
use serde::Deserialize;
use serde_json::{Map, Value};
use store::ids::InvalidId;

use super::error_message::ErrorMessage;
use crate::http::openenv::{built_in_task, known_tasks, task_by_name};
use crate::sessions::{EpisodeSource, MAX_NAME_CHARS, SessionRequest, VectorRequest};
use strict_input::from_value;

/// Task of a request that names none.
const DEFAULT_TASK: &str = "kessler/survival";
/// Default number of threats that an agent observes.
const DEFAULT_THREATS: u32 = 8;
/// Default time for which threats are predicted, in steps.
const DEFAULT_LOOK_AHEAD: u32 = 15;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RequestFields {
    task: Option<String>,
    params: Option<BTreeMap<String, f64>>,
    physics: Option<BTreeMap<String, String>>,
    seed: Option<u64>,
    scenario: Option<Value>,
    run: Option<String>,
    lease_id: Option<String>,
    group_id: Option<String>,
    group_size: Option<u32>,
    policy_version: Option<u32>,
    episode_id: Option<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct VectorFields {
    envs: u64,
    autoreset: Option<AutoresetField>,
    observe: Option<ObserveField>,
    threats: Option<u32>,
    look_ahead: Option<u32>,
    bodies: Option<u32>,
    task: Option<String>,
}

#[derive(Deserialize, Clone, Copy)]
#[serde(rename_all = "snake_case")]
enum AutoresetField {
    NextStep,
    SameStep,
    Disabled,
}

#[derive(Deserialize, Clone, Copy, PartialEq)]
#[serde(rename_all = "snake_case")]
enum ObserveField {
    All,
    Tracks,
}

/// Parses an optional id.
fn parse_optional_id<T: FromStr<Err = InvalidId>>(
    field: &str,
    text: Option<String>,
) -> Result<Option<T>, ErrorMessage> {
    let read = |text: String| {
        text.parse().map_err(|error: InvalidId| ErrorMessage::invalid(field, error.to_string()))
    };
    text.map(read).transpose()
}

/// Checks the length of a name.
fn check_name(field: &str, text: Option<String>) -> Result<Option<String>, ErrorMessage> {
    match text {
        Some(text) if text.chars().count() > MAX_NAME_CHARS => {
            Err(ErrorMessage::invalid(field, format!("must have at most {MAX_NAME_CHARS} characters")))
        }
        text => Ok(text),
    }
}

/// Finds a task by its name.
fn find_task(field: &str, name: Option<&String>) -> Result<Option<&'static dyn TaskSpec>, ErrorMessage> {
    let find = |name: &String| {
        task_by_name(name).ok_or_else(|| {
            ErrorMessage::invalid(
                field,
                format!("must be one of {}, got {:?}", known_tasks(), shorten(name, MAX_QUOTED_CHARS)),
            )
        })
    };
    name.map(find).transpose()
}

/// Reads a request from the fields of a message.
pub(in crate::http) fn session_request(fields: Map<String, Value>) -> Result<SessionRequest, ErrorMessage> {
    let fields: RequestFields = from_value(Value::Object(fields))?;
    let scenario = fields.scenario.map(|scenario| {
        Scenario::from_json(&scenario).map_err(|error| {
            let field = match error.field() {
                "scenario" => "scenario".to_owned(),
                field => format!("scenario.{field}"),
            };
            ErrorMessage::invalid(field, error.reason())
        })
    });
    Ok(SessionRequest {
        seed: fields.seed,
        episode_id: check_name("episode_id", fields.episode_id)?,
        task: find_task("task", fields.task.as_ref())?,
        params: fields.params.unwrap_or_default().into_iter().collect(),
        physics: fields.physics.unwrap_or_default().into_iter().collect(),
        scenario: scenario.transpose()?,
        suite_scenario: None,
        run: parse_optional_id("run", fields.run)?,
        lease: parse_optional_id("lease_id", fields.lease_id)?,
        group: check_name("group_id", fields.group_id)?,
        group_size: fields.group_size,
        policy_version: fields.policy_version,
    })
}

/// Resolves a request to the source of its episodes.
pub(super) async fn episode_source(request: SessionRequest) -> Result<EpisodeSource, ErrorMessage> {
    Ok(request.resolve(built_in_task(DEFAULT_TASK)).await?)
}

/// Reads the field `vector`: the number of environments and their settings.
pub(in crate::http) fn vector_request(fields: Value) -> Result<VectorRequest, ErrorMessage> {
    let fields: VectorFields = from_value(fields).map_err(|fault| {
        let field =
            if fault.field.is_empty() { "vector".to_owned() } else { format!("vector.{}", fault.field) };
        ErrorMessage::invalid(field, fault.reason)
    })?;
    let observe = match fields.observe.unwrap_or(ObserveField::All) {
        ObserveField::All => ObservationMode::All { bodies: fields.bodies },
        ObserveField::Tracks => ObservationMode::Tracks {
            threats: fields.threats.unwrap_or(DEFAULT_THREATS),
            look_ahead: fields.look_ahead.unwrap_or(DEFAULT_LOOK_AHEAD),
        },
    };
    let unused = match observe {
        ObservationMode::All { .. } | ObservationMode::Extended => {
            [("threats", fields.threats), ("look_ahead", fields.look_ahead)]
        }
        ObservationMode::Tracks { .. } => [("bodies", fields.bodies), ("bodies", None)],
    };
    if let Some((field, _)) = unused.iter().find(|(_, given)| given.is_some()) {
        let reason = "has no effect with this `observe`; leave it out";
        return Err(ErrorMessage::invalid(format!("vector.{field}"), reason));
    }
    Ok(VectorRequest {
        envs: usize::try_from(fields.envs).unwrap_or(usize::MAX),
        autoreset: match fields.autoreset.unwrap_or(AutoresetField::NextStep) {
            AutoresetField::NextStep => Autoreset::NextStep,
            AutoresetField::SameStep => Autoreset::SameStep,
            AutoresetField::Disabled => Autoreset::Disabled,
        },
        observe,
        task: find_task("vector.task", fields.task.as_ref())?,
    })
}

/// Word of an autoreset mode.
pub(super) const fn autoreset_word(autoreset: Autoreset) -> &'static str {
    match autoreset {
        Autoreset::NextStep => "next_step",
        Autoreset::SameStep => "same_step",
        Autoreset::Disabled => "disabled",
    }
}
