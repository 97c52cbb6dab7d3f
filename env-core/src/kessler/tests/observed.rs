//! What a batch of kessler observes is what a fresh look at the same episode, flown singly, gives: to the bit, in every
//! step, through rogues, fragments, losses and resets, the last observation of an episode included.

use std::sync::Arc;

use crate::batch::{Autoreset, BatchConfig, Buffers, Observe, Seeds};
use crate::chance::{Chance, Seeded, Stream};
use crate::kessler::flight::Flight;
use crate::kessler::setup::Setup;
use crate::kessler::tracks::Tracks;
use crate::kessler::{Kessler, TASKS};
use crate::log::JointAction;
use crate::scenario::{Recipe, Scenario};
use crate::seed::Seed;
use crate::task::TaskSpec;

const ENVS: usize = 4;

fn start(task: &Kessler, scenario: &Scenario) -> Flight<Seeded> {
    let setup = Setup::read(scenario.recipe()).unwrap();
    let mut chance = Seeded::new(scenario.seed());
    let start = setup.start(&mut chance).unwrap();
    Flight::new(task.objective(), setup, &start, chance)
}

fn fresh(observe: Observe, flight: &Flight<Seeded>, len: usize) -> Vec<u32> {
    let mut seen = vec![f32::NAN; len];
    match observe {
        Observe::All { bodies } => flight.observe_into(&mut seen, bodies.unwrap() as usize),
        Observe::Tracks { threats, look_ahead } => {
            Tracks::new(threats as usize, look_ahead as usize).unwrap().write(flight, &mut seen);
        }
    }
    seen.into_iter().map(f32::to_bits).collect()
}

/// Flies a batch and its environments singly; how many rogues, fragments and resets there were.
fn compare(task: &'static Kessler, recipe: Recipe, observe: Observe) -> (usize, usize) {
    let config = BatchConfig::new(ENVS, Autoreset::SameStep, observe);
    let mut batch = task.batch(Box::new(Seeds::new(recipe, 31)), config).unwrap();
    let shape = batch.shape();
    let mut buffers = Buffers::new(shape, config.autoreset);
    buffers.observations.fill(f32::NAN);
    batch.reset(None, &mut buffers.observations).unwrap();
    let mut singles: Vec<_> = (0..ENVS).map(|env| start(task, &batch.episode(env).unwrap().0)).collect();
    let mut chance = Seeded::new(Seed::user(8).unwrap());
    let (mut events, mut resets) = (0, 0);
    let row = |cells: &[f32], env: usize| -> Vec<u32> {
        cells[env * shape.observation..][..shape.observation].iter().map(|x| x.to_bits()).collect()
    };
    for step in 0..130 {
        let actions: Vec<f32> =
            (0..ENVS * 6).map(|_| chance.between(Stream::Policy, -1.0, 1.0) as f32).collect();
        batch.step(&actions, buffers.output()).unwrap();
        for (env, single) in singles.iter_mut().enumerate() {
            let values: Vec<f64> = actions[env * 6..][..6].iter().map(|&x| f64::from(x)).collect();
            single.step(JointAction { agents: &[0, 1, 2], values: &values }).unwrap();
            events += single.events().len();
            if single.done() {
                let last = fresh(observe, single, shape.observation);
                assert_eq!(row(&buffers.final_observations, env), last, "the last of {env} at {step}");
                *single = start(task, &batch.episode(env).unwrap().0);
                resets += 1;
            }
            let now = fresh(observe, single, shape.observation);
            assert_eq!(row(&buffers.observations, env), now, "{} {env} at {step}", task.id());
        }
    }
    (events, resets)
}

#[test]
fn a_batch_sees_what_a_fresh_look_sees() {
    for task in &TASKS {
        for (radar, choice) in
            [(300.0, ("contact", "swept")), (25.0, ("gravity", "j2")), (12.0, ("risk", "pc"))]
        {
            let params = [("debris", 40.0), ("rogue_probability", 0.2), ("radar_range", radar)];
            let recipe = Recipe::with_params(task, params.into_iter()).unwrap();
            let recipe = recipe.with_option(choice.0, choice.1).unwrap();
            for observe in [
                Observe::All { bodies: Some(99) },
                Observe::All { bodies: Some(20) },
                Observe::Tracks { threats: 5, look_ahead: 12 },
            ] {
                let (events, resets) = compare(task, recipe.clone(), observe);
                assert!(events > 50 && resets >= 2 * ENVS, "{events} events, {resets} resets");
            }
        }
    }
}

#[test]
fn what_a_batch_cannot_observe() {
    let recipe = Arc::new(Recipe::new(&TASKS[0]).unwrap());
    let batch = |observe| {
        let config = BatchConfig::new(1, Autoreset::NextStep, observe);
        TASKS[0].batch(Box::new(Seeds::new(Arc::clone(&recipe), 9)), config).err().unwrap().to_string()
    };
    assert_eq!(
        batch(Observe::Tracks { threats: 1001, look_ahead: 12 }),
        "threats is 1001, outside 0 to 1000"
    );
    assert_eq!(batch(Observe::All { bodies: Some(u32::MAX) }), "bodies is 4294967295, outside 0 to 1568");
}
