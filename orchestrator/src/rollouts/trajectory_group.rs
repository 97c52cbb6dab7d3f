//! What is told of a group: made once, kept compressed.

use serde::Serialize;
use serde_json::Value;
use serde_json::value::RawValue;
use utoipa::ToSchema;

use crate::rollouts::run_episode::{ModelMetrics, TrajectoryStep};
use crate::leases::bracket_view::BracketView;

/// Bytes of a body as JSON, beyond which observations are left out, then conversations.
pub const MOST_BYTES: usize = 16 << 20;
/// Bytes of a body as JSON that are kept at all.
pub const HARD_MOST_BYTES: usize = 64 << 20;
/// How hard bodies are compressed: zstd's own default.
const LEVEL: i32 = 3;

/// A finished group, but for its id and how often it was delivered.
#[derive(Debug, Serialize, ToSchema)]
pub struct TrajectoryGroup {
    /// The run.
    pub run: String,
    /// The lease under which it was flown.
    pub lease: String,
    /// Its number in the lease.
    pub group: i64,
    /// The task.
    pub task: String,
    /// The level.
    pub level: Option<i64>,
    /// `placement`, `frontier`, `rehearsal`, `sample` or `designed`.
    pub role: String,
    /// The layout's id, where it was designed.
    pub layout: Option<String>,
    /// The scenario without its seed: world, task, params, physics, layout.
    #[schema(value_type = Object)]
    pub recipe: Value,
    /// The seed that makes the recipe a scenario.
    pub seed: u64,
    /// The scenario's id.
    pub scenario: String,
    /// Whether acting well matters on this scenario.
    pub contested: bool,
    /// What the scenario is worth. For the trainer, never for the agent.
    pub bracket: BracketView,
    /// The policy that flew it.
    pub policy: String,
    /// Its version.
    pub policy_version: i64,
    /// `telemetry`, `none` (as asked), or `dropped`: with them the group would be larger than 16 MiB.
    pub observations: &'static str,
    /// `none`: a built-in policy has no conversations; `kept`; or `dropped` like observations.
    pub messages: &'static str,
    /// Episodes that the infrastructure lost: they are not here, and count as nothing.
    pub failed: usize,
    /// The others.
    pub episodes: Vec<TrajectoryEpisode>,
}

/// An episode of a group.
#[derive(Debug, Serialize, ToSchema)]
pub struct TrajectoryEpisode {
    /// Its id.
    pub id: String,
    /// The score, by replay.
    pub score: f64,
    /// The skill, where the scenario defines one.
    pub skill: Option<f64>,
    /// Whether it is a success, by the run's rule.
    pub success: bool,
    /// Why the agent went no further: `unparsable`, `too_long` or `too_late`.
    pub stopped: Option<&'static str>,
    /// What a language model took.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub metrics: Option<ModelMetrics>,
    /// Step by step.
    pub steps: Vec<TrajectoryStep>,
    /// What the agents were told at the end.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Object>)]
    pub last_observation: Option<Box<RawValue>>,
}

/// A body as it is kept.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PackedGroup {
    /// Bytes of it as JSON.
    pub bytes: usize,
    /// Compressed.
    pub body: Vec<u8>,
}

