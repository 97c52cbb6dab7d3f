//! Telemetry: what the agents see, in the JSON form of the public kessler-env.

use serde::{Deserialize, Serialize};

use super::constants::{FORMATION_SIDE, RADAR_NONE, TARGET_RADIUS};
use super::event::KesslerEvent;
use super::kernel::Body;
use super::reward::Objective;
use super::setup::ContactModel;
use super::simulation::{KesslerSim, SatelliteStatus};
use super::warnings::Conjunction;
use crate::episode_rng::EpisodeRng;

/// Observation of all satellites together.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct KesslerTelemetry {
    /// Goal of the task as text.
    pub mission_objective: String,
    /// Target radius of satellite 0, LU; 0 if the task has none.
    pub target_radius: f64,
    /// Target distance between satellites, LU; 0 if the task has none (omitted from JSON then).
    #[serde(default, skip_serializing_if = "is_zero")]
    pub target_separation: f64,
    /// All satellites, by number.
    pub satellites: Vec<SatelliteTelemetry>,
    /// Debris within the radar range of some active satellite.
    pub radar_debris: Vec<DebrisTelemetry>,
    /// Conjunction warnings, if the option `warnings` asks for them (omitted from JSON otherwise).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub conjunctions: Option<Vec<Conjunction>>,
    /// Radar range, LU; 0 hides nothing.
    pub radar_range: f64,
    /// Alert texts of the last step.
    pub critical_alerts: Vec<String>,
    /// Sum of all rewards so far.
    pub total_score: f64,
    /// Reward of the last step.
    pub reward: f64,
    /// True if the episode is over.
    pub done: bool,
}

/// Telemetry of one satellite.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SatelliteTelemetry {
    /// Number of the satellite, 0 to 2.
    pub id: u32,
    /// Position along x, LU.
    pub x: f64,
    /// Position along y, LU.
    pub y: f64,
    /// Velocity along x, LU/TU.
    pub vx: f64,
    /// Velocity along y, LU/TU.
    pub vy: f64,
    /// Remaining fuel, in fuel units.
    pub fuel: f64,
    /// Status word: `active` or `destroyed`.
    pub status: String,
    /// Probability that the satellite still flies, under `risk: pc` (omitted from JSON otherwise).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub survival_probability: Option<f64>,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "the signature serde asks for")]
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

impl SatelliteTelemetry {
    /// Returns true if the satellite flies.
    #[must_use]
    pub fn is_active(&self) -> bool {
        self.status == "active"
    }

    /// State vector of the satellite.
    #[must_use]
    pub const fn body(&self) -> Body {
        Body { x: self.x, y: self.y, vx: self.vx, vy: self.vy }
    }
}

/// Telemetry of one debris body.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DebrisTelemetry {
    /// Id of the body, stable over the episode.
    pub id: u32,
    /// Position along x, LU.
    pub x: f64,
    /// Position along y, LU.
    pub y: f64,
    /// Velocity along x, LU/TU.
    pub vx: f64,
    /// Velocity along y, LU/TU.
    pub vy: f64,
}

impl DebrisTelemetry {
    /// State vector of the debris.
    #[must_use]
    pub const fn body(&self) -> Body {
        Body { x: self.x, y: self.y, vx: self.vx, vy: self.vy }
    }
}

impl Objective {
    /// Target radius of satellite 0, LU; 0 if the task has none.
    pub(super) const fn target_radius(self) -> f64 {
        if matches!(self, Self::Rendezvous) { TARGET_RADIUS } else { 0.0 }
    }

    /// Target distance between satellites, LU; 0 if the task has none.
    pub(super) const fn target_separation(self) -> f64 {
        if matches!(self, Self::Formation) { FORMATION_SIDE } else { 0.0 }
    }

    /// Goal of the task in the words of the public kessler-env.
    #[must_use]
    pub const fn mission_text(self) -> &'static str {
        match self {
            Self::Survival => "SURVIVAL: Keep all satellites alive for 50 steps.",
            Self::EcoStation => {
                "ECO-STATION: Survive, but fuel usage heavily reduces your score. Do not over-correct."
            }
            Self::Rendezvous => {
                "RENDEZVOUS: Navigate Satellite 0 to reach and hold an orbital radius of exactly 100.0."
            }
            Self::Formation => {
                "FORMATION: Keep the three satellites in an equilateral triangle with sides of 20.0, losing none."
            }
        }
    }
}

impl<R: EpisodeRng> KesslerSim<R> {
    /// Telemetry of the agents; `all` includes hidden debris.
    #[must_use]
    pub fn telemetry(&self, reward: f64, all: bool) -> KesslerTelemetry {
        KesslerTelemetry {
            mission_objective: self.objective().mission_text().to_owned(),
            target_radius: self.objective().target_radius(),
            target_separation: self.objective().target_separation(),
            satellites: self.satellite_telemetry().collect(),
            radar_debris: self.debris_telemetry(all).collect(),
            conjunctions: self.conjunctions(all),
            radar_range: self.reported_radar_range(),
            critical_alerts: self.events().iter().filter_map(KesslerEvent::alert).collect(),
            total_score: self.total_reward(),
            reward,
            done: self.is_done(),
        }
    }

    /// Telemetry of each satellite.
    pub(super) fn satellite_telemetry(&self) -> impl Iterator<Item = SatelliteTelemetry> {
        let has_risk = matches!(self.setup().physics.contact, ContactModel::Probability(_));
        (0u32..).zip(self.satellites()).map(move |(id, s)| SatelliteTelemetry {
            id,
            x: s.body.x,
            y: s.body.y,
            vx: s.body.vx,
            vy: s.body.vy,
            fuel: s.fuel,
            status: if s.status == SatelliteStatus::Active { "active" } else { "destroyed" }.to_owned(),
            survival_probability: has_risk.then_some(s.survival),
        })
    }

    /// Telemetry of each visible debris body; `all` includes hidden ones.
    pub(super) fn debris_telemetry(&self, all: bool) -> impl Iterator<Item = DebrisTelemetry> {
        let debris = self.debris();
        (0..debris.len())
            .map(|i| (debris.id(i), debris.body(i)))
            .filter(move |(_, body)| all || self.is_visible(body.x, body.y))
            .map(|(id, Body { x, y, vx, vy })| DebrisTelemetry { id, x, y, vx, vy })
    }

    /// Radar range as reported, LU; 0 hides nothing.
    pub(super) fn reported_radar_range(&self) -> f64 {
        self.setup().radar_range.filter(|&r| r < RADAR_NONE).unwrap_or(0.0)
    }
}
