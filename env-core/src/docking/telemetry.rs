//! Observations of the agents as JSON.

use std::borrow::Cow;

use serde::{Deserialize, Serialize, Serializer};

use super::constants::{DOCKING_RADIUS_M, OBSERVATION_DIM, STEP_S};
use super::end_conditions::DeputyStatus;
use super::event::DockingEvent;
use super::relative_motion::{RelativeState, distance, relative_speed, separation, speed, speed_limit};
use super::reward::DockingReward;
use super::simulation::{DockingSim, observe_deputy};

/// Observation of all deputies together. Units are SI. The frame is Hill's: x radial out, y in-track, z cross-track, with
/// the chief at its origin.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DockingTelemetry {
    /// Text of the goal.
    pub mission_objective: Cow<'static, str>,
    /// Time since the start, s.
    pub time_s: f64,
    /// Time at which a deputy that has not docked has failed, s.
    pub time_limit_s: f64,
    /// Largest thrust per axis, N.
    pub thrust_bound: f64,
    /// Distance within which a deputy docks or crashes, m.
    pub docking_radius: f64,
    /// All deputies, including those that have left.
    pub deputies: Vec<DeputyTelemetry>,
    /// Texts of the events of the last step, and warnings of deputies above the speed limit.
    pub critical_alerts: Vec<String>,
    /// Sum of the team's rewards.
    pub total_score: f64,
    /// Reward of the team in the last step: the mean over the initial deputies.
    pub reward: f64,
    /// True if the episode is over.
    pub done: bool,
}

/// Observation of one deputy.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DeputyTelemetry {
    /// Number of the deputy, counted from 0.
    pub id: u32,
    /// Status of the deputy: active, or how it left.
    pub status: DeputyStatus,
    /// Position radially out, m.
    pub x: f64,
    /// Position along the orbit (in-track), m.
    pub y: f64,
    /// Position across the orbit plane (cross-track), m.
    pub z: f64,
    /// Velocity radially out, m/s.
    pub vx: f64,
    /// Velocity along the orbit (in-track), m/s.
    pub vy: f64,
    /// Velocity across the orbit plane (cross-track), m/s.
    pub vz: f64,
    /// Distance from the chief, m.
    pub distance: f64,
    /// Speed relative to the chief, m/s.
    pub speed: f64,
    /// Speed limit at its distance, m/s.
    pub speed_limit: f64,
    /// The eight values of the original's observation.
    #[serde(serialize_with = "as_double")]
    pub observation: [f32; OBSERVATION_DIM],
    /// The nearest other active deputy, if any.
    pub nearest: Option<NearestDeputy>,
    /// Sum of its velocity rewards; at −5 it is stopped.
    pub velocity_penalty: f64,
    /// Its reward in the last step by component.
    pub reward: DockingReward,
    /// Sum of its rewards.
    pub total_reward: f64,
}

/// Another deputy as seen from one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct NearestDeputy {
    /// Number of the other deputy.
    pub id: u32,
    /// Distance to it, m.
    pub distance: f64,
    /// Relative speed of the two, m/s.
    pub relative_speed: f64,
}

/// Serialises as doubles, so that JSON text and `serde_json::Value` are equal to the digit.
fn as_double<S: Serializer>(values: &[f32; OBSERVATION_DIM], serializer: S) -> Result<S::Ok, S::Error> {
    values.map(f64::from).serialize(serializer)
}

impl DeputyTelemetry {
    /// True if it has not left the episode.
    #[must_use]
    pub fn is_active(&self) -> bool {
        self.status == DeputyStatus::Active
    }

    /// Position in m and velocity in m/s.
    #[must_use]
    pub const fn state(&self) -> RelativeState {
        [self.x, self.y, self.z, self.vx, self.vy, self.vz]
    }
}

/// Text of the goal.
pub(super) const MISSION_TEXT: &str = "DOCKING: Bring every deputy within 0.5 m of the chief at no more than 0.2 m/s, below \
                                       the speed limit on the way, before time runs out.";

impl DockingSim {
    /// Observation of all agents. `rewards` are those of the deputies in the last step, `reward` that of the team.
    #[must_use]
    pub fn telemetry(&self, rewards: &[DockingReward], reward: f64) -> DockingTelemetry {
        DockingTelemetry {
            mission_objective: Cow::Borrowed(MISSION_TEXT),
            time_s: self.time_s(),
            time_limit_s: self.time_limit_s(),
            thrust_bound: self.setup().thrust_bound,
            docking_radius: DOCKING_RADIUS_M,
            deputies: self.deputies_telemetry(rewards).collect(),
            critical_alerts: self.alerts().collect(),
            total_score: self.total(),
            reward,
            done: self.is_done(),
        }
    }

    /// Time since the start, s.
    pub(super) fn time_s(&self) -> f64 {
        f64::from(self.steps()) * STEP_S
    }

    /// Time limit of the episode, s.
    pub(super) fn time_limit_s(&self) -> f64 {
        f64::from(self.setup().time_limit) * STEP_S
    }

    /// Telemetry of each deputy; `rewards` are those of the last step.
    pub(super) fn deputies_telemetry(
        &self,
        rewards: &[DockingReward],
    ) -> impl Iterator<Item = DeputyTelemetry> {
        (0..self.deputies().len())
            .map(|i| self.deputy_telemetry(i, rewards.get(i).copied().unwrap_or_default()))
    }

    /// Texts of the events of the last step, then warnings of deputies above the speed limit.
    pub(super) fn alerts(&self) -> impl Iterator<Item = String> {
        let too_fast = self.deputies().iter().enumerate().filter_map(|(i, deputy)| {
            let (speed, limit) = (speed(&deputy.state), speed_limit(distance(&deputy.state)));
            (self.status(i) == DeputyStatus::Active && speed > limit).then(|| {
                format!("WARNING: Deputy {i} flies at {speed:.3} m/s, above the limit of {limit:.3} m/s.")
            })
        });
        self.events().iter().map(DockingEvent::alert).chain(too_fast)
    }

    fn deputy_telemetry(&self, i: usize, reward: DockingReward) -> DeputyTelemetry {
        let deputy = &self.deputies()[i];
        let state = &deputy.state;
        let [x, y, z, vx, vy, vz] = *state;
        let distance = distance(state);
        DeputyTelemetry {
            id: i as u32,
            status: self.status(i),
            x,
            y,
            z,
            vx,
            vy,
            vz,
            distance,
            speed: speed(state),
            speed_limit: speed_limit(distance),
            observation: observe_deputy(state),
            nearest: self.nearest(i),
            velocity_penalty: deputy.velocity_penalty,
            reward,
            total_reward: deputy.total_reward,
        }
    }

    /// The nearest other active deputy, if any.
    fn nearest(&self, i: usize) -> Option<NearestDeputy> {
        let state = &self.deputies()[i].state;
        let others = self.deputies().iter().enumerate();
        others
            .filter(|(j, other)| *j != i && other.is_active())
            .map(|(j, other)| NearestDeputy {
                id: j as u32,
                distance: separation(state, &other.state),
                relative_speed: relative_speed(state, &other.state),
            })
            .min_by(|a, b| a.distance.total_cmp(&b.distance))
    }
}
