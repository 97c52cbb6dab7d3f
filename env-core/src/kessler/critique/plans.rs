//! Satellites flown again, one by one, under other burns than the log's: against the table, and judged together with the
//! others as they flew. To the bit what the engine would give; a property test holds it to that.

use crate::bracket::Flown;
use crate::kessler::constants::{HORIZON, SATELLITES};
use crate::kessler::kernel::{Body, clamped_burn};
use crate::kessler::planner::table::{Loss, Path, Table, told, with_fragments};
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

/// How a plan fares.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fate {
    /// The engine's word.
    pub(super) flown: Flown,
    /// How each satellite is lost.
    pub(super) loss: [Option<Loss>; SATELLITES],
}

impl Fate {
    /// Steps survived, summed over the satellites.
    pub(super) fn lived(&self) -> u32 {
        self.loss.iter().map(|loss| loss.map_or(HORIZON, |l| l.step - 1)).sum()
    }
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
        let asked = asked(log, setup.upstream);
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

    /// The log's path up to `step`, then one burn in that step, then hold, into `path`.
    pub(super) fn instead(&self, satellite: usize, step: u32, burn: (f64, f64), fuel: f64, path: &mut Path) {
        path.branch(&self.paths[satellite], step);
        path.fuel[step as usize - 1] = fuel;
        if path.advance(self.table, step, Some(burn)) {
            path.fly(self.table, step + 1, &[]);
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

    /// When and how a satellite is lost on this path, with the others as they flew.
    pub(super) fn loss(&self, satellite: usize, path: &Path) -> Option<Loss> {
        with_fragments(self.seed, self.table, self.replaced(satellite, path))[satellite]
    }

    fn replaced<'p>(&'p self, satellite: usize, path: &'p Path) -> [&'p Path; SATELLITES] {
        std::array::from_fn(|i| if i == satellite { path } else { &self.paths[i] })
    }

    fn judge(&self, paths: [&Path; SATELLITES]) -> Fate {
        let loss = with_fragments(self.seed, self.table, paths);
        Fate { flown: told(self.objective, self.setup, paths, loss), loss }
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
