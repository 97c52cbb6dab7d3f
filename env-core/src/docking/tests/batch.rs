//! Batches whose scenarios have different numbers of deputies.

use std::sync::Arc;

use crate::batch::{
    Autoreset, Batch, BatchBuffers, BatchConfig, BatchError, ObservationMode, ScenarioSource, SeedSequence,
};
use crate::docking::DOCKING_TASKS;
use crate::docking::constants::OBSERVATION_DIM;
use crate::log::JointAction;
use crate::seed::Seed;
use crate::task::{Episode, Recipe, Scenario, StepReport, TaskSpec};

/// Source whose j-th scenario of slot k has recipe k + j.
struct RecipeCycle(Vec<Arc<Recipe>>);

impl ScenarioSource for RecipeCycle {
    fn scenario(&self, slot: usize, number: u64) -> Scenario {
        let index = slot + number as usize;
        Scenario::new(Arc::clone(&self.0[index % self.0.len()]), Seed::user(index as u64).unwrap())
    }
}

fn recipe(task: &'static dyn TaskSpec, params: &[(&str, f64)]) -> Arc<Recipe> {
    Arc::new(Recipe::with_params(task, params.iter().copied()).unwrap())
}

fn recipes_with_deputies(deputies: &[f64]) -> Box<RecipeCycle> {
    let with_deputies = |&count| recipe(&DOCKING_TASKS[1], &[("deputies", count), ("time_limit_s", 20.0)]);
    Box::new(RecipeCycle(deputies.iter().map(with_deputies).collect()))
}

const fn config(envs: usize, autoreset: Autoreset) -> BatchConfig {
    BatchConfig::new(envs, autoreset, ObservationMode::All { bodies: None })
}

fn scenario(batch: &dyn Batch, env: usize) -> Scenario {
    batch.running_episode(env).unwrap().scenario
}

fn deputy_count(batch: &dyn Batch, env: usize) -> usize {
    scenario(batch, env).recipe().param("deputies").unwrap() as usize
}

/// A batch has room for all deputies that a recipe may have, whatever its first scenario has. Absent deputies are terminated
/// from the start, with zero rewards and observations; the others equal those of single environments.
#[test]
fn scenarios_can_have_more_deputies_than_the_first() {
    let mut batch = DOCKING_TASKS[1]
        .batch(recipes_with_deputies(&[1.0, 2.0, 5.0, 3.0]), config(3, Autoreset::SameStep))
        .unwrap();
    let shape = batch.shape();
    assert_eq!((shape.agents, shape.observation), (5, 5 * OBSERVATION_DIM));
    let mut buffers = BatchBuffers::new(shape, Autoreset::SameStep);
    batch.reset(None, &mut buffers.observations).unwrap();
    let start = |batch: &dyn Batch, env| -> Box<dyn Episode> {
        DOCKING_TASKS[1].start(&scenario(batch, env)).unwrap()
    };
    let mut singles: Vec<_> = (0..3).map(|env| start(batch.as_ref(), env)).collect();
    let mut report = StepReport::default();
    let mut max_count = 0;
    for step in 0..100 {
        let actions: Vec<f32> = (0..3 * 15).map(|i| ((i * 7 + step) % 11) as f32 / 5.0 - 1.0).collect();
        let counts = [0, 1, 2].map(|env| deputy_count(batch.as_ref(), env));
        batch.step(&actions, buffers.output()).unwrap();
        for (env, count) in counts.into_iter().enumerate() {
            let agents: Vec<u32> = (0..count as u32).collect();
            let mine = &actions[env * 15..env * 15 + count * 3];
            let values: Vec<f64> = mine.iter().map(|&x| f64::from(x)).collect();
            singles[env].step(JointAction { agents: &agents, values: &values }, &mut report).unwrap();
            assert_eq!(buffers.team_rewards[env].to_bits(), (report.reward as f32).to_bits());
            assert_eq!(buffers.done[env], report.done);
            for agent in 0..5 {
                let at = env * 5 + agent;
                let expected = report.agents.iter().find(|report| report.agent as usize == agent);
                let expected = expected.map_or((0.0, agent >= count, false), |report| {
                    (report.reward as f32, report.terminated, report.truncated)
                });
                let found = (buffers.rewards[at], buffers.terminated[at], buffers.truncated[at]);
                assert_eq!(found, expected, "step {step}, environment {env}, agent {agent}");
            }
            if report.done {
                singles[env] = start(batch.as_ref(), env);
            }
            assert_eq!(batch.state_hash(env).unwrap(), singles[env].state_hash());
            let count = deputy_count(batch.as_ref(), env);
            let row = &buffers.observations[env * shape.observation..][..shape.observation];
            let (present, absent) = row.split_at(count * OBSERVATION_DIM);
            assert!(present.iter().any(|&x| x != 0.0) && absent.iter().all(|&x| x == 0.0));
            max_count = max_count.max(count);
        }
    }
    assert_eq!(max_count, 5);
}

