//! Mutations of scenarios without a design.

use std::collections::BTreeSet;

use env_core::keyed_rng::RngPurpose;
use env_core::tasking::task::layout::TaskingLayout;
use env_core::{KeyedRng, Seed, SeedSpace};

use super::*;
use crate::mutate;

fn rng(number: u64) -> KeyedRng {
    KeyedRng::new(RngPurpose::Design, 3, number)
}

fn training_scenario(brief: &DesignBrief, number: u64) -> Scenario {
    brief.scenario(Seed::in_space(SeedSpace::Training, number))
}

#[test]
fn mutation_changes_few_parts() {
    let mut seen = BTreeSet::new();
    for task in TASKS {
        let brief = brief_at_level(task, 4, 0);
        for number in 0..30 {
            let parent = training_scenario(&brief, number);
            let mutation = mutate(&parent, &brief, &mut rng(number)).unwrap();
            assert_eq!(mutate(&parent, &brief, &mut rng(number)).as_ref(), Some(&mutation), "the same draws");
            assert_ne!(mutation.scenario.id(), parent.id());
            assert!((1..=3).contains(&mutation.changes.len()), "{:?}", mutation.changes);
            assert_eq!(stored(&mutation.scenario).id(), mutation.scenario.id());
            let [before, after] =
                [&parent, &mutation.scenario].map(|scenario| TaskingLayout::of_scenario(scenario).unwrap());
            let changes = &mutation.changes;
            let is_changed = |names: &[&str]| names.iter().any(|name| changes.contains(name));
            if !is_changed(&["the time of the day", "the season"]) {
                assert_eq!(after.epoch, before.epoch);
            }
            assert_eq!(after.outages != before.outages, is_changed(&["a station in or out of service"]));
            assert_eq!(after.targets.is_some(), is_changed(&["a field of targets more"]));
            seen.extend(mutation.changes.iter().copied());
        }
    }
    assert_eq!(seen.len(), 10, "{seen:?}");
}

/// Without a field in the layout, imagers keep the targets that the seed draws.
#[test]
fn mutations_can_be_mutated_again() {
    for task in [SCANNING, IMAGING] {
        let brief = brief_at_level(task, 5, 0);
        let mut scenario = training_scenario(&brief, 1);
        let mut ids = BTreeSet::from([scenario.id()]);
        for generation in 0..12 {
            scenario = mutate(&scenario, &brief, &mut rng(100 + generation)).unwrap().scenario;
            ids.insert(scenario.id());
            let layout = TaskingLayout::of_recipe(scenario.recipe()).unwrap().unwrap();
            assert_eq!(layout.keeps_drawn_targets, task == IMAGING);
        }
        assert_eq!(ids.len(), 13, "all generations differ");
        assert!(scenario.task().start(&scenario).is_ok());
    }
}

/// Designed fields stay without a background if a mutation edits them.
#[test]
fn mutations_of_designs_keep_their_targets() {
    let brief = brief_at_level(IMAGING, 3, 4);
    let base = brief.base_scenario(0);
    let (scenario, _) = empty_gate().language().build(&design_json(IMAGING, "low_value"), &base).unwrap();
    let given = TaskingLayout::of_scenario(&scenario).unwrap();
    for number in 0..10 {
        let mutation = mutate(&scenario, &brief, &mut rng(number)).unwrap();
        let layout = TaskingLayout::of_scenario(&mutation.scenario).unwrap();
        assert!(!layout.keeps_drawn_targets);
        let targets = layout.targets.unwrap();
        assert_eq!(targets[..60], given.targets.as_ref().unwrap()[..]);
    }
}
