//! Debris does not depend on what satellites do (fragments aside), so it is propagated once and satellites are flown
//! against the table, one by one.

mod passing;

use crate::kessler::cloud::{ABSENT, NOWHERE};
use crate::kessler::constants::{CONTACT_2, CONTACT_DISTANCE, EARTH_RADIUS_2, HORIZON, SIGMAS, SURVIVED};
use crate::kessler::kernel::{
    Body, Gravity, clamped_burn, coast, collision_probability, distance_2, passing_2, swept_2,
};
use crate::kessler::setup::{Contact, Physics, Setup, Start};

/// Points of a trajectory: the start, and after each step.
pub(crate) const POINTS: usize = HORIZON as usize + 1;

/// A burn of one satellite: before the motion of `step` (counted from 1), by (dvx, dvy) LU/TU.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Burn {
    pub step: u32,
    pub dvx: f64,
    pub dvy: f64,
}

/// Where all debris is after every step.
pub(crate) struct Table {
    n: usize,
    rows: usize,
    x: Vec<f64>,
    y: Vec<f64>,
    /// Velocities, where contact asks for them.
    vx: Vec<f64>,
    vy: Vec<f64>,
    pub(super) physics: Physics,
}

impl Table {
    /// All debris of an episode, rogues to come included.
    pub(crate) fn of(setup: &Setup, start: &Start) -> Self {
        Self::propagate(&start.debris, &start.rogues, HORIZON, setup.physics)
    }

    /// `debris` from now on, and `rogues` from the step they arrive in, for `steps` steps.
    pub(crate) fn propagate(debris: &[Body], rogues: &[(u32, Body)], steps: u32, physics: Physics) -> Self {
        let n = debris.len() + rogues.len();
        let room = || Vec::with_capacity(n * (steps as usize + 1));
        let moving = || if physics.contact == Contact::EndOfStep { Vec::new() } else { room() };
        let mut table =
            Self { n, rows: steps as usize + 1, x: room(), y: room(), vx: moving(), vy: moving(), physics };
        let mut now = Columns::with_room(n);
        debris.iter().for_each(|body| now.push(*body));
        rogues.iter().for_each(|_| now.push(ABSENT));
        table.row(&now);
        let mut next_rogue = 0;
        for step in 1..=steps {
            while let Some((_, body)) = rogues.get(next_rogue).filter(|(at, _)| *at == step) {
                now.set(debris.len() + next_rogue, *body);
                next_rogue += 1;
            }
            now.advance(physics);
            table.row(&now);
        }
        table
    }

    /// How many columns there are.
    pub(crate) const fn len(&self) -> usize {
        self.n
    }

    fn row(&mut self, now: &Columns) {
        self.x.extend_from_slice(&now.x);
        self.y.extend_from_slice(&now.y);
        if self.physics.contact != Contact::EndOfStep {
            self.vx.extend_from_slice(&now.vx);
            self.vy.extend_from_slice(&now.vy);
        }
    }

    /// How many points of time there are, the start included.
    pub(crate) fn rows(&self) -> usize {
        self.rows
    }

    /// Whether anything touches this place after `step`.
    pub(crate) fn touched(&self, step: usize, px: f64, py: f64) -> bool {
        self.nearer(step, px, py, CONTACT_2)
    }

    /// Whether anything is nearer to this place than `limit`, squared, after `step`.
    pub(crate) fn nearer(&self, step: usize, px: f64, py: f64, limit: f64) -> bool {
        let at = step * self.n..(step + 1) * self.n;
        let (x, y) = (&self.x[at.clone()], &self.y[at]);
        let mut any = 0u64;
        for i in 0..x.len() {
            any |= u64::from(distance_2(px, py, x[i], y[i]) < limit);
        }
        any != 0
    }

    /// Whether anything comes near enough to a body within `step`, at whose end it is there.
    fn crossed(&self, step: usize, body: &Body) -> bool {
        (0..self.n).any(|column| self.crossing_2(column, step, body) < CONTACT_2)
    }

    /// Least distance squared to one column within `step`.
    fn crossing_2(&self, column: usize, step: usize, body: &Body) -> f64 {
        let (dx, dy, wx, wy) = self.relative(column, step, body);
        swept_2(dx, dy, wx, wy)
    }

    /// Relative position and velocity of a body to a column after `step`.
    fn relative(&self, column: usize, step: usize, body: &Body) -> (f64, f64, f64, f64) {
        let at = step * self.n + column;
        (body.x - self.x[at], body.y - self.y[at], body.vx - self.vx[at], body.vy - self.vy[at])
    }

