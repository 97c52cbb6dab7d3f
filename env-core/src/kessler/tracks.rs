//! *tracks* observations: single-precision columns of one size for neural policies. Each satellite sees itself and the
//! debris that threatens it most, in its own radial/in-track frame, so that nothing changes when everything is turned
//! about the Earth.
//!
//! Debris is foreseen by the episode's own dynamics, the satellite under hold. What threatens most is what comes nearest
//! within the look-ahead; ties by the distance now, then by age. Only visible debris counts. Relative velocities are
//! differences of velocities laid out along the satellite's radial and in-track directions of the moment.

use super::constants::{EARTH_RADIUS, FORMATION_SIDE, GM, HORIZON, SATELLITES, TARGET_RADIUS};
use super::flight::{Flight, Satellite};
use super::forecast::{Forecast, Nearest};
use super::kernel::{Body, distance_2};
use super::reward::Objective;
use super::spaces::MAX_DEBRIS;
use crate::chance::Chance;

/// Debris per satellite, unless somebody asks for another number.
pub const THREATS: usize = 8;
/// Steps foreseen, unless somebody asks for another number.
pub const LOOK_AHEAD: usize = 15;
/// Every cell is within plus and minus this: what is farther off is taken as that far.
pub const LIMIT: f32 = 2.0;

/// Middle and half-width of the radii where satellites live, LU.
const RADIUS: (f64, f64) = (60.0, 40.0);
/// A fast climb, LU/TU: about circular speed at 60 LU.
const SPEED: f64 = 4.0;
/// Differences of velocities in a formation, and of in-track from circular speed, LU/TU.
const DRIFT: f64 = 2.0;
/// How far satellite 0 may have to climb, LU.
const CLIMB: f64 = 50.0;
/// As far as debris comes from in the look-ahead, LU.
const FAR: f64 = 50.0;
/// Relative speeds of debris, LU/TU.
const CLOSING: f64 = 5.0;
/// Misses, LU.
const MISS: f64 = 10.0;

/// What one column holds: cell = (value − offset)/scale, within [−2, 2]; 0 where there is nothing to tell.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Its name.
    pub name: String,
    /// The value's unit; empty for a pure number.
    pub unit: &'static str,
    /// What is taken off the value, in its unit.
    pub offset: f64,
    /// What it is divided by then, in its unit.
    pub scale: f64,
    /// What it says.
    pub about: &'static str,
}

/// A number of debris or steps that cannot be had.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{field} is {value}, outside {min} to {max}")]
pub struct TracksError {
    /// `k` or `look_ahead`.
    pub field: &'static str,
    /// The value found.
    pub value: usize,
    /// Smallest allowed.
    pub min: usize,
    /// Largest allowed.
    pub max: usize,
}

/// Writes tracks of one episode after another, each step or now and then; what it carries along makes it faster and
/// changes no bit.
#[derive(Debug, Clone)]
pub struct Tracks {
    k: usize,
    look_ahead: usize,
    forecast: Forecast,
    nearest: Nearest,
    /// The most threatening so far, worst first.
    threats: Vec<Threat>,
}

#[derive(Debug, Clone, Copy)]
struct Threat {
    index: usize,
    miss_2: f64,
    now_2: f64,
}

impl Threat {
    fn before(&self, other: &Self) -> bool {
        let order = self.miss_2.total_cmp(&other.miss_2).then(self.now_2.total_cmp(&other.now_2));
        order.then(self.index.cmp(&other.index)).is_lt()
    }
}

impl Default for Tracks {
    fn default() -> Self {
        Self::sized(THREATS, LOOK_AHEAD)
    }
}

impl Tracks {
    /// Tracks of `k` pieces of debris per satellite (0 to 1000), foreseen for `look_ahead` steps (1 to 50).
    ///
    /// # Errors
    /// A number outside its bounds.
    pub fn new(k: usize, look_ahead: usize) -> Result<Self, TracksError> {
        let bounds = |field, value, min, max| {
            if (min..=max).contains(&value) { Ok(()) } else { Err(TracksError { field, value, min, max }) }
        };
        bounds("k", k, 0, MAX_DEBRIS as usize)?;
        bounds("look_ahead", look_ahead, 1, HORIZON as usize)?;
        Ok(Self::sized(k, look_ahead))
    }

    fn sized(k: usize, look_ahead: usize) -> Self {
        Self {
            k,
            look_ahead,
            forecast: Forecast::new(look_ahead),
            nearest: Nearest::default(),
            threats: Vec::with_capacity(k),
        }
    }

