//! Debris as columns: one pass over them moves all, and tells whether anything rare has happened. It has no branches per
//! body, so that it vectorises; the columns are padded with bodies that are far from everything, so that it has no
//! remainder. Which vector width the machine offers is found once ([`pulp::Arch`]); every width does the same
//! operations on each body in the same order, so the bits are the same.

use pulp::Arch;

use super::constants::{CONTACT_2, EARTH_RADIUS_2, SATELLITES};
use super::kernel::{Body, Gravity, coast, distance_2, swept_2};
use super::pass::{self, Columns, Found, Narrow};

/// Columns are whole multiples of this: the widest vectors of today hold eight f64.
const LANES: usize = pass::BLOCK;
/// Where bodies are put that are not there: far from everything, and still a number.
const NOWHERE: f64 = 1e12;

/// Debris as columns, in order of arrival.
#[derive(Debug, Clone)]
pub struct Debris {
    pub(crate) x: Vec<f64>,
    pub(crate) y: Vec<f64>,
    pub(crate) vx: Vec<f64>,
    pub(crate) vy: Vec<f64>,
    /// Bit i: it was approaching satellite i at the end of the last step.
    pub(super) approaching: Vec<u8>,
    id: Vec<u32>,
    next_id: u32,
    /// Something may be inside the Earth: look before moving.
    pub(super) may_be_inside: bool,
    arch: Arch,
}

impl Debris {
    /// None yet.
    pub(super) fn new() -> Self {
        Self {
            x: Vec::new(),
            y: Vec::new(),
            vx: Vec::new(),
            vy: Vec::new(),
            approaching: Vec::new(),
            id: Vec::new(),
            next_id: 0,
            may_be_inside: false,
            arch: Arch::new(),
        }
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.id.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.id.is_empty()
    }

    /// Bytes of its columns.
    pub(super) fn bytes(&self) -> usize {
        let wide = self.x.capacity() + self.y.capacity() + self.vx.capacity() + self.vy.capacity();
        wide * size_of::<f64>() + self.id.capacity() * size_of::<u32>() + self.approaching.capacity()
    }

    /// Debris at an index below `len`.
    #[must_use]
    pub fn body(&self, i: usize) -> Body {
        Body { x: self.x[i], y: self.y[i], vx: self.vx[i], vy: self.vy[i] }
    }

    /// Its id: stable over the episode.
    #[must_use]
    pub fn id(&self, i: usize) -> u32 {
        self.id[i]
    }

    pub(super) fn clear(&mut self) {
        for column in [&mut self.x, &mut self.y, &mut self.vx, &mut self.vy] {
            column.clear();
        }
        self.approaching.clear();
        self.id.clear();
        self.next_id = 0;
        self.may_be_inside = false;
    }

    /// These and no others, in order, with room for `most`.
    pub(super) fn load(&mut self, bodies: &[Body], most: usize) {
        self.clear();
        let room = most.next_multiple_of(LANES);
        for column in [&mut self.x, &mut self.y, &mut self.vx, &mut self.vy] {
            column.reserve(room);
        }
        self.approaching.reserve(room);
        self.id.reserve(room);
        let padded = bodies.len().next_multiple_of(LANES);
        let of = [|b: &Body| b.x, |b: &Body| b.y, |b: &Body| b.vx, |b: &Body| b.vy];
        let columns = [&mut self.x, &mut self.y, &mut self.vx, &mut self.vy];
        for ((column, of), absent) in columns.into_iter().zip(of).zip([NOWHERE, NOWHERE, 0.0, 0.0]) {
            column.extend(bodies.iter().map(of));
            column.resize(padded, absent);
        }
        self.approaching.resize(padded, 0);
        self.next_id = bodies.len() as u32;
        self.id.extend(0..self.next_id);
        self.may_be_inside = bodies.iter().any(|body| body.radius_2() < EARTH_RADIUS_2);
    }

