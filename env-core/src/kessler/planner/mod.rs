//! The reference planner: panel, floor, reference and witness of a scenario, without the agent.
//!
//! It works with hindsight: it knows rogues to come and debris no radar sees. What it earns is a lower bound on the
//! best, never the best.

pub(in crate::kessler) mod ahead;
mod avoid;
pub(in crate::kessler) mod formation;
pub(in crate::kessler) mod judge;
pub mod panel;
pub(in crate::kessler) mod table;
mod thrift;
pub(in crate::kessler) mod transfer;

use self::judge::judge;
use self::table::{Path, Table};
use super::constants::SATELLITES;
use super::reward::Objective;
use super::setup::{Contact, Setup};
use crate::bracket::{Bracket, Flown};
use crate::chance::Seeded;
use crate::error::ScenarioError;
use crate::log::{ActionLog, Precision};
use crate::scenario::Scenario;

/// Version of the planner: any change that moves a bracket raises it.
pub const VERSION: u32 = 1;
/// The same under `risk: pc`, where it plans by other rules. 2: burns that gain nothing are left out.
pub const VERSION_UNDER_PC: u32 = 2;

/// Panel, floor, reference and witness. `wanted` is asked between trials of the search: once it says no, what comes back
/// is whatever was found by then.
///
/// The effort is bounded by counts of trials, the same for every scenario, each of at most 50 steps against every body:
/// 400 single burns a step up to the threat and 3 000 schedules per satellite, and what transfer and formation add.
///
/// # Errors
/// A scenario whose start is not fair.
pub fn bracket(
    objective: Objective,
    scenario: &Scenario,
    wanted: &dyn Fn() -> bool,
) -> Result<Bracket, ScenarioError> {
    let setup = Setup::read(scenario.recipe())?;
    let mut chance = Seeded::new(scenario.seed());
    let start = setup.start(&mut chance)?;
    let table = Table::of(&setup, &start);
    let judged = |paths: [&Path; SATELLITES]| judge(objective, &setup, scenario.seed(), &table, paths);

    let panels = start.satellites.map(|body| panel::fly(&table, body, setup.fuel));
    let flown: Vec<Flown> =
        (0..panel::PANEL).map(|i| judged([&panels[0][i], &panels[1][i], &panels[2][i]])).collect();

    let mut planned: [Path; SATELLITES] =
        std::array::from_fn(|i| avoid::search(objective, &table, &panels[i], &mut chance, wanted));
    if objective == Objective::Rendezvous {
        let (body, fuel) = (start.satellites[0], setup.fuel);
        planned[0] = transfer::search(&table, body, fuel, &planned[0], &mut chance, wanted);
    }
    if objective == Objective::Formation {
        planned = formation::search(&setup, scenario.seed(), &table, &panels, planned, &mut chance, wanted);
    }
    let planned_flown = judged([&planned[0], &planned[1], &planned[2]]);

    let best_blind =
        (0..panel::PANEL).rev().max_by(|&a, &b| flown[a].score.total_cmp(&flown[b].score)).unwrap_or(0);
    let (reference, paths) = if planned_flown.score >= flown[best_blind].score {
        (planned_flown, [&planned[0], &planned[1], &planned[2]])
    } else {
        (flown[best_blind], [&panels[0][best_blind], &panels[1][best_blind], &panels[2][best_blind]])
    };
    let floor = match objective {
        Objective::Survival | Objective::EcoStation => {
            flown.iter().map(|f| f.score).sum::<f64>() / panel::PANEL as f64
        }
        Objective::Rendezvous | Objective::Formation => flown[0].score,
    };
    let (planner, reference, witness) = if matches!(setup.physics.contact, Contact::Chance(_)) {
        let holds = [&panels[0][0], &panels[1][0], &panels[2][0]];
        let (reference, paths) = thrift::spare(&table, holds, paths, reference, judged);
        (VERSION_UNDER_PC, reference, witness(paths.each_ref(), reference.steps))
    } else {
        (VERSION, reference, witness(paths, reference.steps))
    };
    Ok(Bracket { planner, floor, witness, reference, panel: flown })
}

fn witness(paths: [&Path; SATELLITES], steps: u32) -> ActionLog {
    let mut log = ActionLog::new(2, Precision::F64);
    let mut next = [0; SATELLITES];
    for step in 1..=steps {
        for (i, path) in paths.iter().enumerate() {
            if let Some(burn) = path.burns.get(next[i]).filter(|b| b.step == step) {
                log.act(i as u32, &[burn.dvx, burn.dvy]);
                next[i] += 1;
            }
        }
        log.end_step();
    }
    log
}
