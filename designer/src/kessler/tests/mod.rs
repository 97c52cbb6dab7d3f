//! Compiled layouts do what they claim when the engine flies them, and the critique sees them as they were meant.

mod agents;
mod fuzz;
mod gate;
mod vary;

use std::collections::BTreeMap;

use env_core::kessler::bearing::Frame;
use env_core::rollout::replay;
use env_core::{ActionLog, Recipe, Scenario, Seed};
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use serde_json::json;

use super::language::{BEARING, Design, KINDS, MISS, SATELLITE, SPEED, STEP};
use super::place::difference;
use super::{Encounter, Kind, compile};
use env_core::log::Precision;

fn base(task: &str, seed: u64, physics: &[(&'static str, &'static str)]) -> Scenario {
    let task = env_core::task(task).unwrap();
    let mut recipe = Recipe::with_params(task, [("debris", 20.0), ("fuel", 30.0)].into_iter()).unwrap();
    for (option, choice) in physics {
        recipe = recipe.with_option(option, choice).unwrap();
    }
    Scenario::new(recipe, Seed::user(seed).unwrap())
}

fn design(frame: Frame, encounters: Vec<Encounter>) -> Design {
    let mut design = Design::from_json(&json!({
        "name": "", "aim": {"mode": "collision"},
        "encounters": [{"satellite": 0, "step": 10, "bearing_deg": 0, "relative_speed": 50, "miss_distance": 0, "kind": "threat"}]
    }))
    .unwrap();
    design.frame = frame;
    design.encounters = encounters;
    design
}

fn encounter() -> impl Strategy<Value = Encounter> {
    let kind = prop::sample::select(KINDS.to_vec());
    (
        SATELLITE.min..=SATELLITE.max,
        STEP.min..=STEP.max,
        BEARING.min..=BEARING.max,
        20..=SPEED.max,
        kind,
        0.0..1.0f64,
        any::<bool>(),
    )
        .prop_map(
            |(satellite, step, bearing_deg, relative_speed, (kind, _, min, max, _), share, rogue)| {
                Encounter {
                    satellite,
                    step,
                    bearing_deg,
                    relative_speed,
                    miss_distance: min + (share * f64::from(max - min)) as u32,
                    kind,
                    rogue,
                }
            },
        )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(3000))]

    /// A threat hits its satellite at its step and nobody else before, passing as near as it says; a decoy and a screen
    /// miss everybody, their own satellite by at least what they say; the bearing is the one asked for to half a degree.
    #[test]
    fn what_compiles_does_what_it_claims(
        task in prop::sample::select(vec!["kessler/survival", "kessler/eco_station", "kessler/rendezvous"]),
        seed in 0u64..1000,
        inertial: bool,
        encounter in encounter(),
    ) {
        let frame = if inertial { Frame::Inertial } else { Frame::RadialInTrack };
        let Ok(compiled) = compile(&design(frame, vec![encounter]), &base(task, seed, &[])) else { return Ok(()) };
        let placed = compiled.placed[0];
        prop_assert!(difference(f64::from(encounter.bearing_deg), placed.bearing_deg).abs() <= 0.5);
        let mut log = ActionLog::new(2, Precision::F64);
        log.stopped = Some(env_core::Stopped::TooLate); // hold to the end
        let flown_hold = replay(&compiled.scenario, &log).unwrap();
        // Fragments of the one that is hit may hit another.
        prop_assert_eq!(flown_hold.lost > 0, encounter.kind == Kind::Threat, "{:?}", encounter);
        let critique = compiled.scenario.task().critique(&compiled.scenario, &log).unwrap();
        if encounter.kind == Kind::Threat {
            let failure = critique.failures.iter().find(|f| f.encounter.is_some()).unwrap();
            prop_assert_eq!((failure.agent, failure.step), (encounter.satellite, encounter.step));
            prop_assert_eq!(failure.mode, if encounter.rogue { "rogue" } else { "collision" });
            let met = failure.encounter.as_ref().unwrap();
            let seen = if inertial { met.bearing_inertial_deg.unwrap() } else { met.bearing_deg };
            prop_assert!(difference(f64::from(encounter.bearing_deg), seen).abs() <= 0.5, "{} {seen}", encounter.bearing_deg);
            // Back and forth over at most 48 steps closes to 1e-9.
            let speed = SPEED.value(encounter.relative_speed);
            prop_assert!((met.relative_speed - speed).abs() < 1e-8, "{speed} {}", met.relative_speed);
            prop_assert!((placed.least_distance - MISS.value(encounter.miss_distance)).abs() < 1e-8);
        } else {
            prop_assert!(placed.least_distance >= MISS.value(encounter.miss_distance) - 1e-6);
        }
    }
}

/// Half of what may be asked for can be had, of every kind, from the start and as a rogue: the bounds are not a trap.
#[test]
fn much_of_the_language_compiles() {
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let strategy = encounter();
    let mut count: BTreeMap<(Kind, bool), (u32, u32)> = BTreeMap::new();
    for seed in 0..3000 {
        let encounter = strategy.new_tree(&mut runner).unwrap().current();
        let built = compile(
            &design(Frame::RadialInTrack, vec![encounter]),
            &base("kessler/survival", seed % 50, &[]),
        );
        let (all, had) = count.entry((encounter.kind, encounter.rogue)).or_default();
        *all += 1;
        *had += u32::from(built.is_ok());
        if let Err(fault) = built {
            assert!(fault.field == "encounters.0" && fault.words.len() > 40, "{fault}");
        }
    }
    assert_eq!(count.len(), 6);
    for ((kind, rogue), (all, had)) in count {
        let least = if rogue { 0.6 } else { 0.3 };
        assert!(f64::from(had) >= least * f64::from(all), "{kind:?} {rogue}: {had} of {all}");
    }
}
