//! The tables of levels, measured.

use super::at_level;
use crate::bracket::{SuccessRule, admit, success};
use crate::docking::TASKS;
use crate::rollout::fly;
use crate::space::Harder;
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

/// The ends of the tables, cheaply: the planner wins everywhere, hold nowhere, the pilot at first and seldom at last. The
/// numbers in `docs/docking.md` (pilot 1.0 at L0, 0.24 and 0.11 at L9, of 300) leave these bounds far behind.
#[test]
fn regress_levels_run_from_easy_to_hard() {
    for task in &TASKS {
        let (easy, hard) = (measure(task, 0, 12), measure(task, 9, 12));
        assert_eq!((easy[0], easy[5], easy[1], hard[1]), (1.0, 1.0, 0.0, 0.0), "{}", task.id());
        assert!(hard[0] >= 0.5 && hard[5] <= 0.6, "{}: {hard:?}", task.id());
    }
}

/// Every lever of a table moves in its harder direction, or stays.
#[test]
fn levels_never_get_easier() {
    for task in &TASKS {
        for level in 1..task.levels().len() {
            for ((name, before), (_, now)) in task.levels().params(level - 1).zip(task.levels().params(level))
            {
                let spec = task.params().iter().find(|spec| spec.name == name).unwrap();
                let harder = if spec.harder == Harder::Up { now >= before } else { now <= before };
                assert!(harder, "{} L{level}: {name} {before} → {now}", task.id());
            }
        }
    }
}
