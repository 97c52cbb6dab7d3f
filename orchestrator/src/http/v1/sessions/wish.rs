//! What a session is to fly, read from its message.

use std::collections::BTreeMap;
use std::str::FromStr;

use env_core::batch::{Autoreset, ObservationMode};
use env_core::{Scenario, TaskSpec};
use serde::Deserialize;
use serde_json::{Map, Value};

use super::super::super::openenv::{known, named, usual};
use super::refusal::Refusal;
use crate::ids::InvalidId;
use crate::input::from_value;
use crate::sessions::{MAX_NAME_CHARS, VectorRequest, SessionRequest, EpisodeSource};

/// The task where nobody says.
const USUAL: &str = "kessler/survival";
/// What an agent is shown of threats, where nobody says.
const THREATS: u32 = 8;
const LOOK_AHEAD: u32 = 15;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct WishFields {
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
    autoreset: Option<AutoresetWord>,
    observe: Option<ObserveWord>,
    threats: Option<u32>,
    look_ahead: Option<u32>,
    bodies: Option<u32>,
    task: Option<String>,
}

#[derive(Deserialize, Clone, Copy)]
#[serde(rename_all = "snake_case")]
enum AutoresetWord {
    NextStep,
    SameStep,
    Disabled,
}

#[derive(Deserialize, Clone, Copy, PartialEq)]
#[serde(rename_all = "snake_case")]
enum ObserveWord {
    All,
    Tracks,
}

fn id<T: FromStr<Err = InvalidId>>(field: &str, text: Option<String>) -> Result<Option<T>, Refusal> {
    let read = |text: String| text.parse().map_err(|error: InvalidId| Refusal::invalid(field, error.to_string()));
    text.map(read).transpose()
}

fn name(field: &str, text: Option<String>) -> Result<Option<String>, Refusal> {
    match text {
        Some(text) if text.chars().count() > MAX_NAME_CHARS => {
            Err(Refusal::invalid(field, format!("it has more than {MAX_NAME_CHARS} characters")))
        }
        text => Ok(text),
    }
}

fn task(field: &str, name: Option<&String>) -> Result<Option<&'static dyn TaskSpec>, Refusal> {
    let find = |name: &String| {
        named(name)
            .ok_or_else(|| Refusal::invalid(field, format!("there is no such task; known are {}", known())))
    };
    name.map(find).transpose()
}

/// A wish out of the fields of a message.
pub(super) fn wish(fields: Map<String, Value>) -> Result<SessionRequest, Refusal> {
    let fields: WishFields = from_value(Value::Object(fields))?;
    let scenario = fields.scenario.map(|scenario| {
        Scenario::from_json(&scenario).map_err(|error| {
            let field = match error.field() {
                "scenario" => "scenario".to_owned(),
                field => format!("scenario.{field}"),
            };
            Refusal::invalid(field, error.to_string())
        })
    });
    Ok(SessionRequest {
        seed: fields.seed,
        episode_id: name("episode_id", fields.episode_id)?,
        task: task("task", fields.task.as_ref())?,
        params: fields.params.unwrap_or_default().into_iter().collect(),
        physics: fields.physics.unwrap_or_default().into_iter().collect(),
        scenario: scenario.transpose()?,
        run: id("run", fields.run)?,
        lease: id("lease_id", fields.lease_id)?,
        group: name("group_id", fields.group_id)?,
        group_size: fields.group_size,
        policy_version: fields.policy_version,
    })
}

/// The wish, sorted.
pub(super) fn sorted(wish: SessionRequest) -> Result<EpisodeSource, Refusal> {
    Ok(wish.resolve(usual(USUAL))?)
}

/// How many environments are stepped, and how.
pub(super) fn vector(fields: Value) -> Result<VectorRequest, Refusal> {
    let fields: VectorFields = from_value(fields).map_err(|fault| {
        let field =
            if fault.field.is_empty() { "vector".to_owned() } else { format!("vector.{}", fault.field) };
        Refusal::invalid(field, fault.reason)
    })?;
    let observe = match fields.observe.unwrap_or(ObserveWord::All) {
        ObserveWord::All => ObservationMode::All { bodies: fields.bodies },
        ObserveWord::Tracks => ObservationMode::Tracks {
            threats: fields.threats.unwrap_or(THREATS),
            look_ahead: fields.look_ahead.unwrap_or(LOOK_AHEAD),
        },
    };
    let strange = match observe {
        ObservationMode::All { .. } => [("threats", fields.threats), ("look_ahead", fields.look_ahead)],
        ObservationMode::Tracks { .. } => [("bodies", fields.bodies), ("bodies", None)],
    };
    if let Some((field, _)) = strange.iter().find(|(_, given)| given.is_some()) {
        let reason = "it says nothing under this `observe`; leave it out";
        return Err(Refusal::invalid(format!("vector.{field}"), reason));
    }
    Ok(VectorRequest {
        envs: usize::try_from(fields.envs).unwrap_or(usize::MAX),
        autoreset: match fields.autoreset.unwrap_or(AutoresetWord::NextStep) {
            AutoresetWord::NextStep => Autoreset::NextStep,
            AutoresetWord::SameStep => Autoreset::SameStep,
            AutoresetWord::Disabled => Autoreset::Disabled,
        },
        observe,
        task: task("vector.task", fields.task.as_ref())?,
    })
}

/// The word of a mode.
pub(super) const fn autoreset_word(autoreset: Autoreset) -> &'static str {
    match autoreset {
        Autoreset::NextStep => "next_step",
        Autoreset::SameStep => "same_step",
        Autoreset::Disabled => "disabled",
    }
}
