//! Edits of scenarios.

use std::collections::BTreeSet;
use std::sync::Arc;

use env_core::chance::Seeded;
use env_core::draws::Purpose;
use env_core::kessler::kernel::Body;
use env_core::kessler::setup::{Setup, Start};
use env_core::{Draws, Recipe, Scenario, Seed, SeedSpace, bracket};

use crate::brief::Brief;
use crate::vary;

fn brief(task: &str, level: u32) -> Brief {
    let spec = env_core::task(task).unwrap();
    let recipe = Recipe::with_params(spec, spec.levels().params(level as usize)).unwrap();
    Brief::new(Arc::new(recipe), 1, 0).at_level(spec.levels(), level)
}

fn drawn(brief: &Brief, number: u64) -> Scenario {
    brief.under(Seed::in_space(SeedSpace::Training, number))
}

fn start(scenario: &Scenario) -> Start {
    Setup::read(scenario.recipe()).unwrap().start(&mut Seeded::new(scenario.seed())).unwrap()
}

fn draws(number: u64) -> Draws {
    Draws::new(Purpose::Design, 3, number)
}

const TASKS: [&str; 4] =
    ["kessler/survival", "kessler/eco_station", "kessler/rendezvous", "kessler/formation"];

#[test]
fn a_few_bodies_change_and_the_others_stay() {
    let (mut seen, mut edited, mut most) = (BTreeSet::new(), 0, 0);
    for (task, level) in TASKS.iter().flat_map(|task| [0, 3, 6, 9].map(|level| (task, level))) {
        let brief = brief(task, level);
        for number in 0..40 {
            let parent = drawn(&brief, number);
            let Some(varied) = vary(&parent, &brief, &mut draws(number)) else { continue };
            edited += 1;
            assert_eq!(
                vary(&parent, &brief, &mut draws(number)).as_ref(),
                Some(&varied),
                "the same draws, the same edit"
            );
            assert_ne!(varied.scenario.id(), parent.id());
            assert!((1..=4).contains(&varied.changes.len()), "{:?}", varied.changes);
            let (before, after) = (start(&parent), start(&varied.scenario));
            assert_eq!(after.satellites, before.satellites);
            let new = |of: &[Body], than: &[Body]| of.iter().filter(|body| !than.contains(body)).count();
            let (come, gone) = (new(&after.debris, &before.debris), new(&before.debris, &after.debris));
            let all = varied.changes.contains(&"all pass earlier or later");
            let few = if all { super::super::language::MAX_ENCOUNTERS + 3 } else { 3 };
            assert!(come <= few && gone <= few, "{come} came, {gone} went: {:?}", varied.changes);
            most = most.max(come);
            seen.extend(varied.changes.iter().copied());
            let told = Scenario::from_json(&varied.scenario.to_json()).unwrap();
            assert_eq!(told.id(), varied.scenario.id());
        }
    }
    // Of 640: where nothing passes near there is little to change.
    assert!(edited > 600, "{edited}");
    assert!(most > 0);
    let wanted = [
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
    let missing: Vec<_> = wanted.iter().filter(|change| !seen.contains(*change)).collect();
    assert!(missing.is_empty(), "never: {missing:?}; seen {seen:?}");
}

#[test]
fn edits_of_edits_go_on() {
    let brief = brief("kessler/survival", 5);
    let mut scenario = drawn(&brief, 1);
    let mut ids = BTreeSet::from([scenario.id()]);
    for generation in 0..30 {
        let varied = vary(&scenario, &brief, &mut draws(100 + generation)).unwrap();
        assert_eq!(
            varied.scenario.recipe().param("debris"),
            Some(start(&varied.scenario).debris.len() as f64)
        );
        scenario = varied.scenario;
        ids.insert(scenario.id());
    }
    assert_eq!(ids.len(), 31, "none came again");
}

/// What is changed a little differs a little: what a planner reaches on the child is nearer to what it reaches on the parent
/// than what it reaches on another draw of the same level.
#[test]
fn edits_are_more_like_their_parent_than_other_draws_are() {
    let brief = brief("kessler/survival", 4);
    let (mut to_child, mut to_other, mut n) = (0.0, 0.0, 0.0);
    for number in 0..60 {
        let parent = drawn(&brief, number);
        let Some(child) = vary(&parent, &brief, &mut draws(number)) else { continue };
        let floors = [&parent, &child.scenario, &drawn(&brief, number + 1000)]
            .map(|scenario| bracket::admit(scenario).bracket);
        let [Some(of), Some(child), Some(other)] = floors else { continue };
        to_child += (of.hold() - child.hold()).abs();
        to_other += (of.hold() - other.hold()).abs();
        n += 1.0;
    }
    assert!(n > 40.0, "{n}");
    assert!(to_child < 0.8 * to_other, "{to_child} {to_other} of {n}");
}

#[test]
fn docking_is_edited_too() {
    let tasks: Vec<_> = env_core::tasks().filter(|task| task.world().starts_with("docking@")).collect();
    assert!(!tasks.is_empty());
    for task in tasks {
        let brief = brief(task.id(), 2);
        let mut changes = BTreeSet::new();
        for number in 0..60 {
            let parent = drawn(&brief, number);
            let varied = vary(&parent, &brief, &mut draws(number)).unwrap();
            assert_ne!(varied.scenario.id(), parent.id());
            changes.extend(varied.changes);
            assert_eq!(Scenario::from_json(&varied.scenario.to_json()).unwrap().id(), varied.scenario.id());
        }
        assert!(changes.len() >= 2, "{changes:?}");
    }
}
