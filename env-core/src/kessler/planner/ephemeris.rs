//! Ephemeris of all debris: its positions after every step. Debris does not depend on what satellites do
//! (fragments aside), so it is propagated once, and satellites are then flown against the ephemeris one by
//! one.

mod close_approaches;
mod proximity_grid;

use std::sync::OnceLock;

use self::proximity_grid::{ProximityGrid, SearchGrids};
use crate::kessler::body_blocks::{ABSENT_BODY, ABSENT_COORDINATE};
use crate::kessler::constants::{CONTACT_2, CONTACT_DISTANCE, EARTH_RADIUS_2, HORIZON, SIGMAS};
use crate::kessler::kernel::{
    Body, Gravity, closest_approach_squared, collision_probability, distance_squared, euler_step,
    min_distance_squared,
};
use crate::kessler::setup::{ContactModel, InitialState, KesslerSetup, Physics, RogueArrival};

/// States of all debris after every step, row by row. A column is one body: debris of the start, then rogues.
pub(crate) struct DebrisEphemeris {
    columns: usize,
    rows: usize,
    x: Vec<f64>,
    y: Vec<f64>,
    /// Velocities; empty if the contact model does not need them.
    vx: Vec<f64>,
    vy: Vec<f64>,
    pub(super) physics: Physics,
    /// Grids for searches, once they are prepared.
    grids: OnceLock<SearchGrids>,
}

impl DebrisEphemeris {
    /// Propagates all debris of an episode, including rogues to come.
    pub(crate) fn from_initial_state(setup: &KesslerSetup, start: &InitialState) -> Self {
        Self::propagate(&start.debris, &start.rogues, HORIZON, setup.physics)
    }

    /// Propagates `debris` from now on, and `rogues` from the step in which they arrive, for `steps` steps.
    pub(crate) fn propagate(debris: &[Body], rogues: &[RogueArrival], steps: u32, physics: Physics) -> Self {
        let columns = debris.len() + rogues.len();
        let rows = steps as usize + 1;
        let cells = || Vec::with_capacity(columns * rows);
        let velocities = || if physics.contact == ContactModel::EndOfStep { Vec::new() } else { cells() };
        let mut ephemeris = Self {
            columns,
            rows,
            x: cells(),
            y: cells(),
            vx: velocities(),
            vy: velocities(),
            physics,
            grids: OnceLock::new(),
        };
        let mut current = DebrisColumns::with_capacity(columns);
        debris.iter().for_each(|body| current.push(*body));
        rogues.iter().for_each(|_| current.push(ABSENT_BODY));
        ephemeris.push_row(&current);
        let mut next_rogue = 0;
        for step in 1..=steps {
            while let Some(rogue) = rogues.get(next_rogue).filter(|rogue| rogue.step == step) {
                current.set(debris.len() + next_rogue, rogue.body);
                next_rogue += 1;
            }
            current.advance(physics);
            ephemeris.push_row(&current);
        }
        ephemeris
    }

    /// Prepares comparisons with nearby debris alone, which pays from about fifty trajectories on. No result depends on
    /// it.
    pub(in crate::kessler) fn prepare_search(&self) {
        self.grids.get_or_init(|| SearchGrids::new(self));
    }

    /// Grid of debris near the ends of steps, if it is prepared.
    fn near_grid(&self) -> Option<&ProximityGrid> {
        self.grids.get()?.near.as_ref()
    }

    /// Grid of debris that passes within steps, if it is prepared.
    fn passing_grid(&self) -> Option<&ProximityGrid> {
        self.grids.get()?.passing.as_ref()
    }

    /// Number of columns: debris of the start and rogues.
    pub(crate) const fn len(&self) -> usize {
        self.columns
    }

    /// Number of rows: the start and every step.
    pub(crate) const fn rows(&self) -> usize {
        self.rows
    }

    /// Returns true if any debris is closer than the square root of `limit_2` to a point after `step`.
    pub(crate) fn any_within(&self, step: usize, px: f64, py: f64, limit_2: f64) -> bool {
        if let Some(near) = self.near_grid().and_then(|grid| grid.columns_near(step, px, py, limit_2)) {
            let is_within =
                |column: &u16| self.distance_squared_to(usize::from(*column), step, px, py) < limit_2;
            return near.iter().any(is_within);
        }
        let row = step * self.columns..(step + 1) * self.columns;
        let (x, y) = (&self.x[row.clone()], &self.y[row]);
        let mut any = 0u64;
        for i in 0..x.len() {
            any |= u64::from(distance_squared(px, py, x[i], y[i]) < limit_2);
        }
        any != 0
    }

    /// Returns true if any debris destroys a satellite in `step`. `body` is the satellite's state at the end
    /// of the step.
    pub(crate) fn destroys(&self, step: usize, body: &Body) -> bool {
        match self.physics.contact {
            ContactModel::EndOfStep => self.any_within(step, body.x, body.y, CONTACT_2),
            ContactModel::Swept => {
                let hits = |column| self.swept_distance_squared(column, step, body) < CONTACT_2;
                match self.passing_grid().and_then(|grid| grid.columns_passing(step, body, CONTACT_DISTANCE))
                {
                    Some(near) => near.iter().any(|&column| hits(usize::from(column))),
                    None => (0..self.columns).any(hits),
                }
            }
            ContactModel::Probability(_) => false,
        }
    }

