//! A batch does what its environments do one by one: to the bit, at any size, thread count and reset mode.

use std::sync::Arc;

use proptest::prelude::*;

use super::*;
use crate::chance::{Chance, Seeded, Stream};
use crate::log::JointAction;
use crate::task::{Episode, StepReport};

/// A batch with the buffers it writes.
struct Flying {
    batch: Box<dyn Batch>,
    shape: Shape,
    buffers: Buffers,
}

const ALL: Observe = Observe::All { bodies: None };

impl Flying {
    /// Buffers begin with what no batch writes, so that a cell that is left out shows.
    fn new(recipe: &Arc<Recipe>, envs: usize, autoreset: Autoreset) -> Self {
        let config = BatchConfig::new(envs, autoreset, ALL);
        let feed = Box::new(Seeds::new(Arc::clone(recipe), 5));
        let mut batch = recipe.task().batch(feed, config).unwrap();
        let shape = batch.shape();
        let mut buffers = Buffers::new(shape, autoreset);
        let Buffers { observations, final_observations, rewards, team_rewards, .. } = &mut buffers;
        for buffer in [&mut *observations, final_observations, rewards, team_rewards] {
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

/// What slot `slot` does in its step `step`: a function of both, whatever the batch.
fn action(slot: usize, step: usize, width: usize) -> Vec<f32> {
    let mut chance = Seeded::new(Seed::user((slot * 100_000 + step) as u64).unwrap());
    (0..width)
        .map(|_| {
            if chance.uniform(Stream::Policy) < 0.5 {
                0.0
            } else {
                chance.uniform(Stream::Policy) as f32 - 0.5
            }
        })
        .collect()
}

/// One environment flown by the same actions through the contract every world answers to.
struct Single {
    episode: Box<dyn Episode>,
    report: StepReport,
}

impl Single {
    fn start(scenario: &Scenario) -> Self {
        Self { episode: scenario.task().start(scenario).unwrap(), report: StepReport::default() }
    }

    fn step(&mut self, actions: &[f32], shape: Shape) {
        let agents: Vec<u32> = (0..shape.agents as u32).collect();
        let values: Vec<f64> = actions.iter().map(|&x| f64::from(x)).collect();
        self.episode.step(JointAction { agents: &agents, values: &values }, &mut self.report).unwrap();
    }
}

fn recipes() -> Vec<Arc<Recipe>> {
    let mut recipes = Vec::new();
    for task in crate::tasks() {
        for level in [0, 9] {
            recipes.push(Recipe::with_params(task, task.levels().params(level)).unwrap());
        }
        // Every choice of every option that can be had alone.
        for option in task.options() {
            for choice in &option.choices[1..] {
                let base = Recipe::with_params(task, task.levels().params(6)).unwrap();
                recipes.push(base.with_option(option.name, choice).unwrap());
            }
        }
    }
    recipes.into_iter().map(Arc::new).collect()
}

/// Every slot, stepped singly, gives the same bits and rewards, over more than one episode.
fn matches_single(recipe: &Arc<Recipe>, envs: usize, steps: usize) {
    let mut flying = Flying::new(recipe, envs, Autoreset::SameStep);
    let (shape, width) = (flying.shape, flying.width());
    let scenario = |flying: &Flying, env: usize| flying.batch.episode(env).unwrap().0;
    let mut singles: Vec<Single> = (0..envs).map(|env| Single::start(&scenario(&flying, env))).collect();
    for step in 0..steps {
        let actions: Vec<f32> = (0..envs).flat_map(|env| action(env, step, width)).collect();
        flying.step(&actions).unwrap();
        for (env, single) in singles.iter_mut().enumerate() {
            single.step(&actions[env * width..(env + 1) * width], shape);
            let told = &single.report;
            assert_eq!(flying.buffers.done[env], told.done, "{recipe:?} env {env} step {step}");
            assert_eq!(flying.buffers.team_rewards[env].to_bits(), (told.reward as f32).to_bits());
            for agent in &told.agents {
                let at = env * shape.agents + agent.agent as usize;
                assert_eq!(flying.buffers.rewards[at].to_bits(), (agent.reward as f32).to_bits());
                assert_eq!(
                    (flying.buffers.terminated[at], flying.buffers.truncated[at]),
                    (agent.terminated, agent.truncated)
                );
            }
            if told.done {
                *single = Single::start(&scenario(&flying, env));
            }
            assert_eq!(
                flying.batch.state_hash(env).unwrap(),
                single.episode.state_hash(),
                "{recipe:?} env {env} step {step}"
            );
        }
        assert!(flying.buffers.observations.iter().all(|x| x.is_finite()), "{recipe:?} step {step}");
    }
}

#[test]
fn a_batch_is_its_environments_one_by_one() {
    for recipe in recipes() {
        matches_single(&recipe, 3, 70);
    }
}

#[test]
fn size_and_threads_move_no_bit() {
    for task in ["kessler/rendezvous", "docking/multiagent"] {
        let Some(task) = crate::task(task) else { continue };
        let recipe = Arc::new(Recipe::with_params(task, task.levels().params(7)).unwrap());
        let fly = |envs: usize, threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut flying = Flying::new(&recipe, envs, Autoreset::NextStep);
            let width = flying.width();
            pool.install(|| {
                for step in 0..120 {
                    let actions: Vec<f32> = (0..envs).flat_map(|env| action(env, step, width)).collect();
                    flying.step(&actions).unwrap();
                }
            });
            let seen = flying.buffers.observations[..5 * flying.shape.observation].to_vec();
            let hashes: Vec<_> = (0..5).map(|env| flying.batch.state_hash(env).unwrap()).collect();
            (hashes, seen.iter().map(|x| x.to_bits()).collect::<Vec<_>>())
        };
        let alone = fly(5, 1);
        for (envs, threads) in [(5, 3), (64, 1), (64, 2), (333, 3)] {
            assert_eq!(fly(envs, threads), alone, "{envs} environments on {threads} threads");
        }
    }
}

/// Gymnasium's three modes, on an environment whose episodes are known to end at step 50.
#[test]
fn autoreset_modes_are_gymnasiums() {
    let task = crate::task("kessler/survival").unwrap();
    let recipe = Arc::new(Recipe::with_params(task, [("debris", 0.0)].into_iter()).unwrap());
    let hold = |flying: &Flying| vec![0.0; flying.shape.envs * flying.width()];
    for mode in [Autoreset::NextStep, Autoreset::SameStep, Autoreset::Disabled] {
        let mut flying = Flying::new(&recipe, 2, mode);
        let first = flying.buffers.observations.clone();
        for step in 1..=50 {
            let actions = hold(&flying);
            flying.step(&actions).unwrap();
            assert_eq!(flying.buffers.done, [step == 50; 2], "{mode:?} step {step}");
        }
        assert!(
            flying.buffers.truncated.iter().all(|&cut| cut)
                && flying.buffers.terminated.iter().all(|&left| !left)
        );
        let begun = |flying: &Flying| flying.batch.episode(0).unwrap().0;
        let actions = hold(&flying);
        match mode {
            Autoreset::NextStep => {
                let (before, last) = (begun(&flying), flying.buffers.observations.clone());
                flying.step(&actions).unwrap();
                assert_ne!(begun(&flying), before);
                assert_ne!(flying.buffers.observations, last);
                assert!(
                    flying.buffers.rewards.iter().all(|&r| r == 0.0)
                        && flying.buffers.truncated.iter().all(|&cut| !cut)
                );
                assert_eq!(flying.buffers.done, [false; 2]);
                flying.step(&actions).unwrap();
                assert!(flying.buffers.rewards.iter().all(|&r| r > 0.0));
            }
            Autoreset::SameStep => {
                // What is seen is the next start; what was seen last stands beside it.
                assert_ne!(flying.buffers.observations, flying.buffers.final_observations);
                assert!(flying.buffers.rewards.iter().all(|&r| r > 0.0));
                let mut again = vec![0.0; flying.buffers.observations.len()];
                flying.batch.reset(None, &mut again).unwrap();
                assert_ne!(again, flying.buffers.observations);
            }
            Autoreset::Disabled => {
                assert_eq!(flying.step(&actions), Err(BatchError::Ended { env: 0 }));
                flying.batch.reset(Some(&[true, false]), &mut flying.buffers.observations).unwrap();
                assert_eq!(flying.step(&actions), Err(BatchError::Ended { env: 1 }));
            }
        }
        assert_ne!(flying.buffers.observations, first);
    }
}

/// Slots 5 and 40 are given a scenario of another task after their first.
struct Broken {
    good: Seeds,
    bad: Arc<Recipe>,
}

impl Feed for Broken {
    fn scenario(&self, slot: usize, number: u64) -> (Arc<Recipe>, Seed) {
        let (recipe, seed) = self.good.scenario(slot, number);
        if number == 1 && [5, 40].contains(&slot) { (Arc::clone(&self.bad), seed) } else { (recipe, seed) }
    }
}

/// A slot whose scenario cannot start stops nobody else: what has moved, and who is named, is the same on any threads.
#[test]
fn a_slot_that_cannot_start_holds_up_nobody() {
    let task = crate::task("kessler/survival").unwrap();
    let recipe = Arc::new(Recipe::with_params(task, [("debris", 0.0)].into_iter()).unwrap());
    let bad = Arc::new(Recipe::new(crate::task("kessler/formation").unwrap()).unwrap());
    let fly = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let feed = Broken { good: Seeds::new(Arc::clone(&recipe), 5), bad: Arc::clone(&bad) };
        let config = BatchConfig::new(300, Autoreset::SameStep, ALL);
        let mut batch = task.batch(Box::new(feed), config).unwrap();
        let mut buffers = Buffers::new(batch.shape(), config.autoreset);
        batch.reset(None, &mut buffers.observations).unwrap();
        let actions = vec![0.1; 300 * batch.shape().agents * batch.shape().action];
        let mut told = Vec::new();
        pool.install(|| {
            for _ in 0..50 {
                told.push(batch.step(&actions, buffers.output()));
            }
            told.push(batch.reset(None, &mut buffers.observations));
        });
        let hashes: Vec<_> = (0..300).map(|env| batch.state_hash(env).unwrap()).collect();
        (told, hashes)
    };
    let config = BatchConfig::new(3, Autoreset::SameStep, ALL);
    let first = task.batch(Box::new(Seeds::new(Arc::clone(&bad), 5)), config).err().unwrap();
    assert_eq!(
        first.to_string(),
        r#"environment 0: task is "kessler/formation"; choose one of kessler/survival"#
    );
    let (told, hashes) = fly(1);
    assert!(told[..49].iter().all(Result::is_ok) && told[50].is_ok());
    assert!(matches!(told[49], Err(BatchError::Scenario { env: 5, .. })), "{:?}", told[49]);
    for threads in [2, 3] {
        assert!((told.clone(), hashes.clone()) == fly(threads), "{threads} threads");
    }
}

/// As many scenarios as are left, whoever asks.
struct Scarce {
    good: Seeds,
    left: Arc<std::sync::Mutex<[u32; 3]>>,
}

impl Feed for Scarce {
    fn scenario(&self, slot: usize, number: u64) -> (Arc<Recipe>, Seed) {
        self.left.lock().unwrap()[slot] -= 1;
        self.good.scenario(slot, number)
    }

