//! Places the body of one encounter: solves its state at the encounter, runs it back to its start, and forward again to
//! check that it does what the encounter says.

use env_core::critique::BEARING_STEPS;
use env_core::kessler::bearing::BearingFrame;
use env_core::kessler::constants::{CONTACT_DISTANCE, EARTH_RADIUS, HORIZON, SATELLITES};
use env_core::kessler::kernel::Body;
use env_core::kessler::threat_placement::THREAT_START_RADII;

use super::coast::CoastPaths;
use super::design::Encounter;
use super::vocabulary::{EncounterKind, MISS, SPEED};
use crate::angles::{angle_between, turn_between};

/// Maximum difference of a solved bearing from the requested one, in degrees.
pub(super) const BEARING_TOLERANCE: f64 = 0.5;
/// Number of steps from the appearance of a rogue to its encounter.
const ROGUE_LEAD: u32 = 6;
const _: () = assert!(ROGUE_LEAD > BEARING_STEPS, "a rogue exists when its bearing is measured");
/// Tolerance for the miss distance of a decoy, in LU: rounding on the way back and forth.
const MISS_TOLERANCE: f64 = 1e-6;
/// Number of headings at which the search for a bearing starts.
const SOLVER_STARTS: u32 = 16;
/// Number of corrections of a heading from each start.
const SOLVER_ITERATIONS: u32 = 12;

/// Body that was placed for an encounter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlacedBody {
    /// Step before whose motion the body appears; `None` if it exists from the start.
    pub arrives: Option<u32>,
    /// State at the start or at its appearance.
    pub body: Body,
    /// Bearing that was reached, in degrees.
    pub bearing_deg: f64,
    /// Least distance to its satellite at the end of a step if all satellites hold, in LU.
    pub least_distance: f64,
}

/// Reason why no body can be placed for an encounter. Variants are ordered by how far the attempt came.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum PlacementError {
    /// The satellite falls into the Earth before the encounter.
    SatelliteFallen,
    /// No heading has the requested bearing; `nearest` is the nearest one in degrees.
    NoSuchBearing { nearest: f64 },
    /// The path before the encounter leads through the Earth.
    ThroughEarth { step: u32 },
    /// The body would start outside the allowed radii; `radius` is in LU.
    StartOutOfRange { radius: f64 },
    /// A threat hits a satellite before its encounter.
    TooEarly { satellite: usize, step: u32 },
    /// The body comes nearer to a satellite than it may; `distance` is in LU.
    TooNear { satellite: usize, step: u32, distance: f64 },
}

impl PlacementError {
    const fn progress(self) -> u32 {
        match self {
            Self::SatelliteFallen => 0,
            Self::NoSuchBearing { .. } => 1,
            Self::ThroughEarth { .. } => 2,
            Self::StartOutOfRange { .. } => 3,
            Self::TooEarly { .. } => 4,
            Self::TooNear { .. } => 5,
        }
    }

    /// Returns the error of the attempt that came further.
    fn further(self, other: Self) -> Self {
        if self.progress() >= other.progress() { self } else { other }
    }
}

/// Returns true if an encounter is valid and its body can be placed.
pub(super) fn can_place(encounter: &Encounter, frame: BearingFrame, coast: &CoastPaths) -> bool {
    encounter.validate("").is_ok() && place(encounter, frame, coast).is_ok()
}

/// Places the body of an encounter whose bearing is measured in `frame`.
///
/// # Errors
/// Returns the error of the attempt that came further, of passing on the left and on the right side.
pub(super) fn place(
    encounter: &Encounter,
    frame: BearingFrame,
    coast: &CoastPaths,
) -> Result<PlacedBody, PlacementError> {
    let satellite = encounter.satellite as usize;
    if coast.satellite(satellite, encounter.step).radius() < EARTH_RADIUS {
        return Err(PlacementError::SatelliteFallen);
    }
    let mut failure: Option<PlacementError> = None;
    for side in [1.0, -1.0] {
        let solver = Solver { encounter, frame, coast, side };
        match solver.solve().and_then(|solution| solver.verify(solution)) {
            Ok(placed) => return Ok(placed),
            Err(error) => failure = Some(failure.map_or(error, |held| held.further(error))),
        }
    }
    Err(failure.unwrap_or(PlacementError::SatelliteFallen))
}

