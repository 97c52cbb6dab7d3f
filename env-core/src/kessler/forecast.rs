//! Where debris will be, carried from step to step: debris keeps its course whatever satellites do, so one step later
//! the forecast needs one row more, not all of them again. What it says does not depend on whether it was carried: a
//! row that is kept is bit for bit the row that would be computed again.

use std::collections::VecDeque;

use pulp::{Arch, Simd, WithSimd};

use super::cloud::ABSENT;
use super::constants::EARTH_RADIUS_2;
use super::debris::Debris;
use super::kernel::{Body, Gravity, coast, swept_2};
use super::setup::Physics;
use super::warnings::time_back;

/// Debris at one time, as columns.
#[derive(Debug, Clone, Default)]
struct Row {
    x: Vec<f64>,
    y: Vec<f64>,
    vx: Vec<f64>,
    vy: Vec<f64>,
}

impl Row {
    fn columns(&mut self) -> [&mut Vec<f64>; 4] {
        [&mut self.x, &mut self.y, &mut self.vx, &mut self.vy]
    }

    /// Whether this is exactly where debris is now.
    fn is(&self, debris: &Debris) -> bool {
        if self.x.len() != debris.len() {
            return false;
        }
        // Bits, not numbers: what is carried must be what would be computed.
        let differ = |a: f64, b: f64| a.to_bits() ^ b.to_bits();
        let all = debris.bodies().enumerate().fold(0, |all, (i, d)| {
            let place = differ(self.x[i], d.x) | differ(self.y[i], d.y);
            all | place | differ(self.vx[i], d.vx) | differ(self.vy[i], d.vy)
        });
        all == 0
    }

    fn take(&mut self, debris: &Debris) {
        let of = [|b: Body| b.x, |b: Body| b.y, |b: Body| b.vx, |b: Body| b.vy];
        for (mine, of) in self.columns().into_iter().zip(of) {
            mine.clear();
            // As much room as the episode has, so that arrivals need none.
            mine.reserve(debris.capacity());
            mine.extend(debris.bodies().map(of));
        }
    }

    /// One step after `before`.
    fn follow(&mut self, before: &Self, physics: Physics, arch: Arch) {
        let n = before.x.len();
        for (mine, theirs) in self.columns().into_iter().zip([&before.x, &before.y, &before.vx, &before.vy]) {
            mine.clear();
            mine.reserve(theirs.capacity());
            mine.resize(n, 0.0);
        }
        let before = [&before.x[..], &before.y, &before.vx, &before.vy];
        let (x, y, vx, vy) = (&mut self.x[..], &mut self.y[..], &mut self.vx[..], &mut self.vy[..]);
        let upstream = physics.upstream;
        match physics.gravity {
            Gravity::Point => arch.dispatch(Coast::<false> { x, y, vx, vy, before, upstream }),
            Gravity::J2 => arch.dispatch(Coast::<true> { x, y, vx, vy, before, upstream }),
        }
    }
}

/// One step of everything, without a branch per body, so that it vectorises. A type of its own, since a closure is not
/// compiled for the vectors that [`Arch`] finds.
struct Coast<'a, const OBLATE: bool> {
    x: &'a mut [f64],
    y: &'a mut [f64],
    vx: &'a mut [f64],
    vy: &'a mut [f64],
    before: [&'a [f64]; 4],
    upstream: bool,
}

impl<const OBLATE: bool> WithSimd for Coast<'_, OBLATE> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let n = self.x.len();
        let (x, y) = (self.x, &mut self.y[..n]);
        let (vx, vy) = (&mut self.vx[..n], &mut self.vy[..n]);
        let [bx, by, bvx, bvy] = self.before.map(|column| &column[..n]);
        for i in 0..n {
            let mut body = Body { x: bx[i], y: by[i], vx: bvx[i], vy: bvy[i] };
            let inside = body.radius_2() < EARTH_RADIUS_2;
            coast::<OBLATE>(&mut body.x, &mut body.y, &mut body.vx, &mut body.vy);
            // As `debris_moved` has it: gone, or frozen.
            let (gone_x, gone_y) = if self.upstream { (bx[i], by[i]) } else { (ABSENT.x, ABSENT.y) };
            x[i] = if inside { gone_x } else { body.x };
            y[i] = if inside { gone_y } else { body.y };
            vx[i] = if inside { 0.0 } else { body.vx };
            vy[i] = if inside { 0.0 } else { body.vy };
        }
    }
}

