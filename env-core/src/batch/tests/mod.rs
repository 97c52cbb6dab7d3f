//! A batch equals its environments stepped one by one, to the bit, for any size, thread count and autoreset mode.

mod episode_ends;

use std::sync::Arc;

use proptest::prelude::*;

use super::*;
use crate::episode_rng::{EpisodeRng, RngStream, SeededRng};
use crate::log::{ActionLog, Precision};
use crate::space::{ActionKind, ActionSpace};
use crate::task::{Episode, StepReport, TaskSpec};

/// A batch with its buffers.
struct TestBatch {
    batch: Box<dyn Batch>,
    shape: BatchShape,
    buffers: BatchBuffers,
}

const ALL: ObservationMode = ObservationMode::All { bodies: None };

impl TestBatch {
    /// Creates a batch whose buffers are NaN, so that a cell that is not written shows.
    fn new(recipe: &Arc<Recipe>, envs: usize, autoreset: Autoreset) -> Self {
        let config = BatchConfig::new(envs, autoreset, ALL);
        let source = Box::new(SeedSequence::new(Arc::clone(recipe), 5));
        let mut batch = recipe.task().batch(source, config).unwrap();
        let shape = batch.shape();
        let mut buffers = BatchBuffers::new(shape, autoreset);
        let BatchBuffers { observations, final_observations, rewards, team_rewards, elapsed, .. } =
            &mut buffers;
        for buffer in [&mut *observations, final_observations, rewards, team_rewards, elapsed] {
            buffer.fill(f32::NAN);
        }
        batch.reset(None, observations).unwrap();
        Self { batch, shape, buffers }
    }

    fn step(&mut self, actions: &[f32]) -> Result<(), BatchError> {
        self.batch.step(actions, self.buffers.output())
    }

    fn width(&self) -> usize {
        self.shape.agents * self.shape.action
    }
}

/// The action of a slot in a step: a function of both, whatever the batch. Half of the values are those of hold.
fn action(task: &dyn TaskSpec, slot: usize, step: usize, width: usize) -> Vec<f32> {
    let mut rng = SeededRng::new(Seed::user((slot * 100_000 + step) as u64).unwrap());
    let space = task.action_space();
    (0..width)
        .map(|_| {
            if rng.uniform(RngStream::Policy) < 0.5 {
                return space.hold;
            }
            let draw = rng.uniform(RngStream::Policy) as f32;
            match space.kind {
                ActionKind::Box => draw - 0.5,
                ActionKind::Discrete { names } => (draw * names.len() as f32).floor(),
            }
        })
        .collect()
}

/// One environment that is stepped through the episode interface.
struct SingleEnv {
    episode: Box<dyn Episode>,
    report: StepReport,
}

impl SingleEnv {
    fn start(scenario: &Scenario) -> Self {
        Self { episode: scenario.task().start(scenario).unwrap(), report: StepReport::default() }
    }

    fn step(&mut self, space: &ActionSpace, actions: &[f32]) {
        let mut log = ActionLog::new(space.dim(), Precision::F32);
        log.push_by_agent(space, actions);
        self.episode.step(log.step(0), &mut self.report).unwrap();
    }
}

fn recipes() -> Vec<Arc<Recipe>> {
    let mut recipes = Vec::new();
    for task in crate::tasks() {
        for level in [0, 9] {
            recipes.push(Recipe::at_level(task, level).unwrap());
        }
        // Every choice of every option by itself.
        for option in task.options() {
            for choice in &option.choices[1..] {
                let base = Recipe::at_level(task, 6).unwrap();
                recipes.push(base.with_option(option.name, choice).unwrap());
            }
        }
    }
    recipes.into_iter().map(Arc::new).collect()
}