    /// The probability that one column does not hit a body in `step`, which was at `before` and is at `body`.
    #[inline]
    pub(crate) fn spares(&self, column: usize, step: usize, before: &Body, body: &Body, sigma: f64) -> f64 {
        let most = CONTACT_DISTANCE + SIGMAS * sigma;
        let (dx, dy, wx, wy) = self.relative(column, step, body);
        // Too far at the end to have been near within the step: (a + b)² ≤ 2a² + 2b².
        if dx * dx + dy * dy > 2.0 * (most * most + wx * wx + wy * wy) {
            return 1.0;
        }
        // Where nothing was before, nothing approached. Only a course that changes at the start of the step asks.
        let approaching = || {
            let (dx, dy, wx, wy) = self.relative(column, step - 1, before);
            dx.abs() < 0.5 * NOWHERE && dx * wx + dy * wy < 0.0
        };
        let start = dx * wx + dy * wy - (wx * wx + wy * wy);
        let passed = passing_2(dx, dy, wx, wy, start >= 0.0 && approaching());
        passed
            .filter(|&miss_2| miss_2 < most * most)
            .map_or(1.0, |miss_2| 1.0 - collision_probability(miss_2.sqrt(), sigma))
    }

    /// Whether anything destroys a body in `step`, at whose end it is there.
    pub(crate) fn destroyed(&self, step: usize, body: &Body) -> bool {
        match self.physics.contact {
            Contact::EndOfStep => self.touched(step, body.x, body.y),
            Contact::Swept => self.crossed(step, body),
            Contact::Chance(_) => false,
        }
    }

    /// Whether one column meets a body in `step`, at whose end it is there.
    pub(crate) fn meets(&self, column: usize, step: usize, body: &Body) -> bool {
        let d2 = if self.physics.contact == Contact::Swept {
            self.crossing_2(column, step, body)
        } else {
            self.clear_of(column, step, body.x, body.y)
        };
        d2 < CONTACT_2
    }

    /// Which column meets a body in `step`, at whose end it is there: the first in order.
    pub(crate) fn touching(&self, step: usize, body: &Body) -> Option<usize> {
        (0..self.n).find(|&column| self.meets(column, step, body))
    }

    /// Where one column is after `step`; far away where there is nothing.
    pub(crate) fn place(&self, column: usize, step: usize) -> (f64, f64) {
        let at = step * self.n + column;
        (self.x[at], self.y[at])
    }

    /// Distance squared to one column after `step`.
    pub(crate) fn clear_of(&self, column: usize, step: usize, px: f64, py: f64) -> f64 {
        let at = step * self.n + column;
        distance_2(px, py, self.x[at], self.y[at])
    }
}

struct Columns {
    x: Vec<f64>,
    y: Vec<f64>,
    vx: Vec<f64>,
    vy: Vec<f64>,
    may_be_inside: bool,
}

impl Columns {
    fn with_room(n: usize) -> Self {
        let room = || Vec::with_capacity(n);
        Self { x: room(), y: room(), vx: room(), vy: room(), may_be_inside: true }
    }

    fn push(&mut self, body: Body) {
        self.x.push(body.x);
        self.y.push(body.y);
        self.vx.push(body.vx);
        self.vy.push(body.vy);
    }

    fn set(&mut self, i: usize, body: Body) {
        self.x[i] = body.x;
        self.y[i] = body.y;
        self.vx[i] = body.vx;
        self.vy[i] = body.vy;
    }

    fn advance(&mut self, physics: Physics) {
        match physics.gravity {
            Gravity::Point => self.advance_under::<false>(physics.upstream),
            Gravity::J2 => self.advance_under::<true>(physics.upstream),
        }
    }

    fn advance_under<const OBLATE: bool>(&mut self, upstream: bool) {
        let n = self.x.len();
        if self.may_be_inside {
            for i in 0..n {
                if self.x[i] * self.x[i] + self.y[i] * self.y[i] < EARTH_RADIUS_2 {
                    if upstream {
                        continue; // frozen where it is
                    }
                    self.set(i, ABSENT);
                }
                coast::<OBLATE>(&mut self.x[i], &mut self.y[i], &mut self.vx[i], &mut self.vy[i]);
            }
        } else {
            let (x, y) = (&mut self.x[..n], &mut self.y[..n]);
            let (vx, vy) = (&mut self.vx[..n], &mut self.vy[..n]);
            for i in 0..n {
                coast::<OBLATE>(&mut x[i], &mut y[i], &mut vx[i], &mut vy[i]);
            }
        }
        let mut inside = 0u64;
        for i in 0..n {
            inside |= u64::from(self.x[i] * self.x[i] + self.y[i] * self.y[i] < EARTH_RADIUS_2);
        }
        self.may_be_inside = inside != 0;
    }
}