/// How near each piece of debris comes to one satellite, by index.
#[derive(Debug, Clone, Default)]
pub(super) struct Nearest {
    /// Least distance squared within the look-ahead, LU².
    pub distance_2: Vec<f64>,
    /// When, TU from now.
    pub time: Vec<f64>,
}

/// The forecast.
#[derive(Debug, Clone)]
pub(super) struct Forecast {
    look_ahead: usize,
    physics: Physics,
    /// Now, then after each step ahead. Empty before the first use.
    rows: VecDeque<Row>,
    arch: Arch,
}

impl Forecast {
    pub(super) fn new(look_ahead: usize) -> Self {
        Self { look_ahead, physics: Physics::PLAIN, rows: VecDeque::new(), arch: Arch::new() }
    }

    /// Bytes of what is foreseen.
    pub(super) fn bytes(&self) -> usize {
        let row = |row: &Row| {
            let cells = row.x.capacity() + row.y.capacity() + row.vx.capacity() + row.vy.capacity();
            size_of::<Row>() + cells * size_of::<f64>()
        };
        self.rows.iter().map(row).sum()
    }

    /// Takes what is there now.
    pub(super) fn move_on(&mut self, debris: &Debris, physics: Physics) {
        let known = physics == self.physics && self.rows.len() > self.look_ahead;
        if known && self.rows[0].is(debris) {
            return;
        }
        if known && self.rows[1].is(debris) {
            self.rows.rotate_left(1);
            self.extend(self.look_ahead);
            return;
        }
        self.physics = physics;
        self.rows.resize_with(self.look_ahead + 1, Row::default);
        self.rows[0].take(debris);
        for step in 1..=self.look_ahead {
            self.extend(step);
        }
    }

    fn extend(&mut self, step: usize) {
        let mut row = std::mem::take(&mut self.rows[step]);
        row.follow(&self.rows[step - 1], self.physics, self.arch);
        self.rows[step] = row;
    }

    /// How near everything comes to a satellite that holds from here.
    pub(super) fn nearest(&self, satellite: Body, found: &mut Nearest) {
        let Some(now) = self.rows.front() else { return };
        let n = now.x.len();
        found.distance_2.clear();
        found.distance_2.reserve(now.x.capacity());
        found.distance_2.extend((0..n).map(|i| {
            let (dx, dy) = (satellite.x - now.x[i], satellite.y - now.y[i]);
            dx * dx + dy * dy
        }));
        found.time.clear();
        found.time.reserve(now.x.capacity());
        found.time.resize(n, 0.0);
        let mut body = satellite;
        for (row, step) in self.rows.range(1..).zip(1u32..) {
            if body.radius_2() < EARTH_RADIUS_2 {
                break;
            }
            body = body.coasted(self.physics.gravity);
            self.arch.dispatch(Approaches {
                distance_2: &mut found.distance_2,
                time: &mut found.time,
                debris: [&row.x, &row.y, &row.vx, &row.vy],
                satellite: body,
                end: f64::from(step),
            });
        }
    }
}

/// One step's closest approaches to a satellite, as [`Coast`] is made.
struct Approaches<'a> {
    distance_2: &'a mut [f64],
    time: &'a mut [f64],
    debris: [&'a [f64]; 4],
    /// At the end of the step.
    satellite: Body,
    /// When that is, TU from now.
    end: f64,
}

impl WithSimd for Approaches<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let n = self.distance_2.len();
        let (distance_2, time) = (self.distance_2, &mut self.time[..n]);
        let [x, y, vx, vy] = self.debris.map(|column| &column[..n]);
        let s = self.satellite;
        for i in 0..n {
            let (dx, dy) = (s.x - x[i], s.y - y[i]);
            let (wx, wy) = (s.vx - vx[i], s.vy - vy[i]);
            let near = swept_2(dx, dy, wx, wy);
            let at = self.end - time_back(dx, dy, wx, wy);
            let nearer = near < distance_2[i];
            distance_2[i] = if nearer { near } else { distance_2[i] };
            time[i] = if nearer { at } else { time[i] };
        }
    }
}
