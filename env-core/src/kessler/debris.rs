//! Debris, in blocks: one pass over them moves all, and tells whether anything rare has happened. It has no branches per
//! body, so that it vectorises. Which vector width the machine offers is found once ([`pulp::Arch`]); every width does the
//! same operations on each body in the same order, so the bits are the same.

use pulp::Arch;

use super::cloud::{Block, Cloud, NOWHERE};
use super::constants::{CONTACT_2, EARTH_RADIUS_2, SATELLITES};
use super::kernel::{Body, Gravity, distance_2, swept_2};
use super::pass::{self, Found, Narrow};

/// All debris, in order of arrival.
#[derive(Debug, Clone)]
pub struct Debris {
    cloud: Cloud,
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
            cloud: Cloud::default(),
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

    /// Bytes of its tables.
    pub(super) fn bytes(&self) -> usize {
        self.cloud.bytes() + self.id.capacity() * size_of::<u32>() + self.approaching.capacity()
    }

    /// Bodies there is room for.
    pub(super) fn capacity(&self) -> usize {
        self.cloud.capacity()
    }

    /// Debris at an index below `len`.
    #[must_use]
    pub fn body(&self, i: usize) -> Body {
        self.cloud.body(i)
    }

    /// All, in order.
    pub(super) fn bodies(&self) -> impl Iterator<Item = Body> {
        self.cloud.bodies()
    }

    /// Its id: stable over the episode.
    #[must_use]
    pub fn id(&self, i: usize) -> u32 {
        self.id[i]
    }

    /// All, block by block, padded with nobody.
    pub(super) fn blocks(&self) -> &[Block] {
        self.cloud.blocks()
    }

    /// Where the bodies of a start are put; [`Debris::begin`] comes after.
    pub(super) fn cloud(&mut self) -> &mut Cloud {
        &mut self.cloud
    }

    /// Begins with the bodies that were put in [`Debris::cloud`] and no others, with room for `most`.
    pub(super) fn begin(&mut self, most: usize) {
        self.approaching.clear();
        self.approaching.reserve(most);
        self.approaching.resize(self.cloud.len(), 0);
        self.next_id = self.cloud.len() as u32;
        self.id.clear();
        self.id.reserve(most);
        self.id.extend(0..self.next_id);
        self.may_be_inside = pass::inside(self.arch, self.cloud.blocks());
    }

    pub(super) fn push(&mut self, body: Body) -> u32 {
        self.cloud.push(body);
        self.approaching.push(0);
        self.id.push(self.next_id);
        self.next_id += 1;
        self.may_be_inside |= body.radius_2() < EARTH_RADIUS_2;
        self.next_id - 1
    }

    pub(super) fn remove(&mut self, i: usize) {
        self.cloud.remove(i);
        self.approaching.remove(i);
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
    #[inline]
    pub(super) fn advance(&mut self, gravity: Gravity, swept: bool, satellites: &[Body; SATELLITES]) -> bool {
        let Found { inside, touched } =
            pass::advance(self.arch, gravity, swept, self.cloud.blocks_mut(), satellites);
        self.may_be_inside = inside;
        touched
    }

    /// Writes what is seen of the first bodies where nothing hides them, as [`Narrow`] has it.
    #[inline]
    pub(super) fn narrow(&self, out: &mut [f32], bodies: usize) {
        let there = self.len().min(bodies);
        self.arch.dispatch(Narrow { blocks: self.cloud.blocks(), out, bodies, there });
    }

    /// The public original leaves debris that is inside the Earth where it is, for ever.
    pub(super) fn advance_frozen(&mut self) {
        for i in 0..self.len() {
            let body = self.body(i);
            if body.radius_2() >= EARTH_RADIUS_2 {
                self.cloud.set(i, body.coasted(Gravity::Point));
            }
        }
    }

    /// The first debris in order that touches a satellite at the end of a step, or (swept, and among the first `moved`
    /// that were there when the step began) within it.
    pub(super) fn touching(&self, satellite: &Body, swept: bool, moved: usize) -> Option<usize> {
        self.bodies().enumerate().position(|(i, d)| {
            let d2 = if swept && i < moved {
                let (dx, dy) = (satellite.x - d.x, satellite.y - d.y);
                swept_2(dx, dy, satellite.vx - d.vx, satellite.vy - d.vy)
            } else {
                distance_2(satellite.x, satellite.y, d.x, d.y)
            };
            d2 < CONTACT_2
        })
    }
}

/// A satellite that is not there.
pub(super) const ABSENT: Body = Body { x: -NOWHERE, y: -NOWHERE, vx: 0.0, vy: 0.0 };
