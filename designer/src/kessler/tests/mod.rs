//! Tests of compilation against the engine: compiled layouts do what they claim, and the critique agrees.

mod agents;
mod documentation;
mod fuzz;
mod gate;
mod mutate;
mod siblings;

use std::collections::BTreeMap;

use env_core::kessler::bearing::BearingFrame;
use env_core::log::Precision;
use env_core::rollout::replay;
use env_core::{ActionLog, Recipe, Scenario, Seed};
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use serde_json::json;

use super::vocabulary::{BEARING, KINDS, KindSpec, MISS, SATELLITE, SPEED, STEP};
use super::{Aim, Design, Encounter, EncounterKind, compile};
use crate::angles::angle_between;

fn base_scenario(task: &str, seed: u64) -> Scenario {
    let task = env_core::task(task).unwrap();
    let recipe = Recipe::with_params(task, [("debris", 20.0), ("fuel", 30.0)].into_iter()).unwrap();
    Scenario::new(recipe, Seed::user(seed).unwrap())
}

/// A design with one encounter.
fn design(frame: BearingFrame, encounter: Encounter) -> Design {
    let aim = Aim { mode: "collision".to_owned(), bearing_deg: None };
    Design { name: String::new(), aim, frame, params: BTreeMap::new(), encounters: vec![encounter] }
}

/// Any encounter that is within its bounds and not slow.
fn encounter() -> impl Strategy<Value = Encounter> {
    (
        SATELLITE.min..=SATELLITE.max,
        STEP.min..=STEP.max,
        BEARING.min..=BEARING.max,
        20..=SPEED.max,
        prop::sample::select(KINDS.to_vec()),
        0.0..1.0f64,
        any::<bool>(),
    )
        .prop_map(|(satellite, step, bearing_deg, relative_speed, spec, share, is_rogue)| {
            let KindSpec { kind, min_miss, max_miss, .. } = spec;
            let miss_distance = min_miss + (share * f64::from(max_miss - min_miss)) as u32;
            Encounter { satellite, step, bearing_deg, relative_speed, miss_distance, kind, is_rogue }
        })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(3000))]

    /// If all satellites hold, a threat hits its satellite at its step and no other before, at its miss distance. A decoy or
    /// screen hits none and keeps its miss distance. The bearing is reached to half a degree.
    #[test]
    fn compiled_encounter_does_what_it_claims(
        task in prop::sample::select(vec!["kessler/survival", "kessler/eco_station", "kessler/rendezvous"]),
        seed in 0u64..1000,
        inertial: bool,
        encounter in encounter(),
    ) {
        let frame = if inertial { BearingFrame::Inertial } else { BearingFrame::RadialInTrack };
        let Ok(compiled) = compile(&design(frame, encounter), &base_scenario(task, seed)) else { return Ok(()) };
        let placed = compiled.placed[0];
        let requested = f64::from(encounter.bearing_deg);
        prop_assert!(angle_between(requested, placed.bearing_deg) <= 0.5);
        let mut hold = ActionLog::new(2, Precision::F64);
        hold.stopped = Some(env_core::StopReason::TooLate); // the remaining steps hold
        let outcome = replay(&compiled.scenario, &hold).unwrap();
        // Fragments of the first satellite may hit another one.
        prop_assert_eq!(outcome.lost > 0, encounter.kind == EncounterKind::Threat, "{:?}", encounter);
        let critique = compiled.scenario.task().critique(&compiled.scenario, &hold).unwrap();
        if encounter.kind == EncounterKind::Threat {
            let failure = critique.failures.iter().find(|f| f.encounter.is_some()).unwrap();
            prop_assert_eq!((failure.agent, failure.step), (encounter.satellite, encounter.step));
            prop_assert_eq!(failure.mode, if encounter.is_rogue { "rogue" } else { "collision" });
            let met = failure.encounter.as_ref().unwrap();
            let bearing = if inertial { met.bearing_inertial_deg.unwrap() } else { met.bearing_deg };
            prop_assert!(angle_between(requested, bearing) <= 0.5, "{requested} {bearing}");
            // The way back and forth over at most 48 steps is exact to 1e-9.
            let speed = SPEED.value(encounter.relative_speed);
            prop_assert!((met.relative_speed - speed).abs() < 1e-8, "{speed} {}", met.relative_speed);
            prop_assert!((placed.least_distance - MISS.value(encounter.miss_distance)).abs() < 1e-8);
        } else {
            prop_assert!(placed.least_distance >= MISS.value(encounter.miss_distance) - 1e-6);
        }
    }
}

/// Number of encounters that were tried and that compiled.
#[derive(Default)]
struct CompileCount {
    tried: u32,
    compiled: u32,
}

/// The bounds of the language are no trap for designers.
#[test]
fn a_large_share_of_the_language_compiles() {
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let strategy = encounter();
    let mut counts: BTreeMap<(EncounterKind, bool), CompileCount> = BTreeMap::new();
    for seed in 0..3000 {
        let encounter = strategy.new_tree(&mut runner).unwrap().current();
        let base = base_scenario("kessler/survival", seed % 50);
        let result = compile(&design(BearingFrame::RadialInTrack, encounter), &base);
        let count = counts.entry((encounter.kind, encounter.is_rogue)).or_default();
        count.tried += 1;
        count.compiled += u32::from(result.is_ok());
        if let Err(error) = result {
            assert!(error.field == "encounters.0" && error.message.len() > 40, "{error}");
        }
    }
    assert_eq!(counts.len(), 6);
    for ((kind, is_rogue), CompileCount { tried, compiled }) in counts {
        let min_share = if is_rogue { 0.6 } else { 0.3 };
        let is_enough = f64::from(compiled) >= min_share * f64::from(tried);
        assert!(is_enough, "{kind:?}, rogue {is_rogue}: {compiled} of {tried}");
    }
}
