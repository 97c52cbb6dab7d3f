//! Episodes that run side by side have the bits of episodes that run alone, at every SIMD width.

use super::samples::{Draws, random_actions, recorded_setups, redraw};
use crate::tasking::setup::Setup;
use crate::tasking::simulation::{StepResult, TaskingSim, step_all};
use crate::tasking::tick::dispatch::InstructionSet;

/// Number of steps of each episode.
const STEPS: usize = 12;

/// Runs episodes one by one with random actions. Returns the hash after each step.
fn run_alone(setups: &[Setup], set: InstructionSet) -> Vec<Vec<[u8; 32]>> {
    setups
        .iter()
        .enumerate()
        .map(|(index, setup)| {
            let mut sim = TaskingSim::new(setup.clone()).unwrap();
            let mut draws = Draws::new(index as u64);
            (0..STEPS)
                .map(|_| {
                    let actions = random_actions(&sim, &mut draws);
                    sim.step(&actions, set).unwrap();
                    sim.state_hash()
                })
                .collect()
        })
        .collect()
}

/// Runs the same episodes side by side.
fn run_together(setups: &[Setup], set: InstructionSet) -> Vec<Vec<[u8; 32]>> {
    let mut sims: Vec<TaskingSim> =
        setups.iter().map(|setup| TaskingSim::new(setup.clone()).unwrap()).collect();
    let mut draws: Vec<Draws> = (0..sims.len()).map(|index| Draws::new(index as u64)).collect();
    let mut hashes = vec![Vec::new(); sims.len()];
    for _ in 0..STEPS {
        let actions: Vec<_> =
            sims.iter().zip(&mut draws).map(|(sim, draws)| random_actions(sim, draws)).collect();
        let results: Vec<StepResult> = step_all(&mut sims.iter_mut().collect::<Vec<_>>(), &actions, set)
            .into_iter()
            .map(|result| result.unwrap())
            .collect();
        assert_eq!(results.len(), sims.len());
        hashes.iter_mut().zip(&sims).for_each(|(hashes, sim)| hashes.push(sim.state_hash()));
    }
    hashes
}

/// Scenarios with one satellite of each recorded set-up, several of each.
fn setups(tick_s: f64, satellites: std::ops::RangeInclusive<usize>) -> Vec<Setup> {
    let mut draws = Draws::new(99);
    let wanted =
        |setup: &Setup| satellites.contains(&setup.agents.len()) && setup.clock.tick.seconds() == tick_s;
    let bases: Vec<Setup> = recorded_setups().into_iter().filter(wanted).collect();
    bases.iter().flat_map(|setup| [redraw(setup, &mut draws), redraw(setup, &mut draws)]).collect()
}

#[test]
fn lanes_have_the_bits_of_single_episodes() {
    for (tick_s, satellites, least) in [(1.0, 1..=1, 20), (1.0, 2..=4, 10), (0.5, 1..=4, 4), (5.0, 1..=4, 4)]
    {
        let setups = setups(tick_s, satellites);
        assert!(setups.len() >= least, "{}", setups.len());
        let alone = run_alone(&setups, InstructionSet::Scalar);
        for set in InstructionSet::all() {
            assert_eq!(run_together(&setups, set), alone, "{}", set.name());
        }
    }
}

#[test]
fn an_episode_has_the_same_bits_beside_others() {
    let setups = setups(1.0, 1..=1);
    let all = run_together(&setups, InstructionSet::detect());
    for (from, to) in [(0, 1), (3, 8), (5, 14)] {
        let alone = run_alone(&setups[..to], InstructionSet::detect());
        assert_eq!(all[from..to], alone[from..to]);
    }
}

#[test]
fn more_than_eight_satellites_have_the_bits_of_fewer_blocks() {
    let base = setups(1.0, 4..=4).swap_remove(0);
    let mut large = base.clone();
    let mut draws = Draws::new(5);
    while large.agents.len() < 11 {
        large.agents.extend(redraw(&base, &mut draws).agents);
    }
    large.agents.truncate(11);
    let hashes: Vec<_> =
        InstructionSet::all().into_iter().map(|set| run_alone(std::slice::from_ref(&large), set)).collect();
    assert!(hashes.iter().all(|other| *other == hashes[0]));
}

#[test]
fn episodes_with_ticks_of_different_lengths_share_a_batch() {
    let mut mixed = setups(1.0, 1..=1);
    mixed.truncate(4);
    let mut others = setups(5.0, 1..=4);
    others.truncate(4);
    assert!(mixed.len() == 4 && others.len() == 4);
    mixed = mixed.into_iter().zip(others).flat_map(|(one, five)| [one, five]).collect();
    let set = InstructionSet::detect();
    assert!(run_together(&mixed, set) == run_alone(&mixed, set));
}
