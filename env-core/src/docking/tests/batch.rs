//! Batches whose scenarios have different numbers of deputies.

use std::sync::Arc;

use crate::batch::{Autoreset, Batch, BatchConfig, BatchError, Buffers, Feed, Observe, Seeds};
use crate::docking::TASKS;
use crate::docking::constants::OBSERVATION;
use crate::log::JointAction;
use crate::scenario::{Recipe, Scenario};
use crate::seed::Seed;
use crate::task::{Episode, StepReport, TaskSpec};

/// A curriculum: slot k's j-th scenario takes recipe k + j.
struct Curriculum(Vec<Arc<Recipe>>);

impl Feed for Curriculum {
    fn scenario(&self, slot: usize, number: u64) -> (Arc<Recipe>, Seed) {
        let turn = slot + number as usize;
        (Arc::clone(&self.0[turn % self.0.len()]), Seed::user(turn as u64).unwrap())
    }
}

fn recipe(task: &'static dyn TaskSpec, params: &[(&str, f64)]) -> Arc<Recipe> {
    Arc::new(Recipe::with_params(task, params.iter().copied()).unwrap())
}

fn curriculum(deputies: &[f64]) -> Box<Curriculum> {
    let of = |&count| recipe(&TASKS[1], &[("deputies", count), ("time_limit_s", 20.0)]);
    Box::new(Curriculum(deputies.iter().map(of).collect()))
}

const fn config(envs: usize, autoreset: Autoreset) -> BatchConfig {
    BatchConfig::new(envs, autoreset, Observe::All { bodies: None })
}

fn scenario(batch: &dyn Batch, env: usize) -> (Scenario, usize) {
    let scenario = batch.episode(env).unwrap().0;
    let count = scenario.recipe().param("deputies").unwrap() as usize;
    (scenario, count)
}

/// Whatever the first scenario has, there is room for all that a recipe may; who is absent has left from the start, earns
/// nothing and is seen as zeros; the others fly as they do singly.
#[test]
fn scenarios_with_more_deputies_than_the_first_fly() {
    let mut batch =
        TASKS[1].batch(curriculum(&[1.0, 2.0, 5.0, 3.0]), config(3, Autoreset::SameStep)).unwrap();
    let shape = batch.shape();
    assert_eq!((shape.agents, shape.observation), (5, 5 * OBSERVATION));
    let mut buffers = Buffers::new(shape, Autoreset::SameStep);
    batch.reset(None, &mut buffers.observations).unwrap();
    let start =
        |batch: &dyn Batch, env| -> Box<dyn Episode> { TASKS[1].start(&scenario(batch, env).0).unwrap() };
    let mut singles: Vec<_> = (0..3).map(|env| start(batch.as_ref(), env)).collect();
    let mut report = StepReport::default();
    let mut most = 0;
    for step in 0..100 {
        let actions: Vec<f32> = (0..3 * 15).map(|i| ((i * 7 + step) % 11) as f32 / 5.0 - 1.0).collect();
        let counts = [0, 1, 2].map(|env| scenario(batch.as_ref(), env).1);
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
                let told = report.agents.iter().find(|told| told.agent as usize == agent);
                let wanted = told.map_or((0.0, agent >= count, false), |told| {
                    (told.reward as f32, told.terminated, told.truncated)
                });
                let found = (buffers.rewards[at], buffers.terminated[at], buffers.truncated[at]);
                assert_eq!(found, wanted, "step {step}, environment {env}, agent {agent}");
            }
            if report.done {
                singles[env] = start(batch.as_ref(), env);
            }
            assert_eq!(batch.state_hash(env).unwrap(), singles[env].state_hash());
            let count = scenario(batch.as_ref(), env).1;
            let row = &buffers.observations[env * shape.observation..][..shape.observation];
            let (seen, absent) = row.split_at(count * OBSERVATION);
            assert!(seen.iter().any(|&x| x != 0.0) && absent.iter().all(|&x| x == 0.0));
            most = most.max(count);
        }
    }
    assert_eq!(most, 5);
}

/// The step that resets tells who is absent, so that whoever counts those that fly counts no empty seats.
#[test]
fn the_step_that_resets_tells_who_is_absent() {
    let mut batch = TASKS[1].batch(curriculum(&[1.0, 3.0]), config(1, Autoreset::NextStep)).unwrap();
    let mut buffers = Buffers::new(batch.shape(), Autoreset::NextStep);
    batch.reset(None, &mut buffers.observations).unwrap();
    let nothing = [0.0; 15];
    for flying in [1, 3, 1] {
        assert_eq!(scenario(batch.as_ref(), 0).1, flying);
        while !buffers.done[0] {
            batch.step(&nothing, buffers.output()).unwrap();
        }
        batch.step(&nothing, buffers.output()).unwrap();
        let wanted: [bool; 5] = std::array::from_fn(|agent| agent >= 4 - flying);
        assert_eq!((buffers.terminated.as_slice(), buffers.done[0]), (&wanted[..], false));
    }
}

/// One recipe needs no more room than its own deputies: no empty rows to write, to learn from, or to count.
#[test]
fn one_recipe_gets_the_room_it_needs() {
    for (task, params, agents) in
        [(&TASKS[0], &[][..], 1), (&TASKS[1], &[][..], 3), (&TASKS[1], &[("deputies", 2.0)][..], 2)]
    {
        let feed = Box::new(Seeds::new(recipe(task, params), 4));
        assert_eq!(task.batch(feed, config(2, Autoreset::SameStep)).unwrap().shape().agents, agents);
    }
    // There is no such param in single: one deputy, whoever feeds it.
    let feed = Box::new(Curriculum(vec![recipe(&TASKS[0], &[])]));
    assert_eq!(TASKS[0].batch(feed, config(2, Autoreset::SameStep)).unwrap().shape().agents, 1);
}

#[test]
fn another_tasks_recipe_is_refused_wherever_it_comes() {
    let (mine, other) = (recipe(&TASKS[1], &[]), recipe(&TASKS[0], &[]));
    let config = config(1, Autoreset::SameStep);
    let refused = |error: BatchError| {
        assert!(error.to_string().contains("docking/single"), "{error}");
    };
    let first = TASKS[1].batch(Box::new(Curriculum(vec![Arc::clone(&other)])), config);
    refused(first.err().unwrap());
    let mut batch = TASKS[1].batch(Box::new(Curriculum(vec![mine, other])), config).unwrap();
    let mut seen = vec![0.0; batch.shape().observation];
    batch.reset(None, &mut seen).unwrap();
    refused(batch.reset(None, &mut seen).err().unwrap());
}
