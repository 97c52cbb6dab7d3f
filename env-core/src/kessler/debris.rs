//! Debris as columns: free flight without branches, contact search.

use super::constants::{CONTACT_2, EARTH_RADIUS_2};
use super::kernel::{Body, coast, distance_2};

/// Debris as columns, in order of arrival.
#[derive(Debug, Clone, Default)]
pub struct Debris {
    pub(crate) x: Vec<f64>,
    pub(crate) y: Vec<f64>,
    pub(crate) vx: Vec<f64>,
    pub(crate) vy: Vec<f64>,
    pub(crate) id: Vec<u32>,
    next_id: u32,
    /// Something may be inside the Earth: look before moving.
    pub(super) may_be_inside: bool,
}

impl Debris {
    /// None yet, with room for so many.
    pub(super) fn with_room(room: usize) -> Self {
        let column = || Vec::with_capacity(room);
        let (x, y, vx, vy) = (column(), column(), column(), column());
        Self { x, y, vx, vy, id: Vec::with_capacity(room), next_id: 0, may_be_inside: false }
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.x.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
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
        self.id.clear();
        self.next_id = 0;
        self.may_be_inside = false;
    }

    pub(super) fn push(&mut self, body: Body) -> u32 {
        self.x.push(body.x);
        self.y.push(body.y);
        self.vx.push(body.vx);
        self.vy.push(body.vy);
        self.id.push(self.next_id);
        self.next_id += 1;
        self.may_be_inside |= body.radius_2() < EARTH_RADIUS_2;
        self.next_id - 1
    }

    pub(super) fn remove(&mut self, i: usize) {
        for column in [&mut self.x, &mut self.y, &mut self.vx, &mut self.vy] {
            column.remove(i);
        }
        self.id.remove(i);
    }

    /// Free flight of all; without branches but for the rare body inside the Earth.
    pub(super) fn coast(&mut self) {
        let n = self.x.len();
        let (x, y) = (&mut self.x[..n], &mut self.y[..n]);
        let (vx, vy) = (&mut self.vx[..n], &mut self.vy[..n]);
        let mut inside = 0u64;
        for i in 0..n {
            coast(&mut x[i], &mut y[i], &mut vx[i], &mut vy[i]);
            inside |= u64::from(x[i] * x[i] + y[i] * y[i] < EARTH_RADIUS_2);
        }
        self.may_be_inside = inside != 0;
    }

    /// The public original leaves debris that is inside the Earth where it is, for ever.
    pub(super) fn coast_frozen(&mut self) {
        for i in 0..self.x.len() {
            if self.x[i] * self.x[i] + self.y[i] * self.y[i] >= EARTH_RADIUS_2 {
                coast(&mut self.x[i], &mut self.y[i], &mut self.vx[i], &mut self.vy[i]);
            }
        }
    }

    /// The first debris in order that touches this place.
    pub(crate) fn touching(&self, px: f64, py: f64) -> Option<usize> {
        let n = self.x.len();
        let (x, y) = (&self.x[..n], &self.y[..n]);
        let mut any = 0u64;
        for i in 0..n {
            any |= u64::from(distance_2(px, py, x[i], y[i]) < CONTACT_2);
        }
        if any == 0 {
            return None;
        }
        (0..n).find(|&i| distance_2(px, py, x[i], y[i]) < CONTACT_2)
    }
}