    fn has(&self, slot: usize) -> bool {
        self.left.lock().unwrap()[slot] > 0
    }
}

#[test]
fn a_slot_for_which_there_is_nothing_rests() {
    let task = crate::task("kessler/survival").unwrap();
    let recipe = Arc::new(Recipe::with_params(task, [("debris", 0.0)].into_iter()).unwrap());
    for autoreset in [Autoreset::NextStep, Autoreset::SameStep, Autoreset::Disabled] {
        // One more for slot 0: what the batch reads its first recipe from.
        let left = Arc::new(std::sync::Mutex::new([2, 0, 2]));
        let feed = Scarce { good: Seeds::new(Arc::clone(&recipe), 5), left: Arc::clone(&left) };
        let mut batch = task.batch(Box::new(feed), BatchConfig::new(3, autoreset, ALL)).unwrap();
        let mut buffers = Buffers::new(batch.shape(), autoreset);
        buffers.observations.fill(f32::NAN);
        batch.reset(None, &mut buffers.observations).unwrap();
        let (actions, width) = (vec![0.0; 3 * 6], batch.shape().observation);
        assert_eq!([0, 1, 2].map(|env| batch.rests(env)), [false, true, false]);
        assert!(
            buffers.observations[width..2 * width].iter().all(|x| *x == 0.0) && batch.episode(1).is_none()
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
        assert_eq!([0, 1, 2].map(|env| batch.rests(env)), [true, true, false], "{autoreset:?}");
        let mut gone = [false; 3];
        batch.absent(0, &mut gone);
        assert_eq!(gone, [true; 3]);
        assert!(batch.step(&actions, buffers.output()).is_ok(), "who rests can be stepped");
        // Where there is something again it is begun.
        left.lock().unwrap()[1] = 1;
        if autoreset != Autoreset::Disabled {
            batch.step(&actions, buffers.output()).unwrap();
            assert!(!batch.rests(1), "{autoreset:?}");
        }
    }
}

#[test]
fn what_is_wrong_is_said_and_moves_nothing() {
    let task = crate::task("kessler/survival").unwrap();
    let recipe = Arc::new(Recipe::new(task).unwrap());
    let mut flying = Flying::new(&recipe, 2, Autoreset::NextStep);
    let before = flying.batch.state_hash(1);
    let mut actions = vec![0.0; 12];
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        actions[8] = bad;
        assert_eq!(flying.step(&actions), Err(BatchError::NotFinite { env: 1, agent: 1 }));
    }
    let error = flying.step(&actions[..11]).unwrap_err();
    assert_eq!(error.to_string(), "actions holds 11 values, not 12");
    flying.buffers.done.pop();
    actions[8] = 0.0;
    assert_eq!(flying.step(&actions).unwrap_err().to_string(), "done holds 1 values, not 2");
    assert_eq!(flying.batch.state_hash(1), before);
    let config = |envs| BatchConfig::new(envs, Autoreset::NextStep, ALL);
    let wrong = |envs| task.batch(Box::new(Seeds::new(Arc::clone(&recipe), 0)), config(envs)).err().unwrap();
    assert_eq!(wrong(0).to_string(), "envs is 0, outside 1 to 1048576");
    assert_eq!(
        wrong(MAX_ENVS + 1),
        BatchError::Config { field: "envs", value: MAX_ENVS + 1, min: 1, max: MAX_ENVS }
    );
    assert!(wrong_mask(&recipe).contains("mask holds 1 values, not 2"));
}

fn wrong_mask(recipe: &Arc<Recipe>) -> String {
    let mut flying = Flying::new(recipe, 2, Autoreset::Disabled);
    flying.batch.reset(Some(&[true]), &mut flying.buffers.observations).unwrap_err().to_string()
}

#[test]
fn nothing_is_allocated_after_the_first_episodes() {
    for task in crate::tasks() {
        let recipe = Arc::new(Recipe::with_params(task, task.levels().params(8)).unwrap());
        let mut flying = Flying::new(&recipe, 4, Autoreset::SameStep);
        let actions: Vec<f32> = (0..4).flat_map(|env| action(env, 1, flying.width())).collect();
        // Memory grows to what the largest of the first episodes needs.
        for _ in 0..2500 {
            flying.step(&actions).unwrap();
        }
        let counted = allocation_counter::measure(|| {
            for _ in 0..200 {
                flying.step(&actions).unwrap();
            }
        });
        assert_eq!(counted.count_total, 0, "{}", task.id());
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Slots get scenarios of their own, all of them a user's.
    #[test]
    fn seeds_are_a_function_of_slot_and_number(seed: u64, slot in 0usize..1 << 20, number in 0u64..1 << 40) {
        let recipe = Arc::new(Recipe::new(crate::task("kessler/survival").unwrap()).unwrap());
        let feed = Seeds::new(Arc::clone(&recipe), seed);
        let (_, one) = feed.scenario(slot, number);
        prop_assert_eq!(feed.scenario(slot, number).1, one);
        prop_assert_ne!(feed.scenario(slot + 1, number).1, one);
        prop_assert_ne!(feed.scenario(slot, number + 1).1, one);
        prop_assert_ne!(feed.scenario(slot + 1, number.wrapping_sub(1) & ((1 << 40) - 1)).1, one);
        prop_assert_eq!(one.space(), SeedSpace::User);
    }
}