/// Search for the body of an encounter.
struct Solver<'a> {
    encounter: &'a Encounter,
    frame: BearingFrame,
    coast: &'a CoastPaths,
    /// Side on which the body passes the satellite: 1 or −1.
    side: f64,
}

/// Direction of the relative velocity, and the bearing that it leads to; both in degrees.
#[derive(Clone, Copy)]
struct Solution {
    heading_deg: f64,
    bearing_deg: f64,
}

impl Solver<'_> {
    fn satellite(&self) -> usize {
        self.encounter.satellite as usize
    }

    /// Step after which the body starts or appears.
    fn first_step(&self) -> u32 {
        if self.encounter.is_rogue { self.encounter.step.saturating_sub(ROGUE_LEAD) } else { 0 }
    }

    /// Number of steps before the encounter at which the bearing is measured, at most. A rogue exists only after the step in
    /// which it appears.
    fn bearing_steps(&self) -> u32 {
        let exists_from = self.first_step() + u32::from(self.encounter.is_rogue);
        BEARING_STEPS.min(self.encounter.step - exists_from)
    }

    /// Returns the body at the end of the encounter's step. It moves relative to the satellite in the direction of the heading
    /// (degrees from +X towards +Y). It is offset across its relative velocity, so that it is closest there.
    fn body_at_encounter(&self, heading_deg: f64) -> Body {
        let satellite = self.coast.satellite(self.satellite(), self.encounter.step);
        let (sin, cos) = libm::sincos(heading_deg.to_radians());
        let speed = SPEED.value(self.encounter.relative_speed);
        let offset = self.side * MISS.value(self.encounter.miss_distance);
        Body {
            x: satellite.x - offset * sin,
            y: satellite.y + offset * cos,
            vx: satellite.vx + speed * cos,
            vy: satellite.vy + speed * sin,
        }
    }

    /// Returns the bearing of a heading: some steps before the encounter, or when the body becomes visible if that is later.
    fn bearing(&self, heading_deg: f64) -> f64 {
        let step = self.encounter.step;
        let mut body = self.body_at_encounter(heading_deg);
        let mut earliest = (0, body);
        for back in 0..=self.bearing_steps() {
            if back > 0 {
                body = body.coast_back(self.coast.gravity());
            }
            if self.coast.is_visible(step - back, &body) {
                earliest = (back, body);
            }
        }
        let (back, body) = earliest;
        let satellite = self.coast.satellite(self.satellite(), step - back);
        self.frame.bearing_deg(satellite, [body.x, body.y])
    }

    /// Finds the heading with the requested bearing. Turning the heading turns the bearing nearly one to one, so that adding
    /// the difference to the heading converges.
    fn solve(&self) -> Result<Solution, PlacementError> {
        let wanted = f64::from(self.encounter.bearing_deg);
        let satellite = self.coast.satellite(self.satellite(), self.encounter.step - self.bearing_steps());
        let first = self.frame.direction_deg(satellite, wanted) + 180.0;
        let mut best = Solution { heading_deg: first, bearing_deg: self.bearing(first) };
        // The direct heading first; others all around if that does not converge.
        for start in (0..SOLVER_STARTS).map(|turn| first + 22.5 * f64::from(turn)) {
            let mut heading_deg = start;
            for _ in 0..SOLVER_ITERATIONS {
                let bearing_deg = self.bearing(heading_deg);
                let error = turn_between(bearing_deg, wanted);
                if error.abs() < angle_between(wanted, best.bearing_deg) {
                    best = Solution { heading_deg, bearing_deg };
                }
                if error.abs() < 0.01 * BEARING_TOLERANCE {
                    return Ok(best);
                }
                heading_deg += error;
            }
            if angle_between(wanted, best.bearing_deg) <= BEARING_TOLERANCE {
                return Ok(best);
            }
        }
        Err(PlacementError::NoSuchBearing { nearest: best.bearing_deg })
    }

    /// Runs the body back to its start and checks its whole path.
    fn verify(&self, solution: Solution) -> Result<PlacedBody, PlacementError> {
        let first_step = self.first_step();
        let mut body = self.body_at_encounter(solution.heading_deg);
        for step in (first_step..self.encounter.step).rev() {
            body = body.coast_back(self.coast.gravity());
            if body.radius() < EARTH_RADIUS {
                return Err(PlacementError::ThroughEarth { step });
            }
        }
        let radius = body.radius();
        if radius < THREAT_START_RADII.0 || radius > THREAT_START_RADII.1 {
            return Err(PlacementError::StartOutOfRange { radius });
        }
        let least_distance = self.verify_path(body, first_step)?;
        Ok(PlacedBody {
            arrives: self.encounter.is_rogue.then_some(first_step + 1),
            body,
            bearing_deg: solution.bearing_deg,
            least_distance,
        })
    }

    /// Runs the body past the coasting satellites. A threat hits its satellite at its step and no satellite before. A decoy or
    /// screen hits none, and keeps the miss distance to its own. Returns the least distance to its satellite.
    fn verify_path(&self, mut body: Body, first_step: u32) -> Result<f64, PlacementError> {
        let own = self.satellite();
        let miss_distance = MISS.value(self.encounter.miss_distance);
        let is_threat = self.encounter.kind == EncounterKind::Threat;
        let mut least = f64::MAX;
        // The start of a body counts; a rogue counts only after its first motion.
        for step in first_step + u32::from(self.encounter.is_rogue)..=HORIZON {
            if body.radius() < EARTH_RADIUS {
                break;
            }
            if step > first_step {
                body = body.coast(self.coast.gravity());
            }
            for satellite in 0..SATELLITES {
                let distance = self.distance(satellite, step, &body);
                if satellite == own {
                    least = least.min(distance);
                }
                if is_threat {
                    let is_contact = distance < CONTACT_DISTANCE;
                    if is_contact && satellite == own && step == self.encounter.step {
                        return Ok(least);
                    }
                    if is_contact {
                        return Err(PlacementError::TooEarly { satellite, step });
                    }
                } else {
                    let min =
                        if satellite == own { miss_distance - MISS_TOLERANCE } else { CONTACT_DISTANCE };
                    if distance < min {
                        return Err(PlacementError::TooNear { satellite, step, distance });
                    }
                }
            }
            if is_threat && step == self.encounter.step {
                return Err(PlacementError::TooNear { satellite: own, step, distance: least });
            }
        }
        Ok(least)
    }

    /// Returns the distance to a satellite at the end of a step, or the least distance within the step if such contacts count.
    fn distance(&self, satellite: usize, step: u32, body: &Body) -> f64 {
        let satellite = self.coast.satellite(satellite, step);
        let (dx, dy) = (satellite.x - body.x, satellite.y - body.y);
        let nearest = if self.coast.is_swept() && step > self.first_step() {
            let (wx, wy) = (satellite.vx - body.vx, satellite.vy - body.vy);
            let speed_squared = (wx * wx + wy * wy).max(f64::MIN_POSITIVE);
            let back = ((dx * wx + dy * wy) / speed_squared).clamp(0.0, 1.0);
            (dx - wx * back, dy - wy * back)
        } else {
            (dx, dy)
        };
        (nearest.0 * nearest.0 + nearest.1 * nearest.1).sqrt()
    }
}
