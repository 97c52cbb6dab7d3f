//! Observations of a batch equal those of a fresh encoder on the same episode stepped singly: to the bit, in
//! every step, through rogues, fragments, losses and resets, including the final observation of an episode.

use std::sync::Arc;

use crate::batch::{Autoreset, BatchBuffers, BatchConfig, ObservationMode, SeedSequence};
use crate::episode_rng::{EpisodeRng, RngStream, SeededRng};
use crate::kessler::setup::KesslerSetup;
use crate::kessler::simulation::KesslerSim;
use crate::kessler::tracks::TracksEncoder;
use crate::kessler::{KESSLER_TASKS, KesslerTask};
use crate::log::JointAction;
use crate::seed::Seed;
use crate::task::TaskSpec;
use crate::task::{Recipe, Scenario};

/// Number of environments of a batch.
const OBSERVED_ENVS: usize = 4;

fn start_sim(task: &KesslerTask, scenario: &Scenario) -> KesslerSim<SeededRng> {
    let setup = KesslerSetup::from_recipe(scenario.recipe()).unwrap();
    let mut rng = SeededRng::new(scenario.seed());
    let start = setup.draw_initial_state(&mut rng).unwrap();
    KesslerSim::new(task.objective(), setup, &start, rng)
}

fn fresh_observation(observe: ObservationMode, sim: &KesslerSim<SeededRng>, len: usize) -> Vec<u32> {
    let mut cells = vec![f32::NAN; len];
    match observe {
        ObservationMode::All { bodies } => sim.observe_into(&mut cells, bodies.unwrap() as usize),
        ObservationMode::Tracks { threats, look_ahead } => {
            TracksEncoder::new(threats as usize, look_ahead as usize).unwrap().write(sim, &mut cells);
        }
        ObservationMode::Extended => unreachable!("kessler has no extended observations"),
    }
    cells.into_iter().map(f32::to_bits).collect()
}

/// Steps a batch and its environments singly and compares the observations.
fn compare(task: &'static KesslerTask, recipe: Recipe, observe: ObservationMode) -> (usize, usize) {
    let config = BatchConfig::new(OBSERVED_ENVS, Autoreset::SameStep, observe);
    let mut batch = task.batch(Box::new(SeedSequence::new(recipe, 31)), config).unwrap();
    let shape = batch.shape();
    let mut buffers = BatchBuffers::new(shape, config.autoreset);
    buffers.observations.fill(f32::NAN);
    batch.reset(None, &mut buffers.observations).unwrap();
    let mut singles: Vec<_> = (0..OBSERVED_ENVS)
        .map(|env| start_sim(task, &batch.running_episode(env).unwrap().scenario))
        .collect();
    let mut rng = SeededRng::new(Seed::user(8).unwrap());
    let (mut events, mut resets) = (0, 0);
    let row = |cells: &[f32], env: usize| -> Vec<u32> {
        cells[env * shape.observation..][..shape.observation].iter().map(|x| x.to_bits()).collect()
    };
    for step in 0..130 {
        let actions: Vec<f32> =
            (0..OBSERVED_ENVS * 6).map(|_| rng.uniform_in(RngStream::Policy, -1.0, 1.0) as f32).collect();
        batch.step(&actions, buffers.output()).unwrap();
        for (env, single) in singles.iter_mut().enumerate() {
            let values: Vec<f64> = actions[env * 6..][..6].iter().map(|&x| f64::from(x)).collect();
            single.step(JointAction { agents: &[0, 1, 2], values: &values }).unwrap();
            events += single.events().len();
            if single.is_done() {
                let last = fresh_observation(observe, single, shape.observation);
                assert_eq!(
                    row(&buffers.final_observations, env),
                    last,
                    "final observation of {env} at {step}"
                );
                *single = start_sim(task, &batch.running_episode(env).unwrap().scenario);
                resets += 1;
            }
            let now = fresh_observation(observe, single, shape.observation);
            assert_eq!(row(&buffers.observations, env), now, "{} {env} at {step}", task.id());
        }
    }
    (events, resets)
}

#[test]
fn batch_observes_like_a_fresh_encoder() {
    for task in &KESSLER_TASKS {
        for (radar, choice) in
            [(300.0, ("contact", "swept")), (25.0, ("gravity", "j2")), (12.0, ("risk", "pc"))]
        {
            let params = [("debris", 40.0), ("rogue_probability", 0.2), ("radar_range", radar)];
            let recipe = Recipe::with_params(task, params.into_iter()).unwrap();
            let recipe = recipe.with_option(choice.0, choice.1).unwrap();
            for observe in [
                ObservationMode::All { bodies: Some(99) },
                ObservationMode::All { bodies: Some(20) },
                ObservationMode::Tracks { threats: 5, look_ahead: 12 },
            ] {
                let (events, resets) = compare(task, recipe.clone(), observe);
                assert!(events > 50 && resets >= 2 * OBSERVED_ENVS, "{events} events, {resets} resets");
            }
        }
    }
}

#[test]
fn invalid_observation_sizes_are_rejected() {
    let recipe = Arc::new(Recipe::new(&KESSLER_TASKS[0]).unwrap());
    let batch = |observe| {
        let config = BatchConfig::new(1, Autoreset::NextStep, observe);
        KESSLER_TASKS[0]
            .batch(Box::new(SeedSequence::new(Arc::clone(&recipe), 9)), config)
            .err()
            .unwrap()
            .to_string()
    };
    assert_eq!(
        batch(ObservationMode::Tracks { threats: 1001, look_ahead: 12 }),
        "threats must be from 0 to 1000, got 1001"
    );
    assert_eq!(
        batch(ObservationMode::All { bodies: Some(u32::MAX) }),
        "bodies must be from 0 to 1568, got 4294967295"
    );
}
