//! *tracks* observations: single-precision columns of one size for neural policies. Each satellite sees itself and the
//! debris that threatens it most, in its own radial/in-track frame, so that nothing changes when everything is turned
//! about the Earth.
//!
//! Debris is foreseen by the episode's own dynamics, in single precision, the satellite under hold. What threatens most is what comes nearest
//! within the look-ahead; ties by age. Only visible debris counts. Relative velocities are
//! differences of velocities laid out along the satellite's radial and in-track directions of the moment.

use pulp::{Arch, Simd, WithSimd};

use super::constants::{EARTH_RADIUS, FORMATION_SIDE, GM, HORIZON, SATELLITES, TARGET_RADIUS};
use super::flight::{Flight, Satellite};
use super::forecast::{Nearest, nearest};
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
/// Up to so many threats are found by one pass without branches, over vectors of one size or of twice that.
const FEW: usize = 8;
const SOME: usize = 16;
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

/// Writes tracks of one episode after another, each step or now and then; what it carries along is room, and changes no bit.
#[derive(Debug, Clone)]
pub struct Tracks {
    k: usize,
    look_ahead: usize,
    nearest: [Nearest; SATELLITES],
    /// The most threatening of each satellite, worst first: [`key`]s.
    worst: [Vec<u64>; SATELLITES],
    arch: Arch,
}

/// A piece of debris by how near it comes, then by age: misses squared are positive, and the bits of such numbers are in their
/// order.
const fn key(miss_2: f32, index: usize) -> u64 {
    (miss_2.to_bits() as u64) << 32 | index as u64
}

/// Which piece it is.
#[expect(clippy::cast_possible_truncation, reason = "the lower half is the index")]
const fn index(key: u64) -> usize {
    key as u32 as usize
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
        Self { k, look_ahead, nearest: Default::default(), arch: Arch::new(), worst: Default::default() }
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
        let nearest = self.nearest.iter().map(|found| found.distance_2.capacity() + found.time.capacity());
        let worst: usize = self.worst.iter().map(Vec::capacity).sum();
        nearest.sum::<usize>() * size_of::<f32>() + worst * size_of::<u64>()
    }

    /// Writes one row per satellite, [`Tracks::len`] cells each, one after another. What does not fit into `out` is left
    /// out, what is left of it is zeroed. Allocates nothing once an episode of as much debris has been seen.
    pub fn write<C: Chance>(&mut self, flight: &Flight<C>, out: &mut [f32]) {
        out.fill(0.0);
        if self.k > 0 {
            self.look(flight);
        }
        let rows = out.chunks_mut(self.len());
        for ((number, satellite), row) in flight.satellites().iter().enumerate().zip(rows) {
            if satellite.active() {
                let mut cells = Cells { frame: satellite.body.frame(), cells: row.iter_mut() };
                own(&mut cells, flight, number);
                self.write_threats(&mut cells, flight, number);
            }
        }
    }

    fn write_threats<C: Chance>(&self, cells: &mut Cells<'_>, flight: &Flight<C>, number: usize) {
        let satellite = flight.satellites()[number].body;
        for index in self.worst[number].iter().map(|key| index(*key)) {
            let debris = flight.debris().body(index);
            let (miss_2, time) = (self.nearest[number].distance_2[index], self.nearest[number].time[index]);
            cells.put(1.0, 0.0, 1.0);
            cells.vector(debris.x - satellite.x, debris.y - satellite.y, FAR);
            cells.vector(debris.vx - satellite.vx, debris.vy - satellite.vy, CLOSING);
            cells.put(f64::from(miss_2.sqrt()), 0.0, MISS);
            cells.put(f64::from(time), 0.0, self.look_ahead as f64);
        }
    }

    /// Looks ahead, and for the K worst of each satellite.
    fn look<C: Chance>(&mut self, flight: &Flight<C>) {
        let flying =
            flight.satellites().each_ref().map(|satellite| satellite.active().then_some(satellite.body));
        let debris = flight.debris();
        let physics = flight.setup().physics;
        nearest(self.arch, (debris, physics), (flying, self.look_ahead), &mut self.nearest);
        if flight.setup().radar_range.is_some() {
            let hidden = debris.bodies().enumerate().filter(|(_, body)| !flight.sees(body.x, body.y));
            for (index, _) in hidden {
                self.nearest.iter_mut().for_each(|found| found.distance_2[index] = f32::INFINITY);
            }
        }
        let of = self.nearest.each_ref().map(|found| &found.distance_2[..debris.len()]);
        let (k, worst) = (self.k, &mut self.worst);
        if k <= FEW {
            self.arch.dispatch(Least::<FEW> { of, k, worst });
        } else if k <= SOME {
            self.arch.dispatch(Least::<SOME> { of, k, worst });
        } else {
            of.into_iter().zip(worst).for_each(|(of, worst)| sort(of, k, worst));
        }
    }
}

/// Keys of what is there and seen.
fn keep(worst: &mut Vec<u64>, keys: impl Iterator<Item = u64>) {
    worst.clear();
    worst.extend(keys.filter(|known| *known < key(f32::INFINITY, 0)));
}

/// The `k` worst, by putting all in order.
fn sort(of: &[f32], k: usize, worst: &mut Vec<u64>) {
    keep(worst, of.iter().enumerate().map(|(index, miss_2)| key(*miss_2, index)));
    if worst.len() > k {
        worst.select_nth_unstable(k);
        worst.truncate(k);
    }
    worst.sort_unstable();
}

/// The `k` worst of each satellite, at most `ROOM`.
///
/// The worst so far are held in order; one more goes to its place and moves on those after it. No branch: which of fifty pieces
/// are among the eight worst nobody can foresee. All satellites at once, since each piece waits for the one before it.
struct Least<'a, const ROOM: usize> {
    of: [&'a [f32]; SATELLITES],
    k: usize,
    worst: &'a mut [Vec<u64>; SATELLITES],
}

impl<const ROOM: usize> WithSimd for Least<'_, ROOM> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let mut least = [[u64::MAX; ROOM]; SATELLITES];
        let [a, b, c] = self.of;
        for (index, ((a, b), c)) in a.iter().zip(b).zip(c).enumerate() {
            put(&mut least[0], key(*a, index));
            put(&mut least[1], key(*b, index));
            put(&mut least[2], key(*c, index));
        }
        for (least, worst) in least.iter().zip(self.worst) {
            keep(worst, least[..self.k].iter().copied());
        }
    }
}

/// Puts one more among the least in order.
#[inline(always)]
fn put<const ROOM: usize>(least: &mut [u64; ROOM], key: u64) {
    let mut before = [0; ROOM];
    before[1..].copy_from_slice(&least[..ROOM - 1]);
    for place in 0..ROOM {
        least[place] = least[place].min(key.max(before[place]));
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
    #[inline(always)]
    fn put(&mut self, value: f64, offset: f64, scale: f64) {
        if let Some(cell) = self.cells.next() {
            // By the reciprocal, which most often is known when this is compiled; adding zero leaves no minus zero behind.
            *cell = (((value - offset) * (1.0 / scale)) as f32).clamp(-LIMIT, LIMIT) + 0.0;
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
