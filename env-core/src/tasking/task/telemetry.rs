//! Observations of the agents as JSON, in plain units.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use super::critique::death_reason;
use super::rounding::round;
use super::run::TaskRun;
use super::spaces::IMAGE_ACTIONS;
use crate::tasking::access::OpportunityKind;
use crate::tasking::observation::property::Property;

/// Text of the goal of scanning.
const SCANNING_MISSION: &str =
    "Scan the ground below as long as possible, without an empty battery or wheels that are too fast.";
/// Text of the goal of imaging.
const IMAGING_MISSION: &str = "Image targets of high priority within their windows, without an empty battery or wheels that are too fast.";

/// Decimals of times in s, beyond which they have errors of rounding.
const TIME_DECIMALS: i32 = 6;

/// Observation of all satellites together.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TaskingTelemetry {
    /// Text of the goal.
    pub mission_objective: Cow<'static, str>,
    /// Time since the start, s.
    pub time_s: f64,
    /// Time at which the episode ends, s.
    pub time_limit_s: f64,
    /// Names of the actions, by index.
    pub actions: Vec<Cow<'static, str>>,
    /// All satellites, including dead ones.
    pub satellites: Vec<TaskedSatelliteTelemetry>,
    /// Texts of the events of the last step.
    pub critical_alerts: Vec<String>,
    /// Sum of the team's rewards.
    pub total_score: f64,
    /// Reward of the team in the last step.
    pub reward: f64,
    /// True if the episode is over.
    pub done: bool,
}

/// Observation of one satellite.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TaskedSatelliteTelemetry {
    /// Number of the satellite, counted from 0.
    pub id: u32,
    /// True until the satellite dies.
    pub alive: bool,
    /// True if the satellite needs an action; false while it is busy.
    pub needs_action: bool,
    /// Name of the last action; none before the first.
    pub action: Option<Cow<'static, str>>,
    /// Charge as a share of the battery's capacity.
    pub battery: f64,
    /// Data as a share of the storage's capacity.
    pub storage: f64,
    /// Speeds of the wheels as shares of the limit.
    pub wheels: [f64; 3],
    /// Angle between the instrument and nadir, degrees.
    pub instrument_error_deg: f64,
    /// Angle between the panel's normal and the Sun, degrees.
    pub sun_error_deg: f64,
    /// Time until the next eclipse begins, s; the end of the episode if there is none.
    pub eclipse_start_s: f64,
    /// Time until the next end of an eclipse, s.
    pub eclipse_end_s: f64,
    /// Time until the next window of a ground station opens, s; negative if it is open.
    pub station_open_s: f64,
    /// Time until that window closes, s.
    pub station_close_s: f64,
    /// The next targets; the action `image_k` images the one at index k.
    pub targets: Vec<TargetTelemetry>,
}

/// Observation of an upcoming target.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TargetTelemetry {
    /// Value of an image.
    pub priority: f64,
    /// Time until the window opens, s; negative if it is open.
    pub open_s: f64,
    /// Time until the window closes, s.
    pub close_s: f64,
    /// Angle between the instrument and the target, degrees.
    pub angle_deg: f64,
}

impl TaskRun {
    /// Texts of the events of the last step.
    pub(super) fn alerts(&self) -> Vec<String> {
        let died = |(agent, checks): &(usize, String)| {
            format!("Satellite {agent} died: {}.", death_reason(checks).1)
        };
        self.last_step().deaths.iter().map(died).collect()
    }

    /// Observation of all agents.
    pub(super) fn telemetry(&mut self) -> TaskingTelemetry {
        let mut satellites = Vec::with_capacity(self.sim.len());
        for index in 0..self.sim.len() {
            satellites.push(self.satellite_telemetry(index));
        }
        let is_imaging = !self.sim.targets().is_empty();
        TaskingTelemetry {
            mission_objective: Cow::Borrowed(if is_imaging { IMAGING_MISSION } else { SCANNING_MISSION }),
            time_s: round(self.sim.time_s(), TIME_DECIMALS),
            time_limit_s: self.sim.time_limit_s(),
            actions: self.action_names().iter().map(|name| Cow::Borrowed(*name)).collect(),
            satellites,
            critical_alerts: self.alerts(),
            total_score: self.outcome().score,
            reward: self.last_step().reward,
            done: self.is_done(),
        }
    }

    /// Observation of one satellite.
    pub(super) fn satellite_telemetry(&mut self, index: usize) -> TaskedSatelliteTelemetry {
        let moment = self.sim.moment(index);
        let mut values = Vec::new();
        let view = self.sim.view(index, &moment);
        for property in [
            Property::BatteryChargeFraction,
            Property::StorageLevelFraction,
            Property::WheelSpeedsFraction,
            Property::InstrumentPointingError,
            Property::SolarPointingError,
        ] {
            property.write(&view, &mut values);
        }
        let value = |at: usize| values.get(at).copied().unwrap_or_default();
        let now = self.sim.time_s();
        let eclipse = self.sim.next_eclipse(index).unwrap_or([self.sim.time_limit_s(); 2]);
        let stations = self.sim.next_windows(index, OpportunityKind::GroundStation, 1);
        let targets = if self.sim.targets().is_empty() {
            Vec::new()
        } else {
            self.sim.next_windows(index, OpportunityKind::Target, IMAGE_ACTIONS)
        };
        let left = self.sim.time_limit_s() - now;
        let [open, close] =
            stations.first().map_or([left; 2], |window| [window.open_s - now, window.close_s - now]);
        let targets = targets
            .iter()
            .map(|window| TargetTelemetry {
                priority: self.sim.targets()[window.object].priority,
                open_s: window.open_s - now,
                close_s: window.close_s - now,
                angle_deg: self.sim.angle_to(window.object, &moment).to_degrees(),
            })
            .collect();
        TaskedSatelliteTelemetry {
            id: index as u32,
            alive: !self.is_dead(index),
            needs_action: self.needs_action(index),
            action: self
                .current_action(index)
                .and_then(|action| Some(Cow::Borrowed(*self.action_names().get(action)?))),
            battery: value(0),
            storage: value(1),
            wheels: [value(2), value(3), value(4)],
            instrument_error_deg: value(5).to_degrees(),
            sun_error_deg: value(6).to_degrees(),
            eclipse_start_s: eclipse[0] - now,
            eclipse_end_s: eclipse[1] - now,
            station_open_s: open,
            station_close_s: close,
            targets,
        }
    }

    /// Names of an agent's actions.
    pub(super) fn action_names(&self) -> &'static [&'static str] {
        let space = if self.sim.targets().is_empty() {
            super::spaces::SCANNING_ACTIONS
        } else {
            super::spaces::IMAGING_ACTIONS
        };
        space.names()
    }
}
