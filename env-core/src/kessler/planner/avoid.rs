//! Small burn schedules for one satellite that hold would lose.

use super::panel::capped;
use super::table::{Burn, Path, Table};
use crate::chance::{Chance, Seeded, Stream};
use crate::kessler::constants::{CONTACT_2, FUEL_PER_SPEED, HORIZON, SURVIVED};
use crate::kessler::kernel::clamped_burn;
use crate::kessler::reward::Objective;
use crate::kessler::setup::Contact;

const TAU: f64 = std::f64::consts::TAU;
const SIZES: [f64; 5] = [0.05, 0.1, 0.2, 0.4, 0.8];
const DIRECTIONS: u32 = 16;
/// Random schedules tried where no single burn helps, and burns in each.
const SCHEDULES: u32 = 3000;
const SCHEDULE_BURNS: usize = 4;

/// What one satellite's path is worth to the team. Satellites are worth the sum of their paths, fragments aside.
pub(super) fn worth(objective: Objective, path: &Path) -> f64 {
    match objective {
        Objective::EcoStation => path.weights().map(|(t, weight)| path.fuel[t] * weight).sum(),
        Objective::Survival | Objective::Rendezvous | Objective::Formation => {
            path.weights().map(|(_, weight)| weight).sum()
        }
    }
}

/// What a path that is being flown can still be worth, under `risk: pc`: survival and fuel only fall.
struct Hope {
    objective: Objective,
    /// What it must be worth more than.
    best: f64,
    /// What the steps flown are worth.
    so_far: f64,
}

/// The bound and the worth it bounds are sums of 50 terms in the same order: they round apart by less than 50 ε.
const ROUNDING: f64 = 1.0 + 1e-12;

impl Hope {
    /// For a path that is to be flown from `step` on.
    fn of(objective: Objective, path: &Path, step: u32, best: f64) -> Self {
        let so_far = (1..step as usize).map(|t| Self::step(objective, path, t)).sum();
        Self { objective, best, so_far }
    }

    fn step(objective: Objective, path: &Path, t: usize) -> f64 {
        match objective {
            Objective::EcoStation => path.fuel[t] * path.survival[t],
            Objective::Survival | Objective::Rendezvous | Objective::Formation => path.survival[t],
        }
    }

    /// Whether it may yet count as alive at the end, or be worth more than the best: else whatever it does from here,
    /// the search would throw it away.
    fn is_left(&mut self, path: &Path, t: usize) -> bool {
        let now = Self::step(self.objective, path, t);
        self.so_far += now;
        let rest = now * (HORIZON as usize - t) as f64;
        path.survival[t] >= SURVIVED || (self.so_far + rest) * ROUNDING > self.best
    }
}

/// Flies `path` by `burns`; its worth, if that is more than `best` or the path lives.
fn worth_more(
    objective: Objective,
    table: &Table,
    path: &mut Path,
    burns: &[Burn],
    best: f64,
) -> Option<f64> {
    let step = burns.first().map_or(1, |burn| burn.step);
    let whole = if matches!(table.physics.contact, Contact::Chance(_)) {
        let mut hope = Hope::of(objective, path, step, best);
        path.fly_while(table, step, burns, |path, t| hope.is_left(path, t))
    } else {
        path.fly(table, step, burns);
        true
    };
    whole.then(|| worth(objective, path))
}

/// The best path found for a satellite, given its panel (hold first), for as long as it is `wanted`.
pub(super) fn search(
    objective: Objective,
    table: &Table,
    panel: &[Path],
    chance: &mut Seeded,
    wanted: &dyn Fn() -> bool,
) -> Path {
    let hold = &panel[0];
    if !hold.lost() {
        return hold.clone();
    }
    let mut best = hold.clone();
    let mut best_worth = worth(objective, hold);
    for path in panel {
        // Panel kicks grow in size: the first that lives is the gentlest.
        if !path.lost() && worth(objective, path) > best_worth {
            best_worth = worth(objective, path);
            best = path.clone();
        }
    }
    let thrifty = objective == Objective::EcoStation;
    if !best.lost() && !thrifty {
        return best;
    }
    single_burns(objective, table, hold, &mut best, &mut best_worth, wanted);
    if best.lost() {
        schedules(objective, table, hold, &mut best, &mut best_worth, chance, wanted);
    }
    best
}

