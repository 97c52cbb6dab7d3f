//! Debris of an episode, stored in blocks. One pass over the blocks moves all bodies and reports if
//! anything rare happened. The pass has no branch per body, so it vectorises. The vector width of
//! the machine is detected once ([`pulp::Arch`]). Every width applies the same operations to each
//! body in the same order, so the bits are the same.

use pulp::Arch;

use super::body_blocks::{ABSENT_COORDINATE, BodyBlock, BodyBlocks};
use super::column_writer::ColumnWriter;
use super::constants::{CONTACT_2, EARTH_RADIUS_2, SATELLITES};
use super::kernel::{Body, Gravity, distance_squared, min_distance_squared};
use super::propagate::{self, StepFlags};

/// All debris of an episode, in order of arrival.
#[derive(Debug, Clone)]
pub struct Debris {
    blocks: BodyBlocks,
    /// Per body: bit i is set if it approached satellite i at the end of the last step.
    pub(super) approaching: Vec<u8>,
    id: Vec<u32>,
    next_id: u32,
    /// True if some body may be inside the Earth; it must be removed before the next motion.
    pub(super) may_be_inside_earth: bool,
    arch: Arch,
}

impl Debris {
    /// Creates an empty list.
    pub(super) fn new() -> Self {
        Self {
            blocks: BodyBlocks::default(),
            approaching: Vec::new(),
            id: Vec::new(),
            next_id: 0,
            may_be_inside_earth: false,
            arch: Arch::new(),
        }
    }

    /// Number of debris bodies.
    #[must_use]
    pub fn len(&self) -> usize {
        self.id.len()
    }

    /// Returns true if there is no debris.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.id.is_empty()
    }

    /// Memory of the tables, bytes.
    pub(super) fn bytes(&self) -> usize {
        self.blocks.bytes() + self.id.capacity() * size_of::<u32>() + self.approaching.capacity()
    }

    /// Number of bodies that fit without an allocation.
    pub(super) fn capacity(&self) -> usize {
        self.blocks.capacity()
    }

    /// Returns the body at an index below `len`.
    #[must_use]
    pub fn body(&self, i: usize) -> Body {
        self.blocks.body(i)
    }

    /// Iterates over all bodies in order.
    pub(super) fn bodies(&self) -> impl Iterator<Item = Body> {
        self.blocks.bodies()
    }

    /// Id of the body at an index below `len`. Ids are stable over the episode.
    #[must_use]
    pub fn id(&self, i: usize) -> u32 {
        self.id[i]
    }

    /// All blocks, padded with absent bodies.
    pub(super) fn blocks(&self) -> &[BodyBlock] {
        self.blocks.blocks()
    }

    /// Storage for the initial bodies. The caller fills it and then calls [`Debris::reset`].
    pub(super) fn initial_bodies_mut(&mut self) -> &mut BodyBlocks {
        &mut self.blocks
    }

    /// Starts an episode with exactly the bodies in [`Debris::initial_bodies_mut`] and reserves memory for
    /// `capacity`.
    pub(super) fn reset(&mut self, capacity: usize) {
        self.approaching.clear();
        self.approaching.reserve(capacity);
        self.approaching.resize(self.blocks.len(), 0);
        self.next_id = self.blocks.len() as u32;
        self.id.clear();
        self.id.reserve(capacity);
        self.id.extend(0..self.next_id);
        self.may_be_inside_earth = propagate::any_inside_earth(self.arch, self.blocks.blocks());
    }

    /// Appends a body and returns its id.
    pub(super) fn push(&mut self, body: Body) -> u32 {
        self.blocks.push(body);
        self.approaching.push(0);
        self.id.push(self.next_id);
        self.next_id += 1;
        self.may_be_inside_earth |= body.radius_squared() < EARTH_RADIUS_2;
        self.next_id - 1
    }

    /// Removes the body at an index below `len`.
    pub(super) fn remove(&mut self, i: usize) {
        self.blocks.remove(i);
        self.approaching.remove(i);
        self.id.remove(i);
    }

    /// Records which satellites each body is approaching at the start.
    pub(super) fn record_approaching(&mut self, satellites: &[Body; SATELLITES]) {
        for i in 0..self.len() {
            let d = self.body(i);
            self.approaching[i] = (0u8..).zip(satellites).fold(0, |bits, (number, s)| {
                let closing = (s.x - d.x) * (s.vx - d.vx) + (s.y - d.y) * (s.vy - d.vy) < 0.0;
                bits | u8::from(closing) << number
            });
        }
    }

    /// Advances all bodies by one step. Returns true if some body may touch one of these satellites
    /// where the step ends or, if `swept`, within it.
    #[inline]
    pub(super) fn advance(&mut self, gravity: Gravity, swept: bool, satellites: &[Body; SATELLITES]) -> bool {
        let StepFlags { inside_earth, contact } =
            propagate::advance(self.arch, gravity, swept, self.blocks.blocks_mut(), satellites);
        self.may_be_inside_earth = inside_earth;
        contact
    }

    /// Writes the columns of the first `slots` bodies in the layout of [`ColumnWriter`], as if all were
    /// visible.
    #[inline]
    pub(super) fn write_columns(&self, out: &mut [f32], slots: usize) {
        let count = self.len().min(slots);
        self.arch.dispatch(ColumnWriter { blocks: self.blocks.blocks(), out, slots, count });
    }

    /// Advances by the rule of the public kessler-env: debris inside the Earth stays where it is.
    pub(super) fn advance_upstream(&mut self) {
        for i in 0..self.len() {
            let body = self.body(i);
            if body.radius_squared() >= EARTH_RADIUS_2 {
                self.blocks.set(i, body.coast(Gravity::Point));
            }
        }
    }

    /// Index of the first body that touches a satellite at the end of the step. With `swept`, the first
    /// `moved` bodies, those that existed when the step began, also count if they touch it within the step.
    pub(super) fn first_contact(&self, satellite: &Body, swept: bool, moved: usize) -> Option<usize> {
        self.bodies().enumerate().position(|(i, d)| {
            let d2 = if swept && i < moved {
                let (dx, dy) = (satellite.x - d.x, satellite.y - d.y);
                min_distance_squared(dx, dy, satellite.vx - d.vx, satellite.vy - d.vy)
            } else {
                distance_squared(satellite.x, satellite.y, d.x, d.y)
            };
            d2 < CONTACT_2
        })
    }
}

/// Position of a lost satellite: far from all bodies, and from absent bodies.
pub(super) const ABSENT_SATELLITE: Body =
    Body { x: -ABSENT_COORDINATE, y: -ABSENT_COORDINATE, vx: 0.0, vy: 0.0 };
