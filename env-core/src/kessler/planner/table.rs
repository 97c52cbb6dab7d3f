//! Debris does not depend on what satellites do (fragments aside), so it is propagated once and satellites are flown
//! against the table, one by one.

use crate::bracket::Flown;
use crate::chance::Seeded;
use crate::kessler::constants::{CONTACT_2, EARTH_RADIUS_2, FRAGMENTS, GOAL_STEPS, HORIZON, SATELLITES};
use crate::kessler::flight::fragment;
use crate::kessler::kernel::{Body, clamped_burn, coast, distance_2};
use crate::kessler::reward::{Objective, proximity, score};
use crate::kessler::setup::{Setup, Start};
use crate::seed::Seed;

/// Points of a trajectory: the start, and after each step.
pub(crate) const POINTS: usize = HORIZON as usize + 1;
/// Where bodies are put that are not there: far from everything, and still a number.
const NOWHERE: f64 = 1e12;
const ABSENT: Body = Body { x: NOWHERE, y: NOWHERE, vx: 0.0, vy: 0.0 };

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
    x: Vec<f64>,
    y: Vec<f64>,
    upstream: bool,
}

impl Table {
    /// All debris of an episode, rogues to come included.
    pub(crate) fn of(setup: &Setup, start: &Start) -> Self {
        Self::propagate(&start.debris, &start.rogues, HORIZON, setup.upstream)
    }

    /// `debris` from now on, and `rogues` from the step they arrive in, for `steps` steps.
    pub(crate) fn propagate(debris: &[Body], rogues: &[(u32, Body)], steps: u32, upstream: bool) -> Self {
        let n = debris.len() + rogues.len();
        let room = || Vec::with_capacity(n * (steps as usize + 1));
        let mut table = Self { n, x: room(), y: room(), upstream };
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
            now.advance(upstream);
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
    }

    /// Whether anything touches this place after `step`.
    pub(crate) fn touched(&self, step: usize, px: f64, py: f64) -> bool {
        let at = step * self.n..(step + 1) * self.n;
        let (x, y) = (&self.x[at.clone()], &self.y[at]);
        let mut any = 0u64;
        for i in 0..x.len() {
            any |= u64::from(distance_2(px, py, x[i], y[i]) < CONTACT_2);
        }
        any != 0
    }

