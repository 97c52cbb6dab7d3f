//! One encounter as one body: solved where it happens, run backwards to where it starts, and flown forwards again to see
//! that it does what it claims.

use env_core::critique::BEARING_STEPS;
use env_core::kessler::bearing::Frame;
use env_core::kessler::constants::{CONTACT_DISTANCE, EARTH_RADIUS, HORIZON, SATELLITES};
use env_core::kessler::kernel::{Body, Gravity};
use env_core::kessler::plant::START_RADII;

use super::hold::Hold;
use super::language::{Encounter, Kind, MISS, SPEED};

/// Steps before its encounter in which a rogue appears.
pub(super) const ROGUE_LEAD: u32 = 6;
/// How far a solved bearing may be from the one asked for, degrees.
pub(super) const BEARING_TOLERANCE: f64 = 0.5;
/// How much nearer than it claims a decoy may come: rounding on the trip back and forth.
const SLACK: f64 = 1e-6;

/// What pulls, and what counts as touching.
#[derive(Debug, Clone, Copy)]
pub(super) struct Laws {
    pub gravity: Gravity,
    /// Contact counts within steps too.
    pub swept: bool,
}

/// A body that was placed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placed {
    /// The step before whose motion it appears; none if it is there from the start.
    pub arrives: Option<u32>,
    /// Where it starts or appears.
    pub body: Body,
    /// Its bearing as it came out, degrees.
    pub bearing_deg: f64,
    /// The least distance to its satellite at the end of a step of hold, LU.
    pub least_distance: f64,
}

/// Why an encounter cannot be, worst reasons last: of two ways that fail the one that came further is told.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Trouble {
    /// The satellite itself falls into the Earth before.
    Fallen,
    /// No direction gives this bearing.
    Bearing { nearest: f64 },
    /// Its way back leads through the Earth.
    Earth { step: u32 },
    /// It would start too near or too far.
    Start { radius: f64 },
    /// It meets somebody before its time.
    Early { satellite: usize, step: u32 },
    /// It comes nearer than it should, at some other time.
    Near { satellite: usize, step: u32, distance: f64 },
}

impl Trouble {
    const fn rank(self) -> u32 {
        match self {
            Self::Fallen => 0,
            Self::Bearing { .. } => 1,
            Self::Earth { .. } => 2,
            Self::Start { .. } => 3,
            Self::Early { .. } => 4,
            Self::Near { .. } => 5,
        }
    }
}

/// The body of an encounter.
pub(super) fn place(encounter: &Encounter, frame: Frame, hold: &Hold, laws: Laws) -> Result<Placed, Trouble> {
    let satellite = encounter.satellite as usize;
    if hold.at(satellite, encounter.step).radius() < EARTH_RADIUS {
        return Err(Trouble::Fallen);
    }
    // It may pass on either side.
    let mut worst = None;
    for side in [1.0, -1.0] {
        let solving = Solving { encounter, frame, hold, laws, side };
        match solving.solve().and_then(|solved| solving.check(solved)) {
            Ok(placed) => return Ok(placed),
            Err(trouble) => worst = Some(further(worst, trouble)),
        }
    }
    Err(worst.unwrap_or(Trouble::Fallen))
}

fn further(one: Option<Trouble>, other: Trouble) -> Trouble {
    one.filter(|one| one.rank() >= other.rank()).unwrap_or(other)
}

struct Solving<'a> {
    encounter: &'a Encounter,
    frame: Frame,
    hold: &'a Hold,
    laws: Laws,
    /// Which side of the satellite it passes on: 1 or −1.
    side: f64,
}

/// Where the relative velocity points, and the bearing that comes of it.
#[derive(Clone, Copy)]
struct Solved {
    heading_deg: f64,
    bearing_deg: f64,
}

