//! Scripted agents with one known weakness each: what a designer must find from the failure profile alone. Three are the
//! causal pilot of kessler with something taken away; one burns for whatever comes near.

use std::any::Any;

use env_core::kessler::bearing::Frame;
use env_core::kessler::constants::{CONTACT_DISTANCE, FUEL_PER_SPEED};
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
        Weakness::Late => Box::new(Late { before: None }),
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

/// Sees what was a step ago, and looks three steps ahead: dodges what will hit within them, by the gentlest burn that clears
/// it from where things were.
struct Late {
    before: Option<Telemetry>,
}

/// Steps the late one looks ahead, and the burns it tries, LU/TU in 16 directions.
const SIGHT: u32 = 3;
const BURNS: [f64; 5] = [0.1, 0.2, 0.4, 0.7, 1.0];
/// How far it wants to pass, LU: contact is at 2.
const PASS: f64 = 2.2;

impl Policy for Late {
    fn act(&mut self, observation: &dyn Any, log: &mut ActionLog) {
        let now = observation.downcast_ref::<Telemetry>();
        if let (Some(seen), Some(_)) = (&self.before, now) {
            for satellite in seen.satellites.iter().filter(|s| s.active()) {
                if let Some(burn) = dodge(satellite, seen) {
                    log.act(satellite.id, &burn);
                }
            }
        }
        log.end_step();
        self.before = now.cloned();
    }
}

/// The gentlest burn that clears everything within sight, if something there would hit.
fn dodge(satellite: &SatelliteTelemetry, seen: &Telemetry) -> Option<[f64; 2]> {
    let least = |burn: [f64; 2]| {
        let mut body = satellite.body();
        body.vx += burn[0];
        body.vy += burn[1];
        seen.radar_debris.iter().map(|debris| nearest(body, debris.body(), SIGHT).0).fold(f64::MAX, f64::min)
    };
    if least([0.0, 0.0]) >= CONTACT_DISTANCE {
        return None;
    }
    let burns = BURNS.into_iter().filter(|size| satellite.fuel >= FUEL_PER_SPEED * size).flat_map(|size| {
        (0..16).map(move |turn| {
            let (sin, cos) = libm::sincos(std::f64::consts::TAU * f64::from(turn) / 16.0);
            [size * cos, size * sin]
        })
    });
    burns.map(|burn| (least(burn), burn)).find(|(passes, _)| *passes >= PASS).map(|(_, burn)| burn)
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
    let nearest = seen.radar_debris.iter().map(|debris| nearest(satellite.body(), debris.body(), AHEAD));
    let (distance, dx, dy) = nearest.min_by(|a, b| a.0.total_cmp(&b.0))?;
    // One that cannot be paid would be refused.
    (distance < ALARM && satellite.fuel >= FUEL_PER_SPEED * KICK).then(|| {
        let length = distance.max(f64::MIN_POSITIVE);
        [KICK * dx / length, KICK * dy / length]
    })
}

/// The least distance of two bodies in some steps to come, and from where to where it is.
fn nearest(mut satellite: Body, mut debris: Body, ahead: u32) -> (f64, f64, f64) {
    let mut least = (f64::MAX, 0.0, 0.0);
    for _ in 0..ahead {
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