    /// Which column touches this place after `step`, the first in order.
    pub(crate) fn touching(&self, step: usize, px: f64, py: f64) -> Option<usize> {
        (0..self.n).find(|&i| self.clear_of(i, step, px, py) < CONTACT_2)
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

    fn advance(&mut self, upstream: bool) {
        let n = self.x.len();
        if self.may_be_inside {
            for i in 0..n {
                if self.x[i] * self.x[i] + self.y[i] * self.y[i] < EARTH_RADIUS_2 {
                    if upstream {
                        continue; // frozen where it is
                    }
                    self.set(i, ABSENT);
                }
                coast(&mut self.x[i], &mut self.y[i], &mut self.vx[i], &mut self.vy[i]);
            }
        } else {
            let (x, y) = (&mut self.x[..n], &mut self.y[..n]);
            let (vx, vy) = (&mut self.vx[..n], &mut self.vy[..n]);
            for i in 0..n {
                coast(&mut x[i], &mut y[i], &mut vx[i], &mut vy[i]);
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
    pub loss: Option<Loss>,
    pub burns: Vec<Burn>,
}

impl Path {
    pub(crate) fn start(body: Body, fuel: f64) -> Self {
        Self {
            bodies: [body; POINTS],
            fuel: [fuel; POINTS],
            cost: [0.0; POINTS],
            loss: None,
            burns: Vec::new(),
        }
    }

    /// One step under an optional burn; false once it is lost. A burn that fuel is short for is not in the plan.
    pub(crate) fn advance(&mut self, table: &Table, step: u32, burn: Option<(f64, f64)>) -> bool {
        let t = step as usize;
        let mut body = self.bodies[t - 1];
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
        if body.radius_2() < EARTH_RADIUS_2 {
            self.bodies[t] = body;
            self.loss = Some(Loss { step, hit: false });
            return false;
        }
        body = body.coasted();
        self.bodies[t] = body;
        if table.touched(t, body.x, body.y) {
            self.loss = Some(Loss { step, hit: true });
            return false;
        }
        true
    }

    /// Flies the rest, from `step` on, by `burns` (ordered by step).
    pub(crate) fn fly(&mut self, table: &Table, step: u32, burns: &[Burn]) {
        let mut next = 0;
        for t in step..=HORIZON {
            let burn = burns.get(next).filter(|b| b.step == t).map(|b| (b.dvx, b.dvy));
            next += usize::from(burn.is_some());
            if !self.advance(table, t, burn) {
                return;
            }
        }
    }

    /// The same start again, to be flown from `step` on.
    pub(crate) fn branch(&mut self, from: &Self, step: u32) {
        let t = step as usize;
        self.bodies[..t].copy_from_slice(&from.bodies[..t]);
        self.fuel[..t].copy_from_slice(&from.fuel[..t]);
        self.cost[..t].copy_from_slice(&from.cost[..t]);
        self.loss = None;
        self.burns.clear();
        self.burns.extend(from.burns.iter().filter(|b| b.step < step));
    }

    /// Steps survived.
    pub(crate) fn survived(&self) -> u32 {
        self.loss.map_or(HORIZON, |loss| loss.step - 1)
    }
}

/// How three trajectories fare together: fragments of those that are hit may hit the others. Exactly what the episode
/// gives, to the bit; a property test holds it to that.
pub(crate) fn judge(
    objective: Objective,
    setup: &Setup,
    seed: Seed,
    table: &Table,
    paths: [&Path; SATELLITES],
) -> Flown {
    told(objective, setup, paths, with_fragments(seed, table, paths))
}

/// How three trajectories fare together where each is lost as `loss` says.
pub(crate) fn told(
    objective: Objective,
    setup: &Setup,
    paths: [&Path; SATELLITES],
    loss: [Option<Loss>; SATELLITES],
) -> Flown {
    let alive = |i: usize, step: u32| loss[i].is_none_or(|l| step < l.step);
    let mut flown = Flown { score: 0.0, total: 0.0, steps: 0, lost: 0, goal: None, fuel_used: 0.0 };
    let mut goal = 0.0;
    for step in 1..=HORIZON {
        let t = step as usize;
        let (mut active, mut fuel) = (0, 0.0);
        for (i, path) in paths.iter().enumerate() {
            // A burn precedes the motion: one that is lost in this step has still burnt.
            if alive(i, step - 1) && path.cost[t] > 0.0 {
                flown.fuel_used += path.cost[t];
            }
            if alive(i, step) {
                active += 1;
                fuel += path.fuel[t];
            }
        }
        let near = if objective == Objective::Rendezvous && alive(0, step) {
            proximity(paths[0].bodies[t].radius())
        } else {
            0.0
        };
        if step > HORIZON - GOAL_STEPS {
            goal += near;
        }
        flown.total += objective.reward(active, fuel, setup.fuel, near);
        flown.steps = step;
        if active == 0 {
            break;
        }
    }
    flown.lost = loss.iter().flatten().count() as u32;
    flown.score = score(flown.total);
    flown.goal = (objective == Objective::Rendezvous).then(|| goal / f64::from(GOAL_STEPS));
    flown
}

/// When and how each is lost, fragments of the others included.
pub(crate) fn with_fragments(
    seed: Seed,
    table: &Table,
    paths: [&Path; SATELLITES],
) -> [Option<Loss>; SATELLITES] {
    let mut loss = paths.map(|path| path.loss);
    if loss.iter().flatten().all(|l| !l.hit) {
        return loss;
    }
    let mut chance = Seeded::new(seed);
    let mut seen = [false; SATELLITES];
    loop {
        let next = (0..SATELLITES)
            .filter(|&i| !seen[i])
            .filter_map(|i| loss[i].filter(|l| l.hit).map(|l| (l.step, i)))
            .min();
        let Some((step, i)) = next else { return loss };
        seen[i] = true;
        for _ in 0..FRAGMENTS {
            let piece = fragment(paths[i].bodies[step as usize], &mut chance);
            fly_fragment(piece, step, i, table.upstream, paths, &mut loss);
        }
    }
}

fn fly_fragment(
    mut piece: Body,
    from: u32,
    of: usize,
    upstream: bool,
    paths: [&Path; SATELLITES],
    loss: &mut [Option<Loss>; SATELLITES],
) {
    for step in from..=HORIZON {
        if step > from {
            if piece.radius_2() < EARTH_RADIUS_2 {
                if !upstream {
                    return;
                }
            } else {
                piece = piece.coasted();
            }
        }
        for (j, path) in paths.iter().enumerate() {
            // In the step of the collision only satellites later in order still look.
            let looks = j != of && (step > from || j > of) && loss[j].is_none_or(|l| step < l.step);
            let body = path.bodies[step as usize];
            if looks && distance_2(body.x, body.y, piece.x, piece.y) < CONTACT_2 {
                loss[j] = Some(Loss { step, hit: true });
            }
        }
    }
}
