//! What the levels are worth, measured: printed for `docs/kessler.md`, not asserted.

use super::at_level;
use crate::bracket::{admit, panel_success, success};
use crate::kessler::TASKS;
use crate::kessler::planner::panel::PANEL;
use crate::rollout::fly;
use crate::{SuccessRule, TaskSpec};

/// Contested scenarios a cell.
const CELL: usize = 200;
/// Scenarios looked at for them.
const MOST: u64 = 2000;

#[test]
#[ignore = "prints the measured table of docs/kessler.md"]
fn measures_the_levels() {
    let only = std::env::var("TASK").ok();
    for task in TASKS.iter().filter(|task| only.as_ref().is_none_or(|only| task.id() == only)) {
        println!("{}: level, heuristic, hold, blind panel, contested, solvable of all drawn", task.id());
        for level in 0..10 {
            let (mut drawn, mut solvable, mut found) = (0, 0, 0);
            let (mut pilot, mut hold, mut blind) = (0, 0, 0);
            for seed in 0..MOST {
                if found == CELL {
                    break;
                }
                let scenario = at_level(task.id(), level, 7_000_000 + seed);
                let admission = admit(&scenario);
                drawn += 1;
                solvable += usize::from(admission.solvable);
                let Some(bracket) = admission.bracket.filter(|_| admission.contested) else { continue };
                found += 1;
                let succeeds = |name: &str| {
                    let mut policy = task.policy(name, &scenario, 1).unwrap();
                    let (flown, _) = fly(&scenario, &mut *policy).unwrap();
                    usize::from(success(&scenario, SuccessRule::Task, &bracket, &flown))
                };
                pilot += succeeds("heuristic");
                hold += succeeds("hold");
                blind += panel_success(&scenario, &bracket);
            }
            let share = |part: usize, whole: usize| part as f64 / whole.max(1) as f64;
            println!(
                "L{level} {:.2} {:.2} {:.2} {:.2} {:.2}",
                share(pilot, found),
                share(hold, found),
                share(blind, found * PANEL),
                share(found, drawn),
                share(solvable, drawn)
            );
        }
    }
}
