//! Golden hashes: no later speed-up moves a bit.

use super::at_level;
use crate::chance::{Chance, Seeded, Stream};
use crate::docking::TASKS;
use crate::log::{ActionLog, Precision};
use crate::rollout::{fly, replay};
use crate::scenario::Scenario;
use crate::seed::Seed;
use crate::task::{StepReport, TaskSpec};

/// The pilot's thrusts, a tenth of them replaced by chance: long episodes with every kind of number in them.
fn disturbed(scenario: &Scenario, seed: u64) -> ActionLog {
    let mut pilot = scenario.task().policy("heuristic", scenario, 0).unwrap();
    let (_, flown) = fly(scenario, pilot.as_mut()).unwrap();
    let mut chance = Seeded::new(Seed::user(seed).unwrap());
    let mut log = ActionLog::new(3, Precision::F64);
    for step in flown.steps() {
        for (&agent, thrust) in step.agents.iter().zip(step.values.chunks_exact(3)) {
            if chance.uniform(Stream::Policy) < 0.1 {
                log.act(agent, &[0, 1, 2].map(|_| chance.between(Stream::Policy, -1.0, 1.0)));
            } else {
                log.act(agent, thrust);
            }
        }
        log.end_step();
    }
    log.stopped = Some(crate::Stopped::TooLate);
    log
}

#[test]
fn regress_golden_final_states() {
    let mut golden = Vec::new();
    for task in &TASKS {
        for level in [0, 3, 6, 9] {
            for seed in [1, 2] {
                let scenario = at_level(task.id(), level, seed);
                let log = disturbed(&scenario, seed);
                let mut episode = task.start(&scenario).unwrap();
                let mut report = StepReport::default();
                while !episode.done() {
                    episode.step(log.step(episode.steps() as usize), &mut report).unwrap();
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
        for level in [0, 4, 7, 9] {
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
