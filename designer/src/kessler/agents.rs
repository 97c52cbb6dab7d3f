//! Scripted agents with one known weakness each, which a designer must find from the failure profile alone. Two restrict the
//! view of kessler's heuristic policy, one acts on old observations, and one burns against everything that comes near.

use std::any::Any;

use env_core::kessler::bearing::BearingFrame;
use env_core::kessler::constants::{CONTACT_DISTANCE, FUEL_PER_SPEED};
use env_core::kessler::kernel::{Body, Gravity};
use env_core::kessler::telemetry::{KesslerTelemetry, SatelliteTelemetry};
use env_core::policy::{Policy, PolicyError};
use env_core::{ActionLog, Scenario};

use crate::angles::angle_between;

/// Weakness of a scripted agent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Weakness {
    /// Does not see debris within 45° of +Y from a satellite.
    BlindTowardsY,
    /// Burns whenever debris will come within 8 LU, also if it will miss.
    Nervous,
    /// Acts on the observation of the previous step.
    Late,
    /// Does not see debris within 60° of the direction behind a satellite.
    NeverLooksBehind,
}

impl Weakness {
    /// All weaknesses, in display order.
    pub const ALL: [Self; 4] = [Self::BlindTowardsY, Self::Nervous, Self::Late, Self::NeverLooksBehind];

    /// Returns the name of the weakness for display.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::BlindTowardsY => "blind towards +Y",
            Self::Nervous => "nervous",
            Self::Late => "late",
            Self::NeverLooksBehind => "never looks behind",
        }
    }
}

/// Creates the agent with a weakness, for a scenario of kessler.
///
/// # Errors
/// Returns [`PolicyError`] if the scenario belongs to another world.
pub fn agent(weakness: Weakness, scenario: &Scenario) -> Result<Box<dyn Policy>, PolicyError> {
    let blinkered = |frame, centre_deg, half_width_deg| -> Result<Box<dyn Policy>, PolicyError> {
        let policy = scenario.task().policy("heuristic", scenario, 0)?;
        Ok(Box::new(BlinkeredAgent { policy, frame, centre_deg, half_width_deg }))
    };
    match weakness {
        Weakness::BlindTowardsY => blinkered(BearingFrame::Inertial, 90.0, 45.0),
        Weakness::NeverLooksBehind => blinkered(BearingFrame::RadialInTrack, 270.0, 60.0),
        Weakness::Late => Ok(Box::new(LateAgent { previous: None })),
        Weakness::Nervous => Ok(Box::new(NervousAgent)),
    }
}

/// Heuristic policy that does not see some bearings from the satellite that it burns for.
struct BlinkeredAgent {
    policy: Box<dyn Policy>,
    frame: BearingFrame,
    centre_deg: f64,
    half_width_deg: f64,
}

impl Policy for BlinkeredAgent {
    fn act(&mut self, observation: &dyn Any, log: &mut ActionLog) -> Result<(), PolicyError> {
        let Some(telemetry) = observation.downcast_ref::<KesslerTelemetry>() else {
            log.end_step();
            return Ok(());
        };
        // The blind sector differs between satellites: the policy acts once for each, and only that satellite's burn is kept.
        let mut burns: Vec<(u32, [f64; 2])> = Vec::new();
        for satellite in telemetry.satellites.iter().filter(|s| s.is_active()) {
            let mut restricted = telemetry.clone();
            restricted.radar_debris.retain(|debris| {
                let bearing = self.frame.bearing_deg(&satellite.body(), [debris.x, debris.y]);
                angle_between(self.centre_deg, bearing) > self.half_width_deg
            });
            let mut own_log = ActionLog::new(2, log.precision());
            self.policy.act(&restricted, &mut own_log)?;
            let step = own_log.step(0);
            for (&agent, values) in step.agents.iter().zip(step.values.chunks_exact(2)) {
                if agent == satellite.id {
                    burns.push((agent, [values[0], values[1]]));
                }
            }
        }
        for (agent, burn) in burns {
            log.push_entry(agent, &burn);
        }
        log.end_step();
        Ok(())
    }
}

/// Agent that acts on the observation of the previous step and looks three steps ahead. It avoids hits by the smallest burn
/// that would have been enough.
struct LateAgent {
    previous: Option<KesslerTelemetry>,
}

/// Steps that the late agent looks ahead.
const LATE_HORIZON: u32 = 3;
/// Sizes of the burns that the late agent tries, in LU/TU.
const LATE_BURNS: [f64; 5] = [0.1, 0.2, 0.4, 0.7, 1.0];
/// Number of directions in which the late agent tries each burn.
const LATE_DIRECTIONS: u32 = 16;
/// Distance that a burn of the late agent must reach, in LU; contact is at 2.
const LATE_CLEARANCE: f64 = 2.2;

