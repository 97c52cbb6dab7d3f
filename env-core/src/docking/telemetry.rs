//! What the agents see, in the wire form.

use std::borrow::Cow;

use serde::{Deserialize, Serialize, Serializer};

use super::constants::{DOCKING_RADIUS_M, OBSERVATION, STEP_S};
use super::event::Event;
use super::flight::{Flight, Status, observe};
use super::relative::{State, distance, relative_speed, separation, speed, speed_limit};
use super::reward::Reward;

/// The observation of all deputies together. Units are SI, the frame is Hill's: x radial out, y in-track, z cross-track,
/// the chief at its origin.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Telemetry {
    /// The goal in words.
    pub mission_objective: Cow<'static, str>,
    /// Time that passed, s.
    pub time_s: f64,
    /// Time at which a deputy that has not docked has failed, s.
    pub time_limit_s: f64,
    /// Largest thrust per axis, N.
    pub thrust_bound: f64,
    /// Within this distance a deputy docks or crashes, m.
    pub docking_radius: f64,
    /// The deputies.
    pub deputies: Vec<DeputyTelemetry>,
    /// What happened in the last step, and who is too fast now, in words.
    pub critical_alerts: Vec<String>,
    /// The sum of the team's rewards.
    pub total_score: f64,
    /// The team's reward of the last step: the mean over the initial deputies.
    pub reward: f64,
    /// The episode is over.
    pub done: bool,
}

/// One deputy as seen.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DeputyTelemetry {
    /// Counted from 0.
    pub id: u32,
    /// What became of it.
    pub status: Status,
    /// m.
    pub x: f64,
    /// m.
    pub y: f64,
    /// m.
    pub z: f64,
    /// m/s.
    pub vx: f64,
    /// m/s.
    pub vy: f64,
    /// m/s.
    pub vz: f64,
    /// From the chief, m.
    pub distance: f64,
    /// Relative to the chief, m/s.
    pub speed: f64,
    /// The speed limit here, m/s.
    pub speed_limit: f64,
    /// The eight numbers of the original's observation.
    #[serde(serialize_with = "as_double")]
    pub observation: [f32; OBSERVATION],
    /// The nearest other deputy that flies.
    pub nearest: Option<Nearest>,
    /// Its velocity reward so far; at −5 it is stopped.
    pub velocity_penalty: f64,
    /// Its reward of the last step, by component.
    pub reward: Reward,
    /// The sum of its rewards.
    pub total_reward: f64,
}

/// Another deputy, seen from one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Nearest {
    /// Which.
    pub id: u32,
    /// How far, m.
    pub distance: f64,
    /// Relative speed, m/s.
    pub relative_speed: f64,
}

/// As JSON values hold them, so that text and value say the same to the digit.
fn as_double<S: Serializer>(values: &[f32; OBSERVATION], serializer: S) -> Result<S::Ok, S::Error> {
    values.map(f64::from).serialize(serializer)
}

impl DeputyTelemetry {
    /// Whether it flies.
    #[must_use]
    pub fn active(&self) -> bool {
        self.status == Status::Active
    }

    /// Position and velocity.
    #[must_use]
    pub const fn state(&self) -> State {
        [self.x, self.y, self.z, self.vx, self.vy, self.vz]
    }
}

pub(super) const MISSION: &str = "DOCKING: Bring every deputy within 0.5 m of the chief at no more than 0.2 m/s, below the speed \
                       limit on the way, before time runs out.";

impl Flight {
    /// What the agents see. `rewards` are those of the last step, by deputy, `reward` the team's.
    #[must_use]
    pub fn telemetry(&self, rewards: &[Reward], reward: f64) -> Telemetry {
        Telemetry {
            mission_objective: Cow::Borrowed(MISSION),
            time_s: self.time_s(),
            time_limit_s: self.time_limit_s(),
            thrust_bound: self.setup().thrust_bound,
            docking_radius: DOCKING_RADIUS_M,
            deputies: self.deputies_seen(rewards).collect(),
            critical_alerts: self.alerts().collect(),
            total_score: self.total(),
            reward,
            done: self.done(),
        }
    }

    pub(super) fn time_s(&self) -> f64 {
        f64::from(self.steps()) * STEP_S
    }

    pub(super) fn time_limit_s(&self) -> f64 {
        f64::from(self.setup().time_limit) * STEP_S
    }

    /// The deputies as seen; `rewards` are those of the last step.
    pub(super) fn deputies_seen(&self, rewards: &[Reward]) -> impl Iterator<Item = DeputyTelemetry> {
        (0..self.deputies().len())
            .map(|i| self.deputy_telemetry(i, rewards.get(i).copied().unwrap_or_default()))
    }

    /// What happened in the last step, and who is too fast now, in words.
    pub(super) fn alerts(&self) -> impl Iterator<Item = String> {
        let too_fast = self.deputies().iter().enumerate().filter_map(|(i, deputy)| {
            let (speed, limit) = (speed(&deputy.state), speed_limit(distance(&deputy.state)));
            (self.status(i) == Status::Active && speed > limit).then(|| {
                format!("WARNING: Deputy {i} flies at {speed:.3} m/s, above the limit of {limit:.3} m/s.")
            })
        });
        self.events().iter().map(Event::alert).chain(too_fast)
    }

    fn deputy_telemetry(&self, i: usize, reward: Reward) -> DeputyTelemetry {
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
            observation: observe(state),
            nearest: self.nearest(i),
            velocity_penalty: deputy.velocity_sum,
            reward,
            total_reward: deputy.earned,
        }
    }

    /// The nearest other deputy that flies.
    fn nearest(&self, i: usize) -> Option<Nearest> {
        let state = &self.deputies()[i].state;
        let others = self.deputies().iter().enumerate();
        others
            .filter(|(j, other)| *j != i && other.flies())
            .map(|(j, other)| Nearest {
                id: j as u32,
                distance: separation(state, &other.state),
                relative_speed: relative_speed(state, &other.state),
            })
            .min_by(|a, b| a.distance.total_cmp(&b.distance))
    }
}
