//! Satellites flown again, one by one, under other burns than the log's: against the table, and judged together with the
//! others as they flew. To the bit what the engine would give; a property test holds it to that.

use crate::bracket::Flown;
use crate::kessler::constants::{HORIZON, SATELLITES, SURVIVED};
use crate::kessler::kernel::{Body, clamped_burn};
use crate::kessler::planner::judge::{told, with_fragments};
use crate::kessler::planner::table::{Path, Table};
use crate::kessler::reward::Objective;
use crate::kessler::setup::{Setup, Start};
use crate::log::ActionLog;
use crate::seed::Seed;

/// A burn that the log asks for: (dvx, dvy) LU/TU before the motion of `step`, unclamped, affordable or not.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Asked {
    step: u32,
    dvx: f64,
    dvy: f64,
}

/// What the log asks for, and how it flies.
pub(super) struct Plans<'a> {
    objective: Objective,
    setup: &'a Setup,
    seed: Seed,
    pub(super) table: &'a Table,
    starts: [Body; SATELLITES],
    asked: [Vec<Asked>; SATELLITES],
    /// The log's paths; that of a satellite which a fragment takes goes on as if it had not.
    pub(super) paths: [Path; SATELLITES],
}

/// One burn that is tried, and the fuel there is for it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Single {
    pub(super) step: u32,
    pub(super) dvx: f64,
    pub(super) dvy: f64,
    pub(super) fuel: f64,
}

/// How a plan fares.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fate {
    /// The engine's word.
    pub(super) flown: Flown,
    /// Steps survived, summed over the satellites, each weighed by how likely that is.
    pub(super) lived: f64,
}

impl<'a> Plans<'a> {
    pub(super) fn of(
        objective: Objective,
        setup: &'a Setup,
        start: &Start,
        seed: Seed,
        table: &'a Table,
        log: &ActionLog,
    ) -> Self {
        let paths = start.satellites.map(|body| Path::start(body, setup.fuel));
        let asked = asked(log, setup.physics.upstream);
        let mut plans = Self { objective, setup, seed, table, starts: start.satellites, asked, paths };
        for satellite in 0..SATELLITES {
            let mut path = plans.paths[satellite].clone();
            plans.fly(satellite, &mut path, 1, None);
            plans.paths[satellite] = path;
        }
        plans
    }

    /// Flies what the log asks of a satellite, from `from` on, leaving out what it asks in the step `without`.
    fn fly(&self, satellite: usize, path: &mut Path, from: u32, without: Option<u32>) {
        let asked = &self.asked[satellite];
        let mut next = asked.partition_point(|burn| burn.step < from);
        for step in from..=HORIZON {
            let first = next;
            while asked.get(next).is_some_and(|burn| burn.step == step) {
                next += 1;
            }
            let burns = if without == Some(step) { &[] } else { &asked[first..next] };
            if !advance(path, self.table, step, burns) {
                return;
            }
        }
    }

    /// The log's path with one step's burns left out, into `path`.
    pub(super) fn without(&self, satellite: usize, step: u32, path: &mut Path) {
        path.branch(&self.paths[satellite], step);
        self.fly(satellite, path, step, Some(step));
    }

    /// The path that flies everything the log asks for as if fuel were never short.
    pub(super) fn granted(&self, satellite: usize) -> Path {
        let mut path = Path::start(self.starts[satellite], f64::MAX);
        self.fly(satellite, &mut path, 1, None);
        path
    }

    /// The log's path up to a step, then one burn in that step, then hold, into `path`; flown only through `until`.
    pub(super) fn instead(&self, satellite: usize, burn: &Single, until: u32, path: &mut Path) {
        path.branch(&self.paths[satellite], burn.step);
        path.fuel[burn.step as usize - 1] = burn.fuel;
        let mut flies = path.advance(self.table, burn.step, Some((burn.dvx, burn.dvy)));
        for step in burn.step + 1..=until {
            flies = flies && path.advance(self.table, step, None);
        }
    }

