//! What the agents see, in the wire form of the public kessler-env.

use serde::{Deserialize, Serialize};

use super::constants::{FORMATION_SIDE, RADAR_NONE, TARGET_RADIUS};
use super::event::Event;
use super::flight::{Flight, Status};
use super::kernel::Body;
use super::reward::Objective;
use super::setup::Contact;
use super::warnings::Conjunction;
use crate::chance::Chance;

/// The observation of all satellites together.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Telemetry {
    /// The goal in words.
    pub mission_objective: String,
    /// The radius satellite 0 should reach, LU; 0 if none.
    pub target_radius: f64,
    /// The distance from each other the satellites should keep, LU; 0 (and then not on the wire) if none.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub target_separation: f64,
    /// The agents' own satellites.
    pub satellites: Vec<SatelliteTelemetry>,
    /// Debris that some active satellite's radar sees.
    pub radar_debris: Vec<DebrisTelemetry>,
    /// Conjunctions to come, if the option `warnings` asks for them; else not on the wire.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub conjunctions: Option<Vec<Conjunction>>,
    /// Radar range, LU; 0 sees everything.
    pub radar_range: f64,
    /// What happened in the last step, in words.
    pub critical_alerts: Vec<String>,
    /// The sum of rewards.
    pub total_score: f64,
    /// Reward of the last step.
    pub reward: f64,
    /// The episode is over.
    pub done: bool,
}

/// One satellite as seen.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SatelliteTelemetry {
    /// 0 to 2.
    pub id: u32,
    /// LU.
    pub x: f64,
    /// LU.
    pub y: f64,
    /// LU/TU.
    pub vx: f64,
    /// LU/TU.
    pub vy: f64,
    /// Fuel left.
    pub fuel: f64,
    /// `active` or `destroyed`.
    pub status: String,
    /// Under `risk: pc`, the probability that it still flies; else not on the wire.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub survival_probability: Option<f64>,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "the signature serde asks for")]
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

impl SatelliteTelemetry {
    /// Whether it flies.
    #[must_use]
    pub fn active(&self) -> bool {
        self.status == "active"
    }

    /// Position and velocity.
    #[must_use]
    pub const fn body(&self) -> Body {
        Body { x: self.x, y: self.y, vx: self.vx, vy: self.vy }
    }
}

/// One piece of debris as seen.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DebrisTelemetry {
    /// Stable over the episode.
    pub id: u32,
    /// LU.
    pub x: f64,
    /// LU.
    pub y: f64,
    /// LU/TU.
    pub vx: f64,
    /// LU/TU.
    pub vy: f64,
}

impl DebrisTelemetry {
    /// Position and velocity.
    #[must_use]
    pub const fn body(&self) -> Body {
        Body { x: self.x, y: self.y, vx: self.vx, vy: self.vy }
    }
}

impl Objective {
    /// The radius satellite 0 should reach, LU; 0 if none.
    pub(super) const fn target_radius(self) -> f64 {
        if matches!(self, Self::Rendezvous) { TARGET_RADIUS } else { 0.0 }
    }

    /// The distance from each other the satellites should keep, LU; 0 if none.
    pub(super) const fn target_separation(self) -> f64 {
        if matches!(self, Self::Formation) { FORMATION_SIDE } else { 0.0 }
    }

    /// The goal in the public kessler-env's words.
    #[must_use]
    pub const fn mission(self) -> &'static str {
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

impl<C: Chance> Flight<C> {
    /// What the agents see; with `all`, hidden debris too.
    #[must_use]
    pub fn telemetry(&self, reward: f64, all: bool) -> Telemetry {
        Telemetry {
            mission_objective: self.objective().mission().to_owned(),
            target_radius: self.objective().target_radius(),
            target_separation: self.objective().target_separation(),
            satellites: self.satellites_seen().collect(),
            radar_debris: self.debris_seen(all).collect(),
            conjunctions: self.conjunctions(all),
            radar_range: self.range_told(),
            critical_alerts: self.events().iter().filter_map(Event::alert).collect(),
            total_score: self.total(),
            reward,
            done: self.done(),
        }
    }

    /// The satellites as seen.
    pub(super) fn satellites_seen(&self) -> impl Iterator<Item = SatelliteTelemetry> {
        let at_risk = matches!(self.setup().physics.contact, Contact::Chance(_));
        (0u32..).zip(self.satellites()).map(move |(id, s)| SatelliteTelemetry {
            id,
            x: s.body.x,
            y: s.body.y,
            vx: s.body.vx,
            vy: s.body.vy,
            fuel: s.fuel,
            status: if s.status == Status::Active { "active" } else { "destroyed" }.to_owned(),
            survival_probability: at_risk.then_some(s.survival),
        })
    }

    /// The debris that is seen; with `all`, hidden debris too.
    pub(super) fn debris_seen(&self, all: bool) -> impl Iterator<Item = DebrisTelemetry> {
        let debris = self.debris();
        (0..debris.len())
            .map(|i| (debris.id(i), debris.body(i)))
            .filter(move |(_, body)| all || self.sees(body.x, body.y))
            .map(|(id, Body { x, y, vx, vy })| DebrisTelemetry { id, x, y, vx, vy })
    }

    /// Radar range, LU; 0 sees everything.
    pub(super) fn range_told(&self) -> f64 {
        self.setup().radar_range.filter(|&r| r < RADAR_NONE).unwrap_or(0.0)
    }
}
