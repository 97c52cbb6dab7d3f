//! What follows the end of an episode: automatic resets, and slots without another scenario.

use std::sync::{Arc, Mutex};

use super::*;

/// Checks Gymnasium's three modes on an environment whose episodes end at step 50.
#[test]
fn autoreset_modes_match_gymnasium() {
    let task = crate::task("kessler/survival").unwrap();
    let recipe = Arc::new(Recipe::with_params(task, [("debris", 0.0)].into_iter()).unwrap());
    let hold = |test: &TestBatch| vec![0.0; test.shape.envs * test.width()];
    for mode in [Autoreset::NextStep, Autoreset::SameStep, Autoreset::Disabled] {
        let mut test = TestBatch::new(&recipe, 2, mode);
        let first = test.buffers.observations.clone();
        for step in 1..=50 {
            let actions = hold(&test);
            test.step(&actions).unwrap();
            assert_eq!(test.buffers.done, [step == 50; 2], "{mode:?} step {step}");
        }
        assert!(
            test.buffers.truncated.iter().all(|&cut| cut)
                && test.buffers.terminated.iter().all(|&left| !left)
        );
        let running = |test: &TestBatch| test.batch.running_episode(0).unwrap().scenario;
        let actions = hold(&test);
        match mode {
            Autoreset::NextStep => {
                let (before, last) = (running(&test), test.buffers.observations.clone());
                test.step(&actions).unwrap();
                assert_ne!(running(&test), before);
                assert_ne!(test.buffers.observations, last);
                assert!(
                    test.buffers.rewards.iter().all(|&r| r == 0.0)
                        && test.buffers.truncated.iter().all(|&cut| !cut)
                );
                assert_eq!(test.buffers.done, [false; 2]);
                assert_eq!(test.buffers.elapsed, [0.0; 2]);
                assert_eq!(test.buffers.needs_action, [true; 6]);
                test.step(&actions).unwrap();
                assert!(test.buffers.rewards.iter().all(|&r| r > 0.0));
            }
            Autoreset::SameStep => {
                // The observation is the next start; the last one is in the final observations.
                assert_ne!(test.buffers.observations, test.buffers.final_observations);
                assert!(test.buffers.rewards.iter().all(|&r| r > 0.0));
                let mut again = vec![0.0; test.buffers.observations.len()];
                test.batch.reset(None, &mut again).unwrap();
                assert_ne!(again, test.buffers.observations);
            }
            Autoreset::Disabled => {
                assert_eq!(test.step(&actions), Err(BatchError::Ended { env: 0 }));
                test.batch.reset(Some(&[true, false]), &mut test.buffers.observations).unwrap();
                assert_eq!(test.step(&actions), Err(BatchError::Ended { env: 1 }));
            }
        }
        assert_ne!(test.buffers.observations, first);
    }
}

/// Source with a limited number of scenarios for each slot.
struct LimitedSource {
    good: SeedSequence,
    left: Arc<Mutex<[u32; 3]>>,
}

impl ScenarioSource for LimitedSource {
    fn scenario(&self, slot: usize, number: u64) -> Scenario {
        self.left.lock().unwrap()[slot] -= 1;
        self.good.scenario(slot, number)
    }

    fn has_scenario(&self, slot: usize) -> bool {
        self.left.lock().unwrap()[slot] > 0
    }
}

#[test]
fn slot_without_scenario_is_idle() {
    let task = crate::task("kessler/survival").unwrap();
    let recipe = Arc::new(Recipe::with_params(task, [("debris", 0.0)].into_iter()).unwrap());
    for autoreset in [Autoreset::NextStep, Autoreset::SameStep, Autoreset::Disabled] {
        // One more for slot 0, since creating the batch reads its first recipe.
        let left = Arc::new(Mutex::new([2, 0, 2]));
        let source =
            LimitedSource { good: SeedSequence::new(Arc::clone(&recipe), 5), left: Arc::clone(&left) };
        let mut batch = task.batch(Box::new(source), BatchConfig::new(3, autoreset, ALL)).unwrap();
        let mut buffers = BatchBuffers::new(batch.shape(), autoreset);
        buffers.observations.fill(f32::NAN);
        batch.reset(None, &mut buffers.observations).unwrap();
        let (actions, width) = (vec![0.0; 3 * 6], batch.shape().observation);
        assert_eq!([0, 1, 2].map(|env| batch.is_idle(env)), [false, true, false]);
        assert!(
            buffers.observations[width..2 * width].iter().all(|x| *x == 0.0)
                && batch.running_episode(1).is_none()
        );
        for step in 1..=50 {
            batch.step(&actions, buffers.output()).unwrap();
            assert_eq!(buffers.done, [step == 50, false, step == 50]);
            assert_eq!((buffers.team_rewards[1], &buffers.terminated[3..6]), (0.0, &[true; 3][..]));
        }
        if autoreset == Autoreset::Disabled {
            assert_eq!(batch.step(&actions, buffers.output()), Err(BatchError::Ended { env: 0 }));
            batch.reset(None, &mut buffers.observations).unwrap();
        } else {
            batch.step(&actions, buffers.output()).unwrap();
        }
        assert_eq!([0, 1, 2].map(|env| batch.is_idle(env)), [true, true, false], "{autoreset:?}");
        let mut absent = [false; 3];
        batch.mark_absent_agents(0, &mut absent);
        assert_eq!(absent, [true; 3]);
        assert!(batch.step(&actions, buffers.output()).is_ok(), "idle environments can be stepped");
        // A new scenario starts in the next step.
        left.lock().unwrap()[1] = 1;
        if autoreset != Autoreset::Disabled {
            batch.step(&actions, buffers.output()).unwrap();
            assert!(!batch.is_idle(1), "{autoreset:?}");
        }
    }
}

/// Environments outside the mask of a step do not change, nor do their rows.
#[test]
fn masked_environments_wait() {
    for task in crate::tasks() {
        let recipe = Arc::new(Recipe::new(task).unwrap());
        let (mut all, mut some) = (
            TestBatch::new(&recipe, 3, Autoreset::SameStep),
            TestBatch::new(&recipe, 3, Autoreset::SameStep),
        );
        let width = all.width();
        for step in 0..6 {
            let actions: Vec<f32> = (0..3).flat_map(|slot| action(task, slot, step, width)).collect();
            all.step(&actions).unwrap();
            let before = some.buffers.clone();
            for mask in [[true, false, true], [false, true, false]] {
                let waiting = some.batch.state_hash(usize::from(mask[0]));
                some.batch.step_some(&actions, Some(&mask), some.buffers.output()).unwrap();
                assert_eq!(some.batch.state_hash(usize::from(mask[0])), waiting, "{}", task.id());
                if mask[0] {
                    assert_eq!(some.buffers.team_rewards[1].to_bits(), before.team_rewards[1].to_bits());
                }
            }
            assert_eq!(all.buffers.observations, some.buffers.observations, "{} step {step}", task.id());
            assert_eq!(all.buffers.team_rewards, some.buffers.team_rewards);
        }
        let actions = vec![task.action_space().hold; 3 * width];
        let wrong = some.batch.step_some(&actions, Some(&[true]), some.buffers.output());
        assert_eq!(wrong, Err(BatchError::Size { buffer: "mask", found: 1, wanted: 3 }));
    }
}
