//! The tables of levels, measured with the built-in policies.

use super::at_level;
use crate::admission::{SuccessRule, admit, is_success};
use crate::docking::DOCKING_TASKS;
use crate::rollout::roll_out;
use crate::space::Harder;
use crate::task::TaskSpec;

/// Shares measured on scenarios of one level.
#[derive(Debug)]
struct LevelShares {
    contested: f64,
    /// Success rate of the hold policy on contested scenarios.
    hold: f64,
    /// Success rate of the heuristic policy on contested scenarios.
    heuristic: f64,
}

/// Measures `n` scenarios of a level.
fn measure(task: &dyn TaskSpec, level: usize, n: u64) -> LevelShares {
    let (mut contested, mut wins) = (0.0, [0.0; 2]);
    for seed in 0..n {
        let scenario = at_level(task.id(), level, 1000 + seed);
        let admission = admit(&scenario);
        if !admission.contested {
            continue;
        }
        contested += 1.0;
        let bracket = admission.bracket.unwrap();
        for (win, name) in wins.iter_mut().zip(["hold", "heuristic"]) {
            let mut policy = task.policy(name, &scenario, seed).unwrap();
            let outcome = roll_out(&scenario, policy.as_mut()).unwrap().outcome;
            *win += f64::from(u8::from(is_success(&scenario, SuccessRule::Task, &bracket, &outcome)));
        }
    }
    let share = |win: f64| if contested > 0.0 { win / contested } else { 0.0 };
    let [hold, heuristic] = wins.map(share);
    LevelShares { contested: contested / n as f64, hold, heuristic }
}

/// The heuristic policy always succeeds at the first level and seldom at the last; hold never does. The shares in
/// `docs/worlds/docking.md` (1.0 at level 0, 0.24 and 0.11 at level 9, of 300) are far within these bounds.
#[test]
fn regress_levels_range_from_easy_to_hard() {
    for task in &DOCKING_TASKS {
        let (easy, hard) = (measure(task, 0, 12), measure(task, 9, 12));
        assert_eq!(
            (easy.contested, easy.heuristic, easy.hold, hard.hold),
            (1.0, 1.0, 0.0, 0.0),
            "{}",
            task.id()
        );
        assert!(hard.contested >= 0.5 && hard.heuristic <= 0.6, "{}: {hard:?}", task.id());
    }
}

/// Every param of a table moves in its harder direction or stays.
#[test]
fn levels_never_get_easier() {
    for task in &DOCKING_TASKS {
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