    /// Cells per satellite.
    #[must_use]
    pub const fn len(&self) -> usize {
        OWN.len() + self.k * THREAT.len()
    }

    /// Never: a satellite at least sees itself.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        false
    }

    /// Cells of all satellites together.
    #[must_use]
    pub const fn total(&self) -> usize {
        SATELLITES * self.len()
    }

    /// The columns of one satellite, in order.
    #[must_use]
    pub fn columns(&self) -> Vec<Column> {
        let column = |name: String, &(_, unit, offset, scale, about): &Spec| {
            // A time is told as a share of the look-ahead.
            let scale = if unit == "TU" && scale == 0.0 { self.look_ahead as f64 } else { scale };
            Column { name, unit, offset, scale, about }
        };
        let own = OWN.iter().map(|spec| column(spec.0.to_owned(), spec));
        let threats = (0..self.k).flat_map(|number| {
            THREAT.iter().map(move |spec| column(format!("debris_{number}_{}", spec.0), spec))
        });
        own.chain(threats).collect()
    }

    /// Bytes of what it carries along, beside itself.
    pub(super) fn bytes(&self) -> usize {
        let nearest = self.nearest.distance_2.capacity() + self.nearest.time.capacity();
        self.forecast.bytes() + nearest * size_of::<f64>() + self.threats.capacity() * size_of::<Threat>()
    }

    /// Writes one row per satellite, [`Tracks::len`] cells each, one after another. What does not fit into `out` is left
    /// out, what is left of it is zeroed. Allocates nothing once an episode of as much debris has been seen.
    pub fn write<C: Chance>(&mut self, flight: &Flight<C>, out: &mut [f32]) {
        out.fill(0.0);
        self.forecast.move_on(flight.debris(), flight.setup().physics);
        let rows = out.chunks_mut(self.len());
        for ((number, satellite), row) in flight.satellites().iter().enumerate().zip(rows) {
            if satellite.active() {
                let mut cells = Cells { frame: satellite.body.frame(), cells: row.iter_mut() };
                own(&mut cells, flight, number);
                self.write_threats(&mut cells, flight, &satellite.body);
            }
        }
    }

    fn write_threats<C: Chance>(&mut self, cells: &mut Cells<'_>, flight: &Flight<C>, satellite: &Body) {
        self.rank(flight, satellite);
        for threat in &self.threats {
            let debris = flight.debris().body(threat.index);
            cells.put(1.0, 0.0, 1.0);
            cells.vector(debris.x - satellite.x, debris.y - satellite.y, FAR);
            cells.vector(debris.vx - satellite.vx, debris.vy - satellite.vy, CLOSING);
            cells.put(threat.miss_2.sqrt(), 0.0, MISS);
            cells.put(self.nearest.time[threat.index], 0.0, self.look_ahead as f64);
        }
    }

    /// The K most threatening pieces, worst first.
    fn rank<C: Chance>(&mut self, flight: &Flight<C>, satellite: &Body) {
        self.threats.clear();
        if self.k == 0 {
            return;
        }
        self.forecast.nearest(*satellite, &mut self.nearest);
        let debris = flight.debris();
        for (index, &miss_2) in self.nearest.distance_2.iter().enumerate() {
            let full = self.threats.len() == self.k;
            if full && self.threats.last().is_some_and(|last| miss_2 > last.miss_2) {
                continue;
            }
            let Body { x, y, .. } = debris.body(index);
            let threat = Threat { index, miss_2, now_2: distance_2(satellite.x, satellite.y, x, y) };
            let place = self.threats.partition_point(|known| known.before(&threat));
            if place < self.k && flight.sees(x, y) {
                if full {
                    self.threats.pop();
                }
                self.threats.insert(place, threat);
            }
        }
    }
}

/// The cells of one satellite that are not yet written.
struct Cells<'a> {
    /// Its directions radial out and in-track.
    frame: ((f64, f64), (f64, f64)),
    cells: std::slice::IterMut<'a, f32>,
}

impl Cells<'_> {
    #[expect(clippy::cast_possible_truncation, reason = "observations are single precision")]
    fn put(&mut self, value: f64, offset: f64, scale: f64) {
        if let Some(cell) = self.cells.next() {
            // Adding zero leaves no minus zero behind.
            *cell = (((value - offset) / scale) as f32).clamp(-LIMIT, LIMIT) + 0.0;
        }
    }

    /// A vector by its radial and in-track components.
    fn vector(&mut self, x: f64, y: f64, scale: f64) {
        let ((rx, ry), (tx, ty)) = self.frame;
        self.put(x * rx + y * ry, 0.0, scale);
        self.put(x * tx + y * ty, 0.0, scale);
    }
}

