//! Critique of an episode: why it lost score and what its actions were worth.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Critique of a finished episode, computed from its scenario and actions alone.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct Critique {
    /// Reasons why score was lost, in order of step.
    pub failures: Vec<CritiqueFailure>,
    /// Value of each action against the same episode without it, in order of step.
    pub actions: Vec<ActionValue>,
    /// Assessment by the deterministic judge.
    pub assessment: JudgeAssessment,
    /// Reason why failures are without `measures` and `cheapest_avoidance`, and their `explanation` is that of the failure mode;
    /// null if the critique is complete.
    pub withheld: Option<String>,
}

/// Reason why an episode lost score.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct CritiqueFailure {
    /// Name of the failure mode.
    pub mode: String,
    /// Index of the agent that failed.
    pub agent: u32,
    /// Step of the failure, from 1.
    pub step: u32,
    /// Sector of the failure in a failure profile, from 0 to 11; null if it has no angle.
    pub sector: Option<u32>,
    /// Angle of the failure in the quantity of the task's sectors, degrees in [0, 360): the bearing of an encounter, or the orbit
    /// angle of the satellite.
    pub sector_deg: Option<f64>,
    /// Geometry of the encounter; null for a failure without one.
    pub encounter: Option<CritiqueEncounter>,
    /// Further measures of the failure mode.
    pub measures: Vec<FailureMeasure>,
    /// Description of the failure in one sentence.
    pub explanation: String,
}

/// Measure of a failure.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct FailureMeasure {
    /// Name of the measure.
    pub name: String,
    /// Value of the measure.
    pub value: f64,
    /// Unit of the value; empty for a pure number.
    pub unit: String,
}

/// Geometry of an encounter.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct CritiqueEncounter {
    /// Id of the encountered body, among the bodies of its kind.
    pub body: u32,
    /// Bearing from the agent to the body a few steps before the contact: degrees in [0, 360) from radial out towards in-track.
    pub bearing_deg: f64,
    /// The same bearing from +X towards +Y of the inertial frame; null in a world without such a frame.
    pub bearing_inertial_deg: Option<f64>,
    /// Relative speed at contact, in the world's unit of speed.
    pub relative_speed: f64,
    /// Speed band in a failure profile, from 0.
    pub band: u32,
    /// First step after which the body was visible, 0 at the start; null if it never was.
    pub first_visible_step: Option<u32>,
    /// Number of steps from `first_visible_step` to the contact in which the agent could act.
    pub steps_left: u32,
    /// True if actions from `first_visible_step` on, with the remaining fuel, would have avoided the contact; null if the body
    /// was never visible.
    pub avoidable: Option<bool>,
    /// Cheapest avoiding action that was found.
    pub cheapest_avoidance: Option<AvoidingAction>,
}

/// Action that would have avoided a failure.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct AvoidingAction {
    /// Step of the action, from 1.
    pub step: u32,
    /// Values of the action, in the order of the task's action space.
    pub values: Vec<f64>,
    /// Cost, in the world's unit of fuel.
    pub cost: f64,
}

/// Effect of an action on the score.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct ActionValue {
    /// Step of the action, from 1.
    pub step: u32,
    /// Index of the agent that acted.
    pub agent: u32,
    /// Cost, in the world's unit of fuel.
    pub cost: f64,
    /// Verdict on the action.
    pub verdict: ActionVerdict,
    /// Score with the action minus the score without it.
    pub gain: f64,
}

/// Assessment of an episode by the deterministic judge.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct JudgeAssessment {
    /// Value from −1 to 1.
    pub value: f64,
    /// Case of the judge's rules.
    pub case: String,
    /// Description of the assessment in one sentence.
    pub explanation: String,
}

/// Critique of one episode of a run.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct EpisodeCritique {
    /// Id of the episode.
    pub episode: String,
    /// Id of the task.
    pub task: String,
    /// Critique of the episode.
    #[serde(flatten)]
    pub critique: Critique,
}

/// Verdict on an action, against the same episode without it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ActionVerdict {
    /// The action avoided a loss.
    Needed,
    /// The action cost little and changed nothing.
    Harmless,
    /// The action cost fuel without a benefit.
    Wasteful,
    /// The action lowered the score.
    Harmful,
}