    /// Returns true if one column touches a satellite in `step`. `body` is the satellite's state at the end
    /// of the step.
    pub(crate) fn column_hits(&self, column: usize, step: usize, body: &Body) -> bool {
        let d2 = if self.physics.contact == ContactModel::Swept {
            self.swept_distance_squared(column, step, body)
        } else {
            self.distance_squared_to(column, step, body.x, body.y)
        };
        d2 < CONTACT_2
    }

    /// First column that touches a satellite in `step`. `body` is the satellite's state at the end of the
    /// step.
    pub(crate) fn first_hit(&self, step: usize, body: &Body) -> Option<usize> {
        (0..self.columns).find(|&column| self.column_hits(column, step, body))
    }

    /// Probability that one column does not hit a satellite in `step`, which moves it from `before` to
    /// `body`.
    #[inline]
    pub(crate) fn survival_factor(
        &self,
        column: usize,
        step: usize,
        before: &Body,
        body: &Body,
        sigma: f64,
    ) -> f64 {
        let max_miss = CONTACT_DISTANCE + SIGMAS * sigma;
        let (dx, dy, wx, wy) = self.relative_state(column, step, body);
        // Too far at the end of the step to have been close within it: (a + b)² ≤ 2a² + 2b².
        if dx * dx + dy * dy > 2.0 * (max_miss * max_miss + wx * wx + wy * wy) {
            return 1.0;
        }
        // An absent body did not approach. Only a course that changes at the start of the step needs this.
        let was_approaching = || {
            let (dx, dy, wx, wy) = self.relative_state(column, step - 1, before);
            dx.abs() < 0.5 * ABSENT_COORDINATE && dx * wx + dy * wy < 0.0
        };
        let start = dx * wx + dy * wy - (wx * wx + wy * wy);
        let miss_2 = closest_approach_squared(dx, dy, wx, wy, start >= 0.0 && was_approaching());
        miss_2
            .filter(|&miss_2| miss_2 < max_miss * max_miss)
            .map_or(1.0, |miss_2| 1.0 - collision_probability(miss_2.sqrt(), sigma))
    }

    /// Position of one column after `step`, LU; far away if the body is absent.
    pub(crate) fn position(&self, column: usize, step: usize) -> (f64, f64) {
        let cell = step * self.columns + column;
        (self.x[cell], self.y[cell])
    }

    /// Squared distance of one column to a point after `step`, LU².
    pub(crate) fn distance_squared_to(&self, column: usize, step: usize, px: f64, py: f64) -> f64 {
        let cell = step * self.columns + column;
        distance_squared(px, py, self.x[cell], self.y[cell])
    }

    /// Least squared distance of one column to a satellite within `step`, LU².
    fn swept_distance_squared(&self, column: usize, step: usize, body: &Body) -> f64 {
        let (dx, dy, wx, wy) = self.relative_state(column, step, body);
        min_distance_squared(dx, dy, wx, wy)
    }

    /// Position and velocity of a body relative to a column after `step`.
    #[inline]
    fn relative_state(&self, column: usize, step: usize, body: &Body) -> (f64, f64, f64, f64) {
        let cell = step * self.columns + column;
        (body.x - self.x[cell], body.y - self.y[cell], body.vx - self.vx[cell], body.vy - self.vy[cell])
    }

    fn push_row(&mut self, current: &DebrisColumns) {
        self.x.extend_from_slice(&current.x);
        self.y.extend_from_slice(&current.y);
        if self.physics.contact != ContactModel::EndOfStep {
            self.vx.extend_from_slice(&current.vx);
            self.vy.extend_from_slice(&current.vy);
        }
    }
}

/// States of all debris at one time, column by column.
struct DebrisColumns {
    x: Vec<f64>,
    y: Vec<f64>,
    vx: Vec<f64>,
    vy: Vec<f64>,
    may_be_inside_earth: bool,
}

impl DebrisColumns {
    fn with_capacity(bodies: usize) -> Self {
        let column = || Vec::with_capacity(bodies);
        Self { x: column(), y: column(), vx: column(), vy: column(), may_be_inside_earth: true }
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
            Gravity::Point => self.advance_under::<false>(physics.upstream_compat),
            Gravity::J2 => self.advance_under::<true>(physics.upstream_compat),
        }
    }

    fn advance_under<const OBLATE: bool>(&mut self, upstream: bool) {
        let n = self.x.len();
        if self.may_be_inside_earth {
            for i in 0..n {
                if self.x[i] * self.x[i] + self.y[i] * self.y[i] < EARTH_RADIUS_2 {
                    if upstream {
                        continue; // Frozen inside the Earth.
                    }
                    self.set(i, ABSENT_BODY);
                }
                euler_step::<OBLATE>(&mut self.x[i], &mut self.y[i], &mut self.vx[i], &mut self.vy[i]);
            }
        } else {
            let (x, y) = (&mut self.x[..n], &mut self.y[..n]);
            let (vx, vy) = (&mut self.vx[..n], &mut self.vy[..n]);
            for i in 0..n {
                euler_step::<OBLATE>(&mut x[i], &mut y[i], &mut vx[i], &mut vy[i]);
            }
        }
        let mut inside = 0u64;
        for i in 0..n {
            inside |= u64::from(self.x[i] * self.x[i] + self.y[i] * self.y[i] < EARTH_RADIUS_2);
        }
        self.may_be_inside_earth = inside != 0;
    }
}