impl Policy for LateAgent {
    fn act(&mut self, observation: &dyn Any, log: &mut ActionLog) -> Result<(), PolicyError> {
        let current = observation.downcast_ref::<KesslerTelemetry>();
        if let (Some(previous), Some(_)) = (&self.previous, current) {
            for satellite in previous.satellites.iter().filter(|s| s.is_active()) {
                if let Some(burn) = smallest_evasion(satellite, previous) {
                    log.push_entry(satellite.id, &burn);
                }
            }
        }
        log.end_step();
        self.previous = current.cloned();
        Ok(())
    }
}

/// Returns the smallest burn that avoids all debris within the horizon; `None` if nothing would hit or no burn is enough.
fn smallest_evasion(satellite: &SatelliteTelemetry, telemetry: &KesslerTelemetry) -> Option<[f64; 2]> {
    let least_distance = |burn: [f64; 2]| {
        let mut body = satellite.body();
        body.vx += burn[0];
        body.vy += burn[1];
        let debris = telemetry.radar_debris.iter();
        debris.map(|debris| nearest_pass(body, debris.body(), LATE_HORIZON).distance).fold(f64::MAX, f64::min)
    };
    if least_distance([0.0, 0.0]) >= CONTACT_DISTANCE {
        return None;
    }
    let affordable = LATE_BURNS.into_iter().filter(|size| satellite.fuel >= FUEL_PER_SPEED * size);
    let mut burns = affordable.flat_map(|size| {
        (0..LATE_DIRECTIONS).map(move |turn| {
            let (sin, cos) =
                libm::sincos(std::f64::consts::TAU * f64::from(turn) / f64::from(LATE_DIRECTIONS));
            [size * cos, size * sin]
        })
    });
    burns.find(|burn| least_distance(*burn) >= LATE_CLEARANCE)
}

/// Steps that the nervous agent looks ahead.
const NERVOUS_HORIZON: u32 = 6;
/// Distance that alarms the nervous agent, in LU.
const NERVOUS_ALARM: f64 = 8.0;
/// Size of a burn of the nervous agent, in LU/TU.
const NERVOUS_BURN: f64 = 0.25;

/// Agent that burns away from everything that will come near.
struct NervousAgent;

impl Policy for NervousAgent {
    fn act(&mut self, observation: &dyn Any, log: &mut ActionLog) -> Result<(), PolicyError> {
        if let Some(telemetry) = observation.downcast_ref::<KesslerTelemetry>() {
            for satellite in telemetry.satellites.iter().filter(|s| s.is_active()) {
                if let Some(burn) = nervous_burn(satellite, telemetry) {
                    log.push_entry(satellite.id, &burn);
                }
            }
        }
        log.end_step();
        Ok(())
    }
}

/// Returns a burn away from the debris that will come nearest, if it comes within the alarm distance and the fuel suffices.
fn nervous_burn(satellite: &SatelliteTelemetry, telemetry: &KesslerTelemetry) -> Option<[f64; 2]> {
    let passes = telemetry
        .radar_debris
        .iter()
        .map(|debris| nearest_pass(satellite.body(), debris.body(), NERVOUS_HORIZON));
    let nearest = passes.min_by(|a, b| a.distance.total_cmp(&b.distance))?;
    // The world rejects a burn without enough fuel.
    (nearest.distance < NERVOUS_ALARM && satellite.fuel >= FUEL_PER_SPEED * NERVOUS_BURN).then(|| {
        let length = nearest.distance.max(f64::MIN_POSITIVE);
        [NERVOUS_BURN * nearest.dx / length, NERVOUS_BURN * nearest.dy / length]
    })
}

/// Nearest pass of two bodies: their distance in LU, and the vector from the debris to the satellite.
struct NearestPass {
    distance: f64,
    dx: f64,
    dy: f64,
}

/// Returns the nearest pass of two coasting bodies at the end of the next `steps` steps.
fn nearest_pass(mut satellite: Body, mut debris: Body, steps: u32) -> NearestPass {
    let mut nearest = NearestPass { distance: f64::MAX, dx: 0.0, dy: 0.0 };
    for _ in 0..steps {
        satellite = satellite.coast(Gravity::Point);
        debris = debris.coast(Gravity::Point);
        let (dx, dy) = (satellite.x - debris.x, satellite.y - debris.y);
        let distance = (dx * dx + dy * dy).sqrt();
        if distance < nearest.distance {
            nearest = NearestPass { distance, dx, dy };
        }
    }
    nearest
}