/// A body that cannot be kept, or read back.
#[derive(Debug, thiserror::Error)]
pub enum BodyError {
    /// It is too large even without what can be left out.
    #[error("the group is {} MiB of JSON without observations and conversations; at most {} are kept", .0 >> 20, HARD_MOST_BYTES >> 20)]
    TooLarge(usize),
    /// It cannot be written.
    #[error("the group cannot be written: {0}")]
    Json(#[from] serde_json::Error),
    /// It cannot be compressed, or what is kept is not what was compressed.
    #[error("the group cannot be (de)compressed: {0}")]
    Zstd(#[from] std::io::Error),
}

impl TrajectoryGroup {
    /// The body, without what makes it too large.
    ///
    /// # Errors
    /// A group that is too large all the same.
    pub fn pack(mut self) -> Result<PackedGroup, BodyError> {
        let mut json = serde_json::to_vec(&self)?;
        if json.len() > MOST_BYTES && self.observations == "telemetry" {
            self.drop_observations();
            json = serde_json::to_vec(&self)?;
        }
        if json.len() > MOST_BYTES && self.messages == "kept" {
            self.drop_messages();
            json = serde_json::to_vec(&self)?;
        }
        if json.len() > HARD_MOST_BYTES {
            return Err(BodyError::TooLarge(json.len()));
        }
        Ok(PackedGroup { bytes: json.len(), body: zstd::bulk::compress(&json, LEVEL)? })
    }

    /// Leaves out what the agents saw.
    pub fn drop_observations(&mut self) {
        self.observations = "dropped";
        for episode in &mut self.episodes {
            episode.last_observation = None;
            episode.steps.iter_mut().for_each(|step| step.observation = None);
        }
    }

    /// Leaves out conversations; what the model said stays.
    pub fn drop_messages(&mut self) {
        self.messages = "dropped";
        let steps = self.episodes.iter_mut().flat_map(|episode| &mut episode.steps);
        for completion in steps.filter_map(|step| step.completions.as_mut()).flatten() {
            completion.messages.clear();
        }
    }
}

/// A body as JSON again; no more than its `bytes` are taken, whatever is stored.
///
/// # Errors
/// Something stored that is no such body.
pub fn unpack(body: &[u8], bytes: usize) -> Result<Vec<u8>, BodyError> {
    Ok(zstd::bulk::decompress(body, bytes.min(HARD_MOST_BYTES))?)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn group(observation: usize) -> TrajectoryGroup {
        let step = |size: usize| TrajectoryStep {
            observation: RawValue::from_string(format!("\"{}\"", "x".repeat(size))).ok(),
            action: None,
            reward: 0.5,
            agents: Vec::new(),
            done: true,
            error: None,
            completions: None,
        };
        TrajectoryGroup {
            run: "r".to_owned(),
            lease: "1-abcdef".to_owned(),
            group: 0,
            task: "kessler/survival".to_owned(),
            level: Some(1),
            role: "frontier".to_owned(),
            layout: None,
            recipe: Value::Null,
            seed: 1,
            scenario: "s".to_owned(),
            contested: true,
            bracket: BracketView {
                planner: 1,
                floor: 0.1,
                hold: 0.1,
                reference: 0.9,
                panel_success: 1,
                panel: 16,
            },
            policy: "hold".to_owned(),
            policy_version: 0,
            observations: "telemetry",
            messages: "none",
            failed: 0,
            episodes: vec![TrajectoryEpisode {
                id: "ep_1-abcdef_0".to_owned(),
                score: 0.5,
                skill: None,
                success: false,
                stopped: None,
                metrics: None,
                steps: vec![step(observation)],
                last_observation: None,
            }],
        }
    }

    #[test]
    fn a_body_comes_back_as_it_was_and_takes_no_more_than_it_said() {
        let json = serde_json::to_vec(&group(1000)).unwrap();
        let packed = group(1000).pack().unwrap();
        assert_eq!(packed.bytes, json.len());
        assert!(packed.body.len() < json.len() / 2);
        assert_eq!(unpack(&packed.body, packed.bytes).unwrap(), json);
        assert!(unpack(&packed.body, packed.bytes - 1).is_err(), "a bomb is not unpacked");
        assert!(unpack(b"no zstd", 100).is_err());
    }

    #[test]
    fn what_is_too_large_is_told_without_observations_and_says_so() {
        let packed = group(MOST_BYTES).pack().unwrap();
        let told: Value = serde_json::from_slice(&unpack(&packed.body, packed.bytes).unwrap()).unwrap();
        assert_eq!(told["observations"], "dropped");
        assert!(told["episodes"][0]["steps"][0].get("observation").is_none());
        assert_eq!(told["episodes"][0]["steps"][0]["reward"], 0.5);
    }
}
