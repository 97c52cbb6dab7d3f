//! Golden hashes: no later speed-up moves a bit.

use super::at_level;
use crate::chance::{Chance, Seeded, Stream};
use crate::kessler::TASKS;
use crate::log::{ActionLog, Precision};
use crate::rollout::replay;
use crate::seed::Seed;
use crate::task::{StepReport, TaskSpec};

/// Burns on a third of the steps, from a seed.
fn scripted_log(seed: u64) -> ActionLog {
    let mut chance = Seeded::new(Seed::user(seed).unwrap());
    let mut log = ActionLog::new(2, Precision::F64);
    for _ in 0..50 {
        for satellite in 0..3 {
            if chance.uniform(Stream::Policy) < 0.33 {
                let burn = [0, 1].map(|_| chance.between(Stream::Policy, -0.2, 0.2));
                log.act(satellite, &burn);
            }
        }
        log.end_step();
    }
    log
}

#[test]
fn regress_golden_final_states() {
    let mut golden = Vec::new();
    for task in &TASKS {
        for level in [0, 3, 6, 9] {
            for seed in [1, 2] {
                let scenario = at_level(task.id(), level, seed);
                let log = scripted_log(seed);
                let mut episode = task.start(&scenario).unwrap();
                let mut report = StepReport::default();
                for action in log.steps() {
                    if !episode.done() {
                        episode.step(action, &mut report).unwrap();
                    }
                }
                let hash = blake3::Hash::from_bytes(episode.state_hash()).to_hex();
                golden.push(format!(
                    "{} L{level} seed {seed}: scenario {} steps {} total {:?} state {}",
                    task.id(),
                    &scenario.id().to_string()[..16],
                    episode.steps(),
                    episode.flown().total,
                    &hash[..16]
                ));
            }
        }
    }
    insta::assert_debug_snapshot!(golden);
}

/// Brackets rest on the planner's version: a change here without a new version is a mistake.
#[test]
fn regress_golden_brackets() {
    let mut golden = Vec::new();
    for task in &TASKS {
        for level in [0, 4, 7] {
            let scenario = at_level(task.id(), level, 11);
            let bracket = task.bracket(&scenario).unwrap();
            assert_eq!(replay(&scenario, &bracket.witness).unwrap(), bracket.reference);
            golden.push(format!(
                "v{} {} L{level}: hold {:?} floor {:?} reference {:?}",
                bracket.planner,
                task.id(),
                bracket.hold(),
                bracket.floor,
                bracket.reference.score
            ));
        }
    }
    insta::assert_debug_snapshot!(golden);
}