/// Otherwise a caller that counts active agents would count absent ones.
#[test]
fn resetting_step_marks_absent_deputies() {
    let mut batch =
        DOCKING_TASKS[1].batch(recipes_with_deputies(&[1.0, 3.0]), config(1, Autoreset::NextStep)).unwrap();
    let mut buffers = BatchBuffers::new(batch.shape(), Autoreset::NextStep);
    batch.reset(None, &mut buffers.observations).unwrap();
    let nothing = [0.0; 15];
    for present in [1, 3, 1] {
        assert_eq!(deputy_count(batch.as_ref(), 0), present);
        while !buffers.done[0] {
            batch.step(&nothing, buffers.output()).unwrap();
        }
        batch.step(&nothing, buffers.output()).unwrap();
        let expected: [bool; 5] = std::array::from_fn(|agent| agent >= 4 - present);
        assert_eq!((buffers.terminated.as_slice(), buffers.done[0]), (&expected[..], false));
    }
}

#[test]
fn single_recipe_allocates_only_its_deputies() {
    for (task, params, agents) in [
        (&DOCKING_TASKS[0], &[][..], 1),
        (&DOCKING_TASKS[1], &[][..], 3),
        (&DOCKING_TASKS[1], &[("deputies", 2.0)][..], 2),
    ] {
        let source = Box::new(SeedSequence::new(recipe(task, params), 4));
        assert_eq!(task.batch(source, config(2, Autoreset::SameStep)).unwrap().shape().agents, agents);
    }
    // `docking/single` has no such param: one deputy with any source.
    let source = Box::new(RecipeCycle(vec![recipe(&DOCKING_TASKS[0], &[])]));
    assert_eq!(DOCKING_TASKS[0].batch(source, config(2, Autoreset::SameStep)).unwrap().shape().agents, 1);
}

#[test]
fn recipe_of_another_task_is_rejected() {
    let (mine, other) = (recipe(&DOCKING_TASKS[1], &[]), recipe(&DOCKING_TASKS[0], &[]));
    let config = config(1, Autoreset::SameStep);
    let assert_names_task = |error: BatchError| {
        assert!(error.to_string().contains("docking/single"), "{error}");
    };
    let first = DOCKING_TASKS[1].batch(Box::new(RecipeCycle(vec![Arc::clone(&other)])), config);
    assert_names_task(first.err().unwrap());
    let mut batch = DOCKING_TASKS[1].batch(Box::new(RecipeCycle(vec![mine, other])), config).unwrap();
    let mut seen = vec![0.0; batch.shape().observation];
    batch.reset(None, &mut seen).unwrap();
    assert_names_task(batch.reset(None, &mut seen).err().unwrap());
}

/// An extended observation begins with the plain one, and its further values follow from state, time and bound.
#[test]
fn extended_observations_have_time_bound_and_directions() {
    let with_deputies = [("deputies", 2.0), ("time_limit_s", 300.0), ("thrust_bound", 0.25)];
    let source = || Box::new(SeedSequence::new(recipe(&DOCKING_TASKS[1], &with_deputies), 4));
    let extended = BatchConfig::new(3, Autoreset::SameStep, ObservationMode::Extended);
    let mut plain = DOCKING_TASKS[1].batch(source(), config(3, Autoreset::SameStep)).unwrap();
    let mut batch = DOCKING_TASKS[1].batch(source(), extended).unwrap();
    assert_eq!((batch.shape().observation, batch.columns().len()), (40, 40));
    assert_eq!(batch.parts()[0].shape, [2, 20]);
    let (mut short, mut long) = (
        BatchBuffers::new(plain.shape(), Autoreset::SameStep),
        BatchBuffers::new(batch.shape(), Autoreset::SameStep),
    );
    plain.reset(None, &mut short.observations).unwrap();
    batch.reset(None, &mut long.observations).unwrap();
    for step in 0..20 {
        for (eight, row) in short.observations.chunks_exact(8).zip(long.observations.chunks_exact(20)) {
            assert_eq!(row[..8], *eight);
            let further: Vec<f64> = row[8..].iter().map(|value| f64::from(*value)).collect();
            let position = [0, 1, 2].map(|axis| 100.0 * f64::from(eight[axis]));
            let distance = position.iter().map(|x| x * x).sum::<f64>().sqrt();
            let limit = f64::from(eight[7]).max(0.2);
            let along = (0..3).map(|axis| further[4 + axis] * further[7 + axis]).sum::<f64>();
            let expected = [
                (300.0 - f64::from(step)) / 500.0,
                1.0 - f64::from(step) / 300.0,
                libm::log(0.25) / 2.0,
                libm::log(distance) / 2.0 - 1.0,
                position[0] / distance,
                position[1] / distance,
                position[2] / distance,
                f64::from(eight[3]) * 0.5 / (2.0 * limit),
                f64::from(eight[4]) * 0.5 / (2.0 * limit),
                f64::from(eight[5]) * 0.5 / (2.0 * limit),
                f64::from(eight[6]) / (2.0 * limit),
                along,
            ];
            for (found, expected) in further.iter().zip(expected) {
                assert!((found - expected).abs() < 2e-6, "{found} {expected}");
            }
        }
        let actions = [0.1; 18];
        plain.step(&actions, short.output()).unwrap();
        batch.step(&actions, long.output()).unwrap();
    }
}