/// How a satellite was lost against the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Loss {
    pub step: u32,
    /// By debris (else by the Earth).
    pub hit: bool,
}

/// One satellite's trajectory under a plan, until it is lost or the horizon.
#[derive(Debug, Clone)]
pub(crate) struct Path {
    pub bodies: [Body; POINTS],
    pub fuel: [f64; POINTS],
    pub cost: [f64; POINTS],
    /// Probability that it still flies, encounters alone; 1 where debris destroys what it touches.
    pub survival: [f64; POINTS],
    pub loss: Option<Loss>,
    pub burns: Vec<Burn>,
}

impl Path {
    pub(crate) fn start(body: Body, fuel: f64) -> Self {
        Self {
            bodies: [body; POINTS],
            fuel: [fuel; POINTS],
            cost: [0.0; POINTS],
            survival: [1.0; POINTS],
            loss: None,
            burns: Vec::new(),
        }
    }

    /// One step under an optional burn; false once it is lost. A burn that fuel is short for is not in the plan.
    pub(crate) fn advance(&mut self, table: &Table, step: u32, burn: Option<(f64, f64)>) -> bool {
        let t = step as usize;
        let before = self.bodies[t - 1];
        let mut body = before;
        let mut fuel = self.fuel[t - 1];
        self.cost[t] = 0.0;
        if let Some((dvx, dvy)) = burn {
            let (dvx, dvy, cost) = clamped_burn(dvx, dvy);
            if cost <= fuel {
                fuel -= cost;
                body.vx += dvx;
                body.vy += dvy;
                self.cost[t] = cost;
                self.burns.push(Burn { step, dvx, dvy });
            }
        }
        self.fuel[t] = fuel;
        self.survival[t] = self.survival[t - 1];
        if body.radius_2() < EARTH_RADIUS_2 {
            self.bodies[t] = body;
            self.loss = Some(Loss { step, hit: false });
            return false;
        }
        body = body.coasted(table.physics.gravity);
        self.bodies[t] = body;
        if let Contact::Chance(sigma) = table.physics.contact {
            self.survival[t] = table.survival(t, &before, &body, sigma, self.survival[t]);
        }
        if table.destroyed(t, &body) {
            self.loss = Some(Loss { step, hit: true });
            return false;
        }
        true
    }

    /// Flies the rest, from `step` on, by `burns` (ordered by step).
    pub(crate) fn fly(&mut self, table: &Table, step: u32, burns: &[Burn]) {
        self.fly_while(table, step, burns, |_, _| true);
    }

    /// The same for as long as `promising` says so of the path and each step flown; whether it came to its end.
    pub(crate) fn fly_while(
        &mut self,
        table: &Table,
        step: u32,
        burns: &[Burn],
        mut promising: impl FnMut(&Self, usize) -> bool,
    ) -> bool {
        let mut next = 0;
        for t in step..=HORIZON {
            let burn = burns.get(next).filter(|b| b.step == t).map(|b| (b.dvx, b.dvy));
            next += usize::from(burn.is_some());
            if !self.advance(table, t, burn) {
                return true;
            }
            if !promising(self, t as usize) {
                return false;
            }
        }
        true
    }

    /// The same start again, to be flown from `step` on.
    pub(crate) fn branch(&mut self, from: &Self, step: u32) {
        let t = step as usize;
        self.bodies[..t].copy_from_slice(&from.bodies[..t]);
        self.fuel[..t].copy_from_slice(&from.fuel[..t]);
        self.cost[..t].copy_from_slice(&from.cost[..t]);
        self.survival[..t].copy_from_slice(&from.survival[..t]);
        self.loss = None;
        self.burns.clear();
        self.burns.extend(from.burns.iter().filter(|b| b.step < step));
    }

    /// Steps survived.
    pub(crate) fn survived(&self) -> u32 {
        self.loss.map_or(HORIZON, |loss| loss.step - 1)
    }

    /// Whether it counts as lost.
    pub(crate) fn lost(&self) -> bool {
        self.threat().is_some()
    }

    /// The step at which it is lost: hit, decayed, or survival below what counts.
    pub(crate) fn threat(&self) -> Option<u32> {
        let doubtful = || (1..).zip(&self.survival[1..]).find(|(_, s)| **s < SURVIVED).map(|(step, _)| step);
        match self.loss {
            Some(loss) => Some(loss.step),
            None if self.survival[HORIZON as usize] < SURVIVED => doubtful(),
            None => None,
        }
    }

    /// Steps survived, each weighed by how likely that is.
    pub(crate) fn weights(&self) -> impl Iterator<Item = (usize, f64)> {
        (1..=self.survived() as usize).map(|t| (t, self.survival[t]))
    }
}
