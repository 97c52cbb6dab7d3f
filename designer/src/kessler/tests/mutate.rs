//! Mutations of scenarios, of kessler and of docking.

use std::collections::BTreeSet;
use std::sync::Arc;

use env_core::episode_rng::SeededRng;
use env_core::kessler::kernel::Body;
use env_core::kessler::setup::{InitialState, KesslerSetup};
use env_core::keyed_rng::RngPurpose;
use env_core::{KeyedRng, Recipe, Scenario, Seed, SeedSpace, admission};

use crate::kessler::vocabulary::MAX_ENCOUNTERS;
use crate::{DesignBrief, mutate};

fn brief(task: &str, level: u32) -> DesignBrief {
    let spec = env_core::task(task).unwrap();
    let recipe = Recipe::at_level(spec, level as usize).unwrap();
    DesignBrief::new(Arc::new(recipe), 1, 0).at_level(spec.levels(), level)
}

fn training_scenario(brief: &DesignBrief, number: u64) -> Scenario {
    brief.scenario(Seed::in_space(SeedSpace::Training, number))
}

fn initial_state(scenario: &Scenario) -> InitialState {
    let setup = KesslerSetup::from_recipe(scenario.recipe()).unwrap();
    setup.draw_initial_state(&mut SeededRng::new(scenario.seed())).unwrap()
}

fn rng(number: u64) -> KeyedRng {
    KeyedRng::new(RngPurpose::Design, 3, number)
}

/// Number of bodies that are not among others.
fn count_new(bodies: &[Body], others: &[Body]) -> usize {
    bodies.iter().filter(|body| !others.contains(body)).count()
}

const TASKS: [&str; 4] =
    ["kessler/survival", "kessler/eco_station", "kessler/rendezvous", "kessler/formation"];

/// Names of all edits, as they are stored.
const EDITS: [&str; 11] = [
    "one passes at another time",
    "one has another speed",
    "one passes nearer or wider",
    "one more",
    "one less",
    "all pass earlier or later",
    "one goes for another satellite",
    "one appears out of nothing, or no longer does",
    "fuel",
    "radar range",
    "a first encounter",
];

#[test]
fn mutation_changes_few_bodies() {
    let (mut seen, mut mutated, mut max_added) = (BTreeSet::new(), 0, 0);
    for (task, level) in TASKS.iter().flat_map(|task| [0, 3, 6, 9].map(|level| (task, level))) {
        let brief = brief(task, level);
        for number in 0..40 {
            let parent = training_scenario(&brief, number);
            let Some(mutation) = mutate(&parent, &brief, &mut rng(number)) else { continue };
            mutated += 1;
            let repeated = mutate(&parent, &brief, &mut rng(number));
            assert_eq!(repeated.as_ref(), Some(&mutation), "the same draws give the same mutation");
            assert_ne!(mutation.scenario.id(), parent.id());
            assert!((1..=4).contains(&mutation.changes.len()), "{:?}", mutation.changes);
            let (before, after) = (initial_state(&parent), initial_state(&mutation.scenario));
            assert_eq!(after.satellites, before.satellites);
            let added = count_new(&after.debris, &before.debris);
            let removed = count_new(&before.debris, &after.debris);
            let moves_all = mutation.changes.contains(&"all pass earlier or later");
            let max = if moves_all { MAX_ENCOUNTERS + 3 } else { 3 };
            assert!(
                added <= max && removed <= max,
                "{added} added, {removed} removed: {:?}",
                mutation.changes
            );
            max_added = max_added.max(added);
            seen.extend(mutation.changes.iter().copied());
            let parsed = Scenario::from_json(&mutation.scenario.to_json()).unwrap();
            assert_eq!(parsed.id(), mutation.scenario.id());
        }
    }
    // Of 640 scenarios; those without a near pass offer little to change.
    assert!(mutated > 600, "{mutated}");
    assert!(max_added > 0);
    let missing: Vec<_> = EDITS.iter().filter(|edit| !seen.contains(*edit)).collect();
    assert!(missing.is_empty(), "never: {missing:?}; seen {seen:?}");
}

#[test]
fn mutations_can_be_mutated_again() {
    let brief = brief("kessler/survival", 5);
    let mut scenario = training_scenario(&brief, 1);
    let mut ids = BTreeSet::from([scenario.id()]);
    for generation in 0..30 {
        let mutation = mutate(&scenario, &brief, &mut rng(100 + generation)).unwrap();
        assert_eq!(
            mutation.scenario.recipe().param("debris"),
            Some(initial_state(&mutation.scenario).debris.len() as f64)
        );
        scenario = mutation.scenario;
        ids.insert(scenario.id());
    }
    assert_eq!(ids.len(), 31, "all generations differ");
}

/// The score of holding differs less between a parent and its mutation than between two scenarios of a level.
#[test]
fn mutation_is_similar_to_its_parent() {
    let brief = brief("kessler/survival", 4);
    let (mut to_child, mut to_other, mut count) = (0.0, 0.0, 0.0);
    for number in 0..60 {
        let parent = training_scenario(&brief, number);
        let Some(child) = mutate(&parent, &brief, &mut rng(number)) else { continue };
        let other = training_scenario(&brief, number + 1000);
        let brackets = [&parent, &child.scenario, &other].map(|scenario| admission::admit(scenario).bracket);
        let [Some(parent), Some(child), Some(other)] = brackets else { continue };
        to_child += (parent.hold_score() - child.hold_score()).abs();
        to_other += (parent.hold_score() - other.hold_score()).abs();
        count += 1.0;
    }
    assert!(count > 40.0, "{count}");
    assert!(to_child < 0.8 * to_other, "{to_child} {to_other} of {count}");
}

#[test]
fn docking_scenarios_are_mutated_too() {
    let tasks: Vec<_> = env_core::tasks().filter(|task| task.world().starts_with("docking@")).collect();
    assert!(!tasks.is_empty());
    for task in tasks {
        let brief = brief(task.id(), 2);
        let mut changes = BTreeSet::new();
        for number in 0..60 {
            let parent = training_scenario(&brief, number);
            let mutation = mutate(&parent, &brief, &mut rng(number)).unwrap();
            assert_ne!(mutation.scenario.id(), parent.id());
            changes.extend(mutation.changes);
            let parsed = Scenario::from_json(&mutation.scenario.to_json()).unwrap();
            assert_eq!(parsed.id(), mutation.scenario.id());
        }
        assert!(changes.len() >= 2, "{changes:?}");
    }
}