/// Name, unit, offset, scale, what it says.
type Spec = (&'static str, &'static str, f64, f64, &'static str);

/// A satellite's own columns.
const OWN: [Spec; 16] = [
    ("active", "", 0.0, 1.0, "1 while it flies; a lost satellite's row is all zeros"),
    ("radius", "LU", RADIUS.0, RADIUS.1, "distance from the Earth's centre"),
    ("radial_speed", "LU/TU", 0.0, SPEED, "speed away from the Earth"),
    ("in_track_excess", "LU/TU", 0.0, DRIFT, "in-track speed over circular speed at this radius"),
    ("fuel", "", 0.0, 1.0, "share of the fuel it started with"),
    ("step", "", 0.0, 1.0, "share of the horizon that has passed"),
    ("survival", "", 0.0, 1.0, "probability that it still flies: 1, or less under risk: pc"),
    ("target_error", "LU", 0.0, CLIMB, "rendezvous, satellite 0: radius over the target radius of 100 LU"),
    ("other_0_radial", "LU", 0.0, FORMATION_SIDE, OTHER),
    ("other_0_in_track", "LU", 0.0, FORMATION_SIDE, OTHER),
    ("other_0_radial_speed", "LU/TU", 0.0, DRIFT, OTHER_SPEED),
    ("other_0_in_track_speed", "LU/TU", 0.0, DRIFT, OTHER_SPEED),
    ("other_1_radial", "LU", 0.0, FORMATION_SIDE, OTHER),
    ("other_1_in_track", "LU", 0.0, FORMATION_SIDE, OTHER),
    ("other_1_radial_speed", "LU/TU", 0.0, DRIFT, OTHER_SPEED),
    ("other_1_in_track_speed", "LU/TU", 0.0, DRIFT, OTHER_SPEED),
];
const OTHER: &str =
    "formation: where the next satellite is (of 0: 1, 2; of 1: 2, 0; of 2: 0, 1); 0 if it is lost";
const OTHER_SPEED: &str = "formation: its velocity as seen from here";

/// The columns of one piece of debris; a scale of 0 stands for the look-ahead.
const THREAT: [Spec; 7] = [
    ("present", "", 0.0, 1.0, "1 if there is such debris; else the seven are zeros"),
    ("radial", "LU", 0.0, FAR, "where it is, seen from the satellite"),
    ("in_track", "LU", 0.0, FAR, "where it is, seen from the satellite"),
    ("radial_speed", "LU/TU", 0.0, CLOSING, "its velocity as seen from the satellite"),
    ("in_track_speed", "LU/TU", 0.0, CLOSING, "its velocity as seen from the satellite"),
    ("miss", "LU", 0.0, MISS, "how near it comes within the look-ahead"),
    ("time", "TU", 0.0, 0.0, "when, from now"),
];

/// The first sixteen cells.
fn own<C: Chance>(cells: &mut Cells<'_>, flight: &Flight<C>, number: usize) {
    let Satellite { body, fuel, survival, .. } = flight.satellites()[number];
    let ((rx, ry), (tx, ty)) = cells.frame;
    let radius = body.radius();
    let objective = flight.objective();
    let circular = (GM / radius.max(EARTH_RADIUS)).sqrt();
    let seeks = objective == Objective::Rendezvous && number == 0;
    cells.put(1.0, 0.0, 1.0);
    cells.put(radius, RADIUS.0, RADIUS.1);
    cells.put(body.vx * rx + body.vy * ry, 0.0, SPEED);
    cells.put(body.vx * tx + body.vy * ty - circular, 0.0, DRIFT);
    cells.put(fuel, 0.0, flight.setup().fuel);
    cells.put(f64::from(flight.steps()), 0.0, f64::from(HORIZON));
    cells.put(survival, 0.0, 1.0);
    cells.put(if seeks { radius - TARGET_RADIUS } else { 0.0 }, 0.0, CLIMB);
    for turn in 1..SATELLITES {
        let other = &flight.satellites()[(number + turn) % SATELLITES];
        let told = objective == Objective::Formation && other.active();
        let other = if told { other.body } else { body };
        cells.vector(other.x - body.x, other.y - body.y, FORMATION_SIDE);
        cells.vector(other.vx - body.vx, other.vy - body.vy, DRIFT);
    }
}