impl Solving<'_> {
    fn satellite(&self) -> usize {
        self.encounter.satellite as usize
    }

    /// The step after which it starts, or appears.
    fn from(&self) -> u32 {
        if self.encounter.rogue { self.encounter.step.saturating_sub(ROGUE_LEAD) } else { 0 }
    }

    /// How many steps before the encounter its bearing is taken at the earliest: what appears in a step is there after it.
    fn backs(&self) -> u32 {
        let there = self.from() + u32::from(self.encounter.rogue);
        BEARING_STEPS.min(self.encounter.step - there)
    }

    /// The body at the end of the encounter's step, moving relative to the satellite along this heading, degrees from +X
    /// towards +Y: closest there, since it is put across its relative velocity.
    fn meeting(&self, heading_deg: f64) -> Body {
        let of = self.hold.at(self.satellite(), self.encounter.step);
        let (sin, cos) = libm::sincos(heading_deg.to_radians());
        let speed = SPEED.value(self.encounter.relative_speed);
        let off = self.side * MISS.value(self.encounter.miss_distance);
        Body { x: of.x - off * sin, y: of.y + off * cos, vx: of.vx + speed * cos, vy: of.vy + speed * sin }
    }

    /// The bearing that a heading comes to: some steps before, or when the body is first visible if that is later.
    fn bearing(&self, heading_deg: f64) -> f64 {
        let step = self.encounter.step;
        let mut body = self.meeting(heading_deg);
        let mut at = (0, body);
        for back in 0..=self.backs() {
            if back > 0 {
                body = body.uncoasted(self.laws.gravity);
            }
            if self.hold.sees(step - back, &body) {
                at = (back, body);
            }
        }
        let (back, body) = at;
        self.frame.bearing_deg(self.hold.at(self.satellite(), step - back), (body.x, body.y))
    }

    /// The heading whose bearing is the one asked for. A body that comes from somewhere moves away from there, so that
    /// turning the heading turns the bearing with it, nearly one to one: correcting by the difference converges.
    fn solve(&self) -> Result<Solved, Trouble> {
        let wanted = f64::from(self.encounter.bearing_deg);
        let of = self.hold.at(self.satellite(), self.encounter.step - self.backs());
        let first = self.frame.direction_deg(of, wanted) + 180.0;
        let mut best = Solved { heading_deg: first, bearing_deg: self.bearing(first) };
        // From where it should come, and where that leads nowhere from all around.
        for start in (0..16).map(|turn| first + 22.5 * f64::from(turn)) {
            let mut heading_deg = start;
            for _ in 0..12 {
                let bearing_deg = self.bearing(heading_deg);
                let off = difference(wanted, bearing_deg);
                if off.abs() < difference(wanted, best.bearing_deg).abs() {
                    best = Solved { heading_deg, bearing_deg };
                }
                if off.abs() < 0.01 * BEARING_TOLERANCE {
                    return Ok(best);
                }
                heading_deg += off;
            }
            if difference(wanted, best.bearing_deg).abs() <= BEARING_TOLERANCE {
                return Ok(best);
            }
        }
        Err(Trouble::Bearing { nearest: best.bearing_deg })
    }

    /// Runs it back to where it starts, and looks whether it does what it claims.
    fn check(&self, solved: Solved) -> Result<Placed, Trouble> {
        let step = self.encounter.step;
        let from = self.from();
        let mut body = self.meeting(solved.heading_deg);
        for at in (from..step).rev() {
            body = body.uncoasted(self.laws.gravity);
            if body.radius() < EARTH_RADIUS {
                return Err(Trouble::Earth { step: at });
            }
        }
        let radius = body.radius();
        if radius < START_RADII.0 || radius > START_RADII.1 {
            return Err(Trouble::Start { radius });
        }
        let least_distance = self.fly(body, from)?;
        Ok(Placed {
            arrives: self.encounter.rogue.then_some(from + 1),
            body,
            bearing_deg: solved.bearing_deg,
            least_distance,
        })
    }

    /// Flies it past satellites that hold: a threat touches its own at its step and nobody before, others touch nobody
    /// and keep their distance from their own.
    fn fly(&self, mut body: Body, from: u32) -> Result<f64, Trouble> {
        let own = self.satellite();
        let claimed = MISS.value(self.encounter.miss_distance);
        let mut least = f64::MAX;
        // What is there from the start counts where it starts; what appears, first where it has moved to.
        for step in from + u32::from(self.encounter.rogue)..=HORIZON {
            if body.radius() < EARTH_RADIUS {
                break;
            }
            if step > from {
                body = body.coasted(self.laws.gravity);
            }
            for satellite in 0..SATELLITES {
                let distance = self.distance(satellite, step, &body);
                if satellite == own {
                    least = least.min(distance);
                }
                let touches = distance < CONTACT_DISTANCE;
                match self.encounter.kind {
                    Kind::Threat if satellite == own && step == self.encounter.step && touches => {
                        return Ok(least);
                    }
                    Kind::Threat if touches => return Err(Trouble::Early { satellite, step }),
                    Kind::Threat => {}
                    Kind::Decoy | Kind::Screen => {
                        let bound = if satellite == own { claimed - SLACK } else { CONTACT_DISTANCE };
                        if distance < bound {
                            return Err(Trouble::Near { satellite, step, distance });
                        }
                    }
                }
            }
            if self.encounter.kind == Kind::Threat && step == self.encounter.step {
                return Err(Trouble::Near { satellite: own, step, distance: least });
            }
        }
        Ok(least)
    }

    /// How near it is to a satellite at the end of a step, or came within it where that counts.
    fn distance(&self, satellite: usize, step: u32, body: &Body) -> f64 {
        let of = self.hold.at(satellite, step);
        let (dx, dy) = (of.x - body.x, of.y - body.y);
        let back = if self.laws.swept && step > self.from() {
            let (wx, wy) = (of.vx - body.vx, of.vy - body.vy);
            let moving = (wx * wx + wy * wy).max(f64::MIN_POSITIVE);
            let back = ((dx * wx + dy * wy) / moving).clamp(0.0, 1.0);
            (dx - wx * back, dy - wy * back)
        } else {
            (dx, dy)
        };
        (back.0 * back.0 + back.1 * back.1).sqrt()
    }
}

/// From one bearing to another, the short way, degrees in (−180, 180].
pub(super) fn difference(wanted: f64, found: f64) -> f64 {
    let turn = (wanted - found) % 360.0;
    if turn > 180.0 {
        turn - 360.0
    } else if turn <= -180.0 {
        turn + 360.0
    } else {
        turn
    }
}