/// Checks that every slot gives the same bits and rewards as a single environment, over more than one episode.
fn check_against_single_envs(recipe: &Arc<Recipe>, envs: usize, steps: usize) {
    let mut test = TestBatch::new(recipe, envs, Autoreset::SameStep);
    let (shape, width, task) = (test.shape, test.width(), recipe.task());
    let space = task.action_space();
    let scenario = |test: &TestBatch, env: usize| test.batch.running_episode(env).unwrap().scenario;
    let mut singles: Vec<SingleEnv> = (0..envs).map(|env| SingleEnv::start(&scenario(&test, env))).collect();
    for step in 0..steps {
        let actions: Vec<f32> = (0..envs).flat_map(|env| action(task, env, step, width)).collect();
        test.step(&actions).unwrap();
        for (env, single) in singles.iter_mut().enumerate() {
            single.step(&space, &actions[env * width..(env + 1) * width]);
            let expected = &single.report;
            assert_eq!(test.buffers.done[env], expected.done, "{recipe:?} env {env} step {step}");
            assert_eq!(test.buffers.team_rewards[env].to_bits(), (expected.reward as f32).to_bits());
            assert_eq!(test.buffers.elapsed[env].to_bits(), (expected.elapsed as f32).to_bits());
            for agent in &expected.agents {
                let at = env * shape.agents + agent.agent as usize;
                assert_eq!(test.buffers.rewards[at].to_bits(), (agent.reward as f32).to_bits());
                assert_eq!(
                    (test.buffers.terminated[at], test.buffers.truncated[at], test.buffers.needs_action[at]),
                    (agent.terminated, agent.truncated, agent.needs_action || expected.done)
                );
            }
            if expected.done {
                *single = SingleEnv::start(&scenario(&test, env));
            }
            assert_eq!(
                test.batch.state_hash(env).unwrap(),
                single.episode.state_hash(),
                "{recipe:?} env {env} step {step}"
            );
        }
        assert!(test.buffers.observations.iter().all(|x| x.is_finite()), "{recipe:?} step {step}");
    }
}

#[test]
fn batch_equals_single_environments() {
    for recipe in recipes() {
        check_against_single_envs(&recipe, 3, 70);
    }
}

#[test]
fn size_and_threads_change_no_bit() {
    for task in ["kessler/rendezvous", "docking/multiagent", "tasking/scanning", "tasking/constellation"] {
        let Some(task) = crate::task(task) else { continue };
        let recipe = Arc::new(Recipe::at_level(task, 7).unwrap());
        let run = |envs: usize, threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut test = TestBatch::new(&recipe, envs, Autoreset::NextStep);
            let width = test.width();
            pool.install(|| {
                for step in 0..120 {
                    let actions: Vec<f32> =
                        (0..envs).flat_map(|env| action(task, env, step, width)).collect();
                    test.step(&actions).unwrap();
                }
            });
            let observations = test.buffers.observations[..5 * test.shape.observation].to_vec();
            let hashes: Vec<_> = (0..5).map(|env| test.batch.state_hash(env).unwrap()).collect();
            (hashes, observations.iter().map(|x| x.to_bits()).collect::<Vec<_>>())
        };
        let expected = run(5, 1);
        // A step of tasking takes a hundred times longer than one of the other worlds.
        let is_slow = task.id().starts_with("tasking/");
        let (many, most) = if is_slow { (16, 83) } else { (64, 333) };
        for (envs, threads) in [(5, 3), (many, 1), (many, 2), (most, 3)] {
            assert_eq!(run(envs, threads), expected, "{envs} environments on {threads} threads");
        }
    }
}

/// Source that gives slots 5 and 40 a scenario of another task after their first.
struct BrokenSource {
    good: SeedSequence,
    bad: Arc<Recipe>,
}

impl ScenarioSource for BrokenSource {
    fn scenario(&self, slot: usize, number: u64) -> Scenario {
        let good = self.good.scenario(slot, number);
        let is_bad = number == 1 && [5, 40].contains(&slot);
        if is_bad { Scenario::new(Arc::clone(&self.bad), good.seed()) } else { good }
    }
}

/// A slot whose scenario cannot start does not stop the others: state and error are the same for any thread count.
#[test]
fn failing_slot_does_not_stop_others() {
    let task = crate::task("kessler/survival").unwrap();
    let recipe = Arc::new(Recipe::with_params(task, [("debris", 0.0)].into_iter()).unwrap());
    let bad = Arc::new(Recipe::new(crate::task("kessler/formation").unwrap()).unwrap());
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let source = BrokenSource { good: SeedSequence::new(Arc::clone(&recipe), 5), bad: Arc::clone(&bad) };
        let config = BatchConfig::new(300, Autoreset::SameStep, ALL);
        let mut batch = task.batch(Box::new(source), config).unwrap();
        let mut buffers = BatchBuffers::new(batch.shape(), config.autoreset);
        batch.reset(None, &mut buffers.observations).unwrap();
        let actions = vec![0.1; 300 * batch.shape().agents * batch.shape().action];
        let mut results = Vec::new();
        pool.install(|| {
            for _ in 0..50 {
                results.push(batch.step(&actions, buffers.output()));
            }
            results.push(batch.reset(None, &mut buffers.observations));
        });
        let hashes: Vec<_> = (0..300).map(|env| batch.state_hash(env).unwrap()).collect();
        (results, hashes)
    };
    let config = BatchConfig::new(3, Autoreset::SameStep, ALL);
    let first = task.batch(Box::new(SeedSequence::new(Arc::clone(&bad), 5)), config).err().unwrap();
    assert_eq!(
        first.to_string(),
        r#"environment 0: task must be one of kessler/survival, got "kessler/formation""#
    );
    let (results, hashes) = run(1);
    assert!(results[..49].iter().all(Result::is_ok) && results[50].is_ok());
    assert!(matches!(results[49], Err(BatchError::Scenario { env: 5, .. })), "{:?}", results[49]);
    for threads in [2, 3] {
        assert!((results.clone(), hashes.clone()) == run(threads), "{threads} threads");
    }
}

