//! Scripted agents with one known weakness each: what a designer must find from the failure profile alone. Three are the
//! causal pilot of kessler with something taken away; one burns for whatever comes near.

use std::any::Any;

use env_core::kessler::bearing::Frame;
use env_core::kessler::kernel::{Body, Gravity};
use env_core::kessler::telemetry::{SatelliteTelemetry, Telemetry};
use env_core::policy::{Policy, PolicyError};
use env_core::{ActionLog, Scenario};

/// A known weakness.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Weakness {
    /// Does not see debris within 45° of +Y of a satellite.
    BlindTowardsY,
    /// Burns whenever debris will come within 8 LU, hit or miss.
    Nervous,
    /// Acts on what there was a step ago.
    Late,
    /// Does not see debris within 60° of behind a satellite: what overtakes it.
    NeverLooksBehind,
}

/// All, with what people call them.
pub const ALL: [(&str, Weakness); 4] = [
    ("blind towards +Y", Weakness::BlindTowardsY),
    ("nervous", Weakness::Nervous),
    ("late", Weakness::Late),
    ("never looks behind", Weakness::NeverLooksBehind),
];

/// The agent with this weakness, for a scenario of kessler.
///
/// # Errors
/// A scenario of another world.
pub fn agent(weakness: Weakness, scenario: &Scenario) -> Result<Box<dyn Policy>, PolicyError> {
    let pilot = || scenario.task().policy("heuristic", scenario, 0);
    Ok(match weakness {
        Weakness::BlindTowardsY => {
            Box::new(Blinkered { pilot: pilot()?, frame: Frame::Inertial, at: 90.0, half: 45.0 })
        }
        Weakness::NeverLooksBehind => {
            Box::new(Blinkered { pilot: pilot()?, frame: Frame::RadialInTrack, at: 270.0, half: 60.0 })
        }
        Weakness::Late => Box::new(Late { pilot: pilot()?, before: None }),
        Weakness::Nervous => Box::new(Nervous),
    })
}

/// A pilot that does not see some bearings: what only the satellite it threatens would see there is not there for it.
struct Blinkered {
    pilot: Box<dyn Policy>,
    frame: Frame,
    at: f64,
    half: f64,
}

impl Policy for Blinkered {
    fn act(&mut self, observation: &dyn Any, log: &mut ActionLog) {
        let Some(seen) = observation.downcast_ref::<Telemetry>() else {
            log.end_step();
            return;
        };
        // Each satellite has its own blinkers: the pilot flies them one by one and only its burns are kept.
        let mut merged: Vec<(u32, [f64; 2])> = Vec::new();
        for satellite in seen.satellites.iter().filter(|s| s.active()) {
            let mut narrowed = seen.clone();
            narrowed.radar_debris.retain(|debris| {
                let bearing = self.frame.bearing_deg(&satellite.body(), (debris.x, debris.y));
                super::place::difference(self.at, bearing).abs() > self.half
            });
            let mut own = ActionLog::new(2, log.precision());
            self.pilot.act(&narrowed, &mut own);
            let acted = own.step(0);
            for (&agent, values) in acted.agents.iter().zip(acted.values.chunks_exact(2)) {
                if agent == satellite.id {
                    merged.push((agent, [values[0], values[1]]));
                }
            }
        }
        for (agent, burn) in merged {
            log.act(agent, &burn);
        }
        log.end_step();
    }
}

/// A pilot that sees what was a step ago.
struct Late {
    pilot: Box<dyn Policy>,
    before: Option<Telemetry>,
}

impl Policy for Late {
    fn act(&mut self, observation: &dyn Any, log: &mut ActionLog) {
        let now = observation.downcast_ref::<Telemetry>();
        match (self.before.take(), now) {
            (Some(before), Some(_)) => self.pilot.act(&before, log),
            _ => log.end_step(),
        }
        self.before = now.cloned();
    }
}

/// Steps it foresees, the distance that alarms it, LU, and what it then burns, LU/TU.
const AHEAD: u32 = 6;
const ALARM: f64 = 8.0;
const KICK: f64 = 0.25;

/// Burns away from whatever will come near.
struct Nervous;

impl Policy for Nervous {
    fn act(&mut self, observation: &dyn Any, log: &mut ActionLog) {
        if let Some(seen) = observation.downcast_ref::<Telemetry>() {
            for satellite in seen.satellites.iter().filter(|s| s.active()) {
                if let Some(burn) = nervous(satellite, seen) {
                    log.act(satellite.id, &burn);
                }
            }
        }
        log.end_step();
    }
}

fn nervous(satellite: &SatelliteTelemetry, seen: &Telemetry) -> Option<[f64; 2]> {
    let nearest = seen.radar_debris.iter().map(|debris| nearest(satellite.body(), debris.body()));
    let (distance, dx, dy) = nearest.min_by(|a, b| a.0.total_cmp(&b.0))?;
    // A burn costs 5 units of fuel an LU/TU: one that cannot be paid would be refused.
    (distance < ALARM && satellite.fuel >= 5.0 * KICK).then(|| {
        let length = distance.max(f64::MIN_POSITIVE);
        [KICK * dx / length, KICK * dy / length]
    })
}

/// The least distance of two bodies in the steps to come, and from where to where it is.
fn nearest(mut satellite: Body, mut debris: Body) -> (f64, f64, f64) {
    let mut least = (f64::MAX, 0.0, 0.0);
    for _ in 0..AHEAD {
        satellite = satellite.coasted(Gravity::Point);
        debris = debris.coasted(Gravity::Point);
        let (dx, dy) = (satellite.x - debris.x, satellite.y - debris.y);
        let distance = (dx * dx + dy * dy).sqrt();
        if distance < least.0 {
            least = (distance, dx, dy);
        }
    }
    least
}
