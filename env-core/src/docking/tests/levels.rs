//! The tables of levels, measured.

use super::at_level;
use crate::bracket::{SuccessRule, admit, success};
use crate::docking::TASKS;
use crate::rollout::fly;
use crate::task::TaskSpec;

/// Share of contested scenarios, and on those of successes, for each policy of interest, over `n` scenarios a level.
fn measure(task: &dyn TaskSpec, level: usize, n: u64) -> [f64; 6] {
    let (mut contested, mut wins) = (0.0, [0.0; 5]);
    for seed in 0..n {
        let scenario = at_level(task.id(), level, 1000 + seed);
        let admission = admit(&scenario);
        if !admission.contested {
            continue;
        }
        contested += 1.0;
        let bracket = admission.bracket.unwrap();
        for (win, name) in wins.iter_mut().zip(["hold", "blind", "random", "frozen", "heuristic"]) {
            let mut policy = task.policy(name, &scenario, seed).unwrap();
            let (flown, _) = fly(&scenario, policy.as_mut()).unwrap();
            *win += f64::from(u8::from(success(&scenario, SuccessRule::Task, &bracket, &flown)));
        }
    }
    let share = |win: f64| if contested > 0.0 { win / contested } else { 0.0 };
    let [hold, blind, random, frozen, heuristic] = wins.map(share);
    [contested / n as f64, hold, blind, random, frozen, heuristic]
}

#[test]
#[ignore = "prints the measured tables of docs/docking.md"]
fn measures_the_levels() {
    let n = std::env::var("SCENARIOS").ok().and_then(|n| n.parse().ok()).unwrap_or(200);
    for task in &TASKS {
        println!("{}: contested, hold, blind, random, frozen, heuristic", task.id());
        for level in 0..task.levels().len() {
            println!("L{level} {:.2?}", measure(task, level, n));
        }
    }
}