#[test]
fn invalid_input_is_rejected_without_effect() {
    let task = crate::task("kessler/survival").unwrap();
    let recipe = Arc::new(Recipe::new(task).unwrap());
    let mut test = TestBatch::new(&recipe, 2, Autoreset::NextStep);
    let before = test.batch.state_hash(1);
    let mut actions = vec![0.0; 12];
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        actions[8] = bad;
        assert_eq!(test.step(&actions), Err(BatchError::NotFinite { env: 1, agent: 1 }));
    }
    let error = test.step(&actions[..11]).unwrap_err();
    assert_eq!(error.to_string(), "actions must have 12 values, got 11");
    test.buffers.done.pop();
    actions[8] = 0.0;
    assert_eq!(test.step(&actions).unwrap_err().to_string(), "done must have 2 values, got 1");
    assert_eq!(test.batch.state_hash(1), before);
    let config = |envs| BatchConfig::new(envs, Autoreset::NextStep, ALL);
    let error_for =
        |envs| task.batch(Box::new(SeedSequence::new(Arc::clone(&recipe), 0)), config(envs)).err().unwrap();
    assert_eq!(error_for(0).to_string(), "envs must be from 1 to 1048576, got 0");
    assert_eq!(
        error_for(MAX_ENVS + 1),
        BatchError::Config { field: "envs", value: MAX_ENVS + 1, min: 1, max: MAX_ENVS }
    );
    assert!(mask_error(&recipe).contains("mask must have 2 values, got 1"));
}

fn mask_error(recipe: &Arc<Recipe>) -> String {
    let mut test = TestBatch::new(recipe, 2, Autoreset::Disabled);
    test.batch.reset(Some(&[true]), &mut test.buffers.observations).unwrap_err().to_string()
}

#[test]
fn later_episodes_allocate_nothing() {
    for task in crate::tasks() {
        let recipe = Arc::new(Recipe::at_level(task, 8).unwrap());
        if task.time_limit_s(&recipe).is_some() {
            continue; // steps of minutes, whose cost allocations do not matter to
        }
        let mut test = TestBatch::new(&recipe, 4, Autoreset::SameStep);
        let actions: Vec<f32> = (0..4).flat_map(|env| action(task, env, 1, test.width())).collect();
        // Memory grows to the need of the largest of the first episodes.
        for _ in 0..2500 {
            test.step(&actions).unwrap();
        }
        let counted = allocation_counter::measure(|| {
            for _ in 0..200 {
                test.step(&actions).unwrap();
            }
        });
        assert_eq!(counted.count_total, 0, "{}", task.id());
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn seeds_are_unique_per_slot_and_number(seed: u64, slot in 0usize..1 << 20, number in 0u64..1 << 40) {
        let recipe = Arc::new(Recipe::new(crate::task("kessler/survival").unwrap()).unwrap());
        let sequence = SeedSequence::new(Arc::clone(&recipe), seed);
        let seed_of = |slot, number| sequence.scenario(slot, number).seed();
        let one = seed_of(slot, number);
        prop_assert_eq!(seed_of(slot, number), one);
        prop_assert_ne!(seed_of(slot + 1, number), one);
        prop_assert_ne!(seed_of(slot, number + 1), one);
        prop_assert_ne!(seed_of(slot + 1, number.wrapping_sub(1) & ((1 << 40) - 1)), one);
        prop_assert_eq!(one.space(), SeedSpace::User);
    }
}