/// One burn: sizes from small to large, steps from late to early, 16 directions.
fn single_burns(
    objective: Objective,
    table: &Table,
    hold: &Path,
    best: &mut Path,
    best_worth: &mut f64,
    wanted: &dyn Fn() -> bool,
) {
    let Some(threat) = hold.threat() else { return };
    let fuel = hold.fuel[0];
    let last = threat as usize;
    let hard = table.physics.contact == Contact::EndOfStep && hold.loss.is_some_and(|loss| loss.hit);
    let killer = hard.then(|| table.touching(last, &hold.bodies[last])).flatten();
    let mut path = hold.clone();
    for size in SIZES {
        let size = capped(size, fuel);
        for step in (1..=threat).rev() {
            if !wanted() {
                return;
            }
            let most = ideal(objective, fuel, size, step);
            if most <= *best_worth {
                break; // an earlier burn of this size is worth less still
            }
            for direction in 0..DIRECTIONS {
                let (sin, cos) = libm::sincos(TAU * f64::from(direction) / f64::from(DIRECTIONS));
                let burn = Burn { step, dvx: size * cos, dvy: size * sin };
                if killer.is_some_and(|column| !dodges(table, hold, burn, column, threat)) {
                    continue;
                }
                path.branch(hold, step);
                let Some(value) = worth_more(objective, table, &mut path, &[burn], *best_worth) else {
                    continue;
                };
                if value > *best_worth {
                    *best_worth = value;
                    best.clone_from(&path);
                }
                if !path.lost() {
                    return;
                }
            }
        }
    }
}

/// The worth of a path that survives with one burn of `size` at `step`.
fn ideal(objective: Objective, fuel: f64, size: f64, step: u32) -> f64 {
    match objective {
        Objective::Survival | Objective::Rendezvous | Objective::Formation => f64::from(HORIZON),
        Objective::EcoStation => {
            fuel * f64::from(HORIZON) - FUEL_PER_SPEED * size * f64::from(HORIZON + 1 - step)
        }
    }
}

/// Whether the burn at least clears the body that hits under hold, up to the step of that contact.
fn dodges(table: &Table, hold: &Path, burn: Burn, column: usize, until: u32) -> bool {
    let mut body = hold.bodies[burn.step as usize - 1];
    let (dvx, dvy, _) = clamped_burn(burn.dvx, burn.dvy);
    body.vx += dvx;
    body.vy += dvy;
    for step in burn.step..=until {
        body = body.coasted(table.physics.gravity);
        if table.clear_of(column, step as usize, body.x, body.y) < CONTACT_2 {
            return false;
        }
    }
    true
}

/// Random schedules of four burns.
fn schedules(
    objective: Objective,
    table: &Table,
    hold: &Path,
    best: &mut Path,
    best_worth: &mut f64,
    chance: &mut Seeded,
    wanted: &dyn Fn() -> bool,
) {
    let Some(threat) = hold.threat() else { return };
    let fuel = hold.fuel[0];
    let mut path = hold.clone();
    for _ in 0..SCHEDULES {
        if !wanted() {
            return;
        }
        let mut burns = [Burn { step: 1, dvx: 0.0, dvy: 0.0 }; SCHEDULE_BURNS];
        for (i, burn) in burns.iter_mut().enumerate() {
            // The first acts before the contact; the others anywhere.
            let window = if i == 0 { threat } else { HORIZON };
            burn.step = 1 + (chance.uniform(Stream::Planner) * f64::from(window)) as u32;
            let most = capped(1.0, fuel / SCHEDULE_BURNS as f64 * 2.0);
            let size = most * chance.uniform(Stream::Planner);
            let (sin, cos) = libm::sincos(TAU * chance.uniform(Stream::Planner));
            (burn.dvx, burn.dvy) = (size * cos, size * sin);
        }
        burns.sort_by_key(|b| b.step);
        path.branch(hold, burns[0].step);
        let Some(value) = worth_more(objective, table, &mut path, &burns, *best_worth) else { continue };
        if value > *best_worth {
            *best_worth = value;
            best.clone_from(&path);
        }
        if !path.lost() {
            return;
        }
    }
}
