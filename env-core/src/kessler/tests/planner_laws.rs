//! Property tests of panel, planner, threat placement and admission.

use proptest::prelude::*;

use super::at_level;
use crate::admission::admit;
use crate::episode_rng::SeededRng;
use crate::kessler::KESSLER_TASKS;
use crate::kessler::constants::EPSILON;
use crate::kessler::planner::panel::{PANEL_SIZE, panel_kick};
use crate::kessler::setup::KesslerSetup;
use crate::kessler::threat_placement::{Threat, place_threat};
use crate::log::{ActionLog, Precision};
use crate::rollout::replay;
use crate::task::Scenario;
use crate::task::TaskSpec;

/// Physics options that can be combined.
const PHYSICS_COMBINATIONS: [&[(&str, &str)]; 6] = [
    &[("contact", "swept")],
    &[("gravity", "j2")],
    &[("risk", "pc")],
    &[("contact", "swept"), ("gravity", "j2")],
    &[("risk", "pc"), ("gravity", "j2")],
    &[("compat", "upstream")],
];

fn any_scenario() -> impl Strategy<Value = Scenario> {
    (0..KESSLER_TASKS.len(), 0usize..10, 0u64..1 << 40, 0usize..2 * PHYSICS_COMBINATIONS.len()).prop_map(
        |(task, level, seed, physics)| {
            let scenario = at_level(KESSLER_TASKS[task].id(), level, seed);
            // Half of the scenarios have default physics.
            let mut recipe = scenario.recipe().as_ref().clone();
            for (option, choice) in PHYSICS_COMBINATIONS.get(physics).copied().unwrap_or_default() {
                recipe = recipe.with_option(option, choice).unwrap();
            }
            Scenario::new(recipe, scenario.seed())
        },
    )
}

/// Log of plan `index` of the panel.
fn panel_log(scenario: &Scenario, index: usize) -> ActionLog {
    let setup = KesslerSetup::from_recipe(scenario.recipe()).unwrap();
    let start = setup.draw_initial_state(&mut SeededRng::new(scenario.seed())).unwrap();
    let mut log = ActionLog::new(2, Precision::F64);
    for (satellite, body) in (0u32..).zip(&start.satellites) {
        if let Some((dvx, dvy)) = panel_kick(index, body, setup.fuel) {
            log.push_entry(satellite, &[dvx, dvy]);
        }
    }
    log.end_step();
    log.stopped = Some(crate::StopReason::TooLong); // The rest is hold.
    log
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// A replay of the reference plan, and of each plan of the panel, gives exactly its stored outcome. The
    /// reference is at least as good as each plan (under `risk: pc` up to ε, since it prunes burns that are
    /// worth less together).
    #[test]
    fn bracket_outcomes_equal_replays(scenario in any_scenario()) {
        let bracket = scenario.task().bracket(&scenario).unwrap();
        prop_assert_eq!(bracket.panel.len(), PANEL_SIZE);
        prop_assert_eq!(replay(&scenario, &bracket.reference_plan).unwrap(), bracket.reference);
        for (index, stored) in bracket.panel.iter().enumerate() {
            let replayed = replay(&scenario, &panel_log(&scenario, index)).unwrap();
            prop_assert_eq!(&replayed, stored, "plan {}", index);
            let pruned = if scenario.recipe().option("risk") == Some("pc") { EPSILON } else { 0.0 };
            prop_assert!(bracket.reference.score >= stored.score - pruned);
        }
    }

    /// `admit` never passes an unsolvable scenario: the stored reference plan succeeds on the serialised
    /// scenario.
    #[test]
    fn contested_scenarios_are_solvable(scenario in any_scenario()) {
        let admission = admit(&scenario);
        prop_assert!(admission.fair.is_ok());
        if admission.contested {
            prop_assert!(admission.solvable);
            let bracket = admission.bracket.unwrap();
            let again = Scenario::from_json(&scenario.to_json()).unwrap();
            prop_assert_eq!(again.id(), scenario.id());
            let outcome = replay(&again, &bracket.reference_plan).unwrap();
            prop_assert!(scenario.task().is_success(&outcome, bracket.skill(outcome.score)));
        }
    }

    /// A placed threat destroys its satellite under hold, at its step at the latest and never before step 3.
    #[test]
    fn placed_threat_hits_its_satellite(
        seed in 0u64..1 << 40,
        satellite in 0u32..3,
        step in 3u32..40,
        direction in 0.0..std::f64::consts::TAU,
        speed in 0.5..8.0f64,
    ) {
        let scenario = at_level("kessler/survival", 0, seed);
        let Ok(placed) = place_threat(&scenario, Threat { satellite, step, direction, speed }) else { return Ok(()) };
        let mut episode = placed.task().start(&placed).unwrap();
        let mut report = crate::task::StepReport::default();
        let mut lost_at = None;
        while !episode.done() {
            episode.step(crate::JointAction::HOLD, &mut report).unwrap();
            let is_lost = report.agents.iter().any(|a| a.agent == satellite && a.terminated);
            if is_lost {
                lost_at = Some(episode.steps());
                break;
            }
        }
        prop_assert!(lost_at.is_some_and(|at| (3..=step).contains(&at)), "{:?}", lost_at);
    }
}

#[test]
fn unfair_scenarios_are_not_admitted() {
    let scenario = at_level("kessler/survival", 0, 5);
    let setup = KesslerSetup::from_recipe(scenario.recipe()).unwrap();
    let start = setup.draw_initial_state(&mut SeededRng::new(scenario.seed())).unwrap();
    let s = start.satellites[1];
    let mut value = scenario.to_json();
    value["layout"] =
        serde_json::json!({"mode": "extend", "bodies": {"debris": [[s.x + 0.5, s.y, s.vx, s.vy]]}});
    let admission = admit(&Scenario::from_json(&value).unwrap());
    assert!(!admission.contested && !admission.solvable && admission.bracket.is_none());
    let error = admission.fair.unwrap_err();
    assert_eq!(error.field(), "layout.bodies.debris.0");
    insta::assert_snapshot!(error.to_string(), @"layout.bodies.debris.0 makes the start unfair: it touches satellite 1 at step 0 under hold, before any agent could act");
}

#[test]
fn contested_threat_can_be_placed_at_every_level() {
    for task in ["kessler/survival", "kessler/eco_station"] {
        for level in 0..10 {
            let placed = (0..20)
                .filter(|&seed| {
                    let scenario = at_level(task, level, 1000 + seed);
                    let Some((placed, bracket)) = scenario.task().make_contested(&scenario) else {
                        return false;
                    };
                    let admission = admit(&placed);
                    assert_eq!(admission.bracket.as_ref(), Some(&bracket));
                    admission.contested
                })
                .count();
            println!("{task} L{level}: {placed} of 20 placed");
            assert!(placed >= 8, "{task} L{level}: {placed} of 20");
        }
    }
}