    pub(super) fn push(&mut self, body: Body) -> u32 {
        let i = self.id.len();
        if i == self.x.len() {
            let padded = i + LANES;
            for (column, absent) in
                [(&mut self.x, NOWHERE), (&mut self.y, NOWHERE), (&mut self.vx, 0.0), (&mut self.vy, 0.0)]
            {
                column.resize(padded, absent);
            }
            self.approaching.resize(padded, 0);
        }
        self.set(i, body);
        self.approaching[i] = 0;
        self.id.push(self.next_id);
        self.next_id += 1;
        self.may_be_inside |= body.radius_2() < EARTH_RADIUS_2;
        self.next_id - 1
    }

    fn set(&mut self, i: usize, body: Body) {
        self.x[i] = body.x;
        self.y[i] = body.y;
        self.vx[i] = body.vx;
        self.vy[i] = body.vy;
    }

    pub(super) fn remove(&mut self, i: usize) {
        for (column, absent) in
            [(&mut self.x, NOWHERE), (&mut self.y, NOWHERE), (&mut self.vx, 0.0), (&mut self.vy, 0.0)]
        {
            column.remove(i);
            column.push(absent);
        }
        self.approaching.remove(i);
        self.approaching.push(0);
        self.id.remove(i);
    }

    /// Notes which satellites each piece is approaching at the start.
    pub(super) fn look_at(&mut self, satellites: &[Body; SATELLITES]) {
        for i in 0..self.len() {
            let d = self.body(i);
            self.approaching[i] = (0u8..).zip(satellites).fold(0, |bits, (number, s)| {
                let closing = (s.x - d.x) * (s.vx - d.vx) + (s.y - d.y) * (s.vy - d.vy) < 0.0;
                bits | u8::from(closing) << number
            });
        }
    }

    /// Free flight of all. True if, where the step ends or (swept) within it, one of these satellites may be touched.
    pub(super) fn advance(&mut self, gravity: Gravity, swept: bool, satellites: &[Body; SATELLITES]) -> bool {
        let columns = Columns { x: &mut self.x, y: &mut self.y, vx: &mut self.vx, vy: &mut self.vy };
        let Found { inside, touched } = pass::advance(self.arch, gravity, swept, columns, satellites);
        self.may_be_inside = inside;
        touched
    }

    /// Writes positions and velocities of the first bodies as f32, one column of `bodies` values after the other; zeros
    /// where there is none.
    pub(super) fn narrow(&self, out: &mut [f32], bodies: usize) {
        let there = self.len().min(bodies);
        let columns = [&self.x[..], &self.y, &self.vx, &self.vy];
        self.arch.dispatch(Narrow { columns, out, bodies, there });
    }

    /// The public original leaves debris that is inside the Earth where it is, for ever.
    pub(super) fn advance_frozen(&mut self) {
        for i in 0..self.len() {
            if self.x[i] * self.x[i] + self.y[i] * self.y[i] >= EARTH_RADIUS_2 {
                coast::<false>(&mut self.x[i], &mut self.y[i], &mut self.vx[i], &mut self.vy[i]);
            }
        }
    }

    /// The first debris in order that touches a satellite at the end of a step, or (swept, and among the first `moved`
    /// that were there when the step began) within it.
    pub(super) fn touching(&self, satellite: &Body, swept: bool, moved: usize) -> Option<usize> {
        (0..self.len()).find(|&i| {
            let d2 = if swept && i < moved {
                let (dx, dy) = (satellite.x - self.x[i], satellite.y - self.y[i]);
                swept_2(dx, dy, satellite.vx - self.vx[i], satellite.vy - self.vy[i])
            } else {
                distance_2(satellite.x, satellite.y, self.x[i], self.y[i])
            };
            d2 < CONTACT_2
        })
    }
}

/// A satellite that is not there.
pub(super) const ABSENT: Body = Body { x: -NOWHERE, y: -NOWHERE, vx: 0.0, vy: 0.0 };