    /// Everybody holds.
    pub(super) fn hold(&self) -> Fate {
        let paths = self.starts.map(|body| {
            let mut path = Path::start(body, self.setup.fuel);
            path.fly(self.table, 1, &[]);
            path
        });
        self.judge([&paths[0], &paths[1], &paths[2]])
    }

    /// The log as it is.
    pub(super) fn as_flown(&self) -> Fate {
        self.judge([&self.paths[0], &self.paths[1], &self.paths[2]])
    }

    /// The log with one satellite's path changed.
    pub(super) fn with(&self, satellite: usize, path: &Path) -> Fate {
        self.judge(self.replaced(satellite, path))
    }

    /// Whether a satellite lives through `step` on this path, flown so far, with the others as they flew. What the path
    /// holds past `step` can at most lose it later.
    pub(super) fn outlives(&self, satellite: usize, path: &Path, step: u32) -> bool {
        let loss = with_fragments(self.seed, self.table, self.replaced(satellite, path))[satellite];
        loss.is_none_or(|loss| loss.step > step) && path.survival[step as usize] >= SURVIVED
    }

    fn replaced<'p>(&'p self, satellite: usize, path: &'p Path) -> [&'p Path; SATELLITES] {
        std::array::from_fn(|i| if i == satellite { path } else { &self.paths[i] })
    }

    fn judge(&self, paths: [&Path; SATELLITES]) -> Fate {
        let loss = with_fragments(self.seed, self.table, paths);
        let lived = paths.iter().zip(loss).map(|(path, loss)| {
            let last = loss.map_or(HORIZON, |loss| loss.step - 1) as usize;
            path.survival[1..=last].iter().sum::<f64>()
        });
        Fate { flown: told(self.objective, self.setup, paths, loss), lived: lived.sum() }
    }
}

/// What the log asks of each satellite: one sum a step, or under `compat: upstream` every entry by itself.
fn asked(log: &ActionLog, upstream: bool) -> [Vec<Asked>; SATELLITES] {
    let mut asked = [const { Vec::<Asked>::new() }; SATELLITES];
    for (step, action) in (1u32..).zip(log.steps()) {
        for (i, &agent) in action.agents.iter().enumerate() {
            let Some(burns) = asked.get_mut(agent as usize) else { continue };
            let (dvx, dvy) = (action.values[2 * i], action.values[2 * i + 1]);
            match burns.last_mut().filter(|last| last.step == step && !upstream) {
                Some(sum) => {
                    sum.dvx += dvx;
                    sum.dvy += dvy;
                }
                None => burns.push(Asked { step, dvx, dvy }),
            }
        }
    }
    asked
}

/// One step under the burns asked for in it; false once the satellite is lost.
fn advance(path: &mut Path, table: &Table, step: u32, burns: &[Asked]) -> bool {
    let [first, .., last] = burns else {
        return path.advance(table, step, burns.first().map(|burn| (burn.dvx, burn.dvy)));
    };
    debug_assert_eq!(first.step, last.step);
    // Several, each by itself: all but the motion is done before the step, on a copy of where it starts.
    let before = (path.bodies[step as usize - 1], path.fuel[step as usize - 1]);
    let (mut body, mut fuel) = before;
    let mut spent = 0.0;
    for burn in burns {
        let (dvx, dvy, cost) = clamped_burn(burn.dvx, burn.dvy);
        if cost <= fuel {
            fuel -= cost;
            body.vx += dvx;
            body.vy += dvy;
            spent += cost;
        }
    }
    (path.bodies[step as usize - 1], path.fuel[step as usize - 1]) = (body, fuel);
    let flies = path.advance(table, step, None);
    (path.bodies[step as usize - 1], path.fuel[step as usize - 1]) = before;
    path.cost[step as usize] = spent;
    flies
}
