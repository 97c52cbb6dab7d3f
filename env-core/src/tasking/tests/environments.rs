//! Scenarios of the environments.

use super::samples::{Draws, random_actions};
use crate::episode_rng::SeededRng;
use crate::seed::Seed;
use crate::tasking::environments::TaskingEnvironment;
use crate::tasking::simulation::TaskingSim;
use crate::tasking::tick::dispatch::InstructionSet;

/// Flies an episode of a seed with random actions. Returns the hash of its last state.
fn fly(environment: TaskingEnvironment, seed: u64) -> String {
    let mut rng = SeededRng::new(Seed::user(seed).unwrap());
    let mut sim = TaskingSim::new(environment.setup(&mut rng)).unwrap();
    let mut draws = Draws::new(seed);
    let mut observation = Vec::new();
    loop {
        for index in 0..sim.len() {
            observation.clear();
            sim.observe(index, &mut observation).unwrap();
            assert!(observation.iter().all(|value| value.is_finite()), "{observation:?}");
        }
        let actions = random_actions(&sim, &mut draws);
        let result = sim.step(&actions, InstructionSet::detect()).unwrap();
        if result.truncated || result.terminated.iter().all(|ended| *ended) {
            let hash = sim.state_hash();
            return hash[..8].iter().map(|byte| format!("{byte:02x}")).collect();
        }
    }
}

#[test]
fn episodes_keep_their_golden_hashes() {
    let flown: Vec<String> = TaskingEnvironment::defaults()
        .into_iter()
        .flat_map(|environment| {
            (0..3).map(move |seed| format!("{} {seed} {}", environment.id(), fly(environment, seed)))
        })
        .collect();
    insta::assert_snapshot!(flown.join("\n"));
}
