//! Laws of panel, planner, plant and admit.

use proptest::prelude::*;

use super::at_level;
use crate::bracket::admit;
use crate::chance::Seeded;
use crate::kessler::TASKS;
use crate::kessler::constants::EPSILON;
use crate::kessler::planner::panel::{PANEL, kick};
use crate::kessler::plant::{Threat, plant};
use crate::kessler::setup::Setup;
use crate::log::{ActionLog, Precision};
use crate::rollout::replay;
use crate::scenario::Scenario;
use crate::task::TaskSpec;

/// Physics that can be had together.
const PHYSICS: [&[(&str, &str)]; 6] = [
    &[("contact", "swept")],
    &[("gravity", "j2")],
    &[("risk", "pc")],
    &[("contact", "swept"), ("gravity", "j2")],
    &[("risk", "pc"), ("gravity", "j2")],
    &[("compat", "upstream")],
];

fn any_scenario() -> impl Strategy<Value = Scenario> {
    (0..TASKS.len(), 0usize..10, 0u64..1 << 40, 0usize..2 * PHYSICS.len()).prop_map(
        |(task, level, seed, physics)| {
            let scenario = at_level(TASKS[task].id(), level, seed);
            // Half of them plain.
            let mut recipe = scenario.recipe().as_ref().clone();
            for (option, choice) in PHYSICS.get(physics).copied().unwrap_or_default() {
                recipe = recipe.with_option(option, choice).unwrap();
            }
            Scenario::new(recipe, scenario.seed())
        },
    )
}

/// Plan `index` of the panel as a log.
fn panel_log(scenario: &Scenario, index: usize) -> ActionLog {
    let setup = Setup::read(scenario.recipe()).unwrap();
    let start = setup.start(&mut Seeded::new(scenario.seed())).unwrap();
    let mut log = ActionLog::new(2, Precision::F64);
    for (satellite, body) in (0u32..).zip(&start.satellites) {
        if let Some((dvx, dvy)) = kick(index, body, setup.fuel) {
            log.act(satellite, &[dvx, dvy]);
        }
    }
    log.end_step();
    log.stopped = Some(crate::Stopped::TooLong); // the rest is flown as hold
    log
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// The witness, flown, earns exactly its score; so does each plan of the panel; the reference is at least each (under
    /// `risk: pc` it leaves out burns that are worth less than ε together).
    #[test]
    fn brackets_are_what_the_episode_gives(scenario in any_scenario()) {
        let bracket = scenario.task().bracket(&scenario).unwrap();
        prop_assert_eq!(bracket.panel.len(), PANEL);
        prop_assert_eq!(replay(&scenario, &bracket.witness).unwrap(), bracket.reference);
        for (index, told) in bracket.panel.iter().enumerate() {
            let flown = replay(&scenario, &panel_log(&scenario, index)).unwrap();
            prop_assert_eq!(&flown, told, "plan {}", index);
            let spared = if scenario.recipe().option("risk") == Some("pc") { EPSILON } else { 0.0 };
            prop_assert!(bracket.reference.score >= told.score - spared);
        }
    }

    /// `admit` never passes the unsolvable: the stored witness really succeeds, within fuel, on the scenario's bytes.
    #[test]
    fn admit_never_passes_the_unsolvable(scenario in any_scenario()) {
        let admission = admit(&scenario);
        prop_assert!(admission.fair.is_ok());
        if admission.contested {
            prop_assert!(admission.solvable);
            let bracket = admission.bracket.unwrap();
            let again = Scenario::from_json(&scenario.to_json()).unwrap();
            prop_assert_eq!(again.id(), scenario.id());
            let flown = replay(&again, &bracket.witness).unwrap();
            prop_assert!(scenario.task().success(&flown, bracket.skill(flown.score)));
        }
    }

    /// A planted threat, flown on hold, takes its satellite at its step at the latest, and never before step 3.
    #[test]
    fn planted_threats_hit(
        seed in 0u64..1 << 40,
        satellite in 0u32..3,
        step in 3u32..40,
        direction in 0.0..std::f64::consts::TAU,
        speed in 0.5..8.0f64,
    ) {
        let scenario = at_level("kessler/survival", 0, seed);
        let Ok(planted) = plant(&scenario, Threat { satellite, step, direction, speed }) else { return Ok(()) };
        let mut episode = planted.task().start(&planted).unwrap();
        let mut report = crate::task::StepReport::default();
        let mut lost_at = None;
        while !episode.done() {
            episode.step(crate::JointAction::HOLD, &mut report).unwrap();
            let gone = report.agents.iter().any(|a| a.agent == satellite && a.terminated);
            if gone {
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
    let setup = Setup::read(scenario.recipe()).unwrap();
    let start = setup.start(&mut Seeded::new(scenario.seed())).unwrap();
    let s = start.satellites[1];
    let mut value = scenario.to_json();
    value["layout"] =
        serde_json::json!({"mode": "extend", "bodies": {"debris": [[s.x + 0.5, s.y, s.vx, s.vy]]}});
    let admission = admit(&Scenario::from_json(&value).unwrap());
    assert!(!admission.contested && !admission.solvable && admission.bracket.is_none());
    let error = admission.fair.unwrap_err();
    assert_eq!(error.field(), "layout.bodies.debris.0");
    insta::assert_snapshot!(error.to_string(), @"layout.bodies.debris.0: the start is not fair: it touches satellite 1 at step 0 under hold, before anybody could act");
}

#[test]
fn a_contested_scenario_can_be_planted_at_every_level() {
    for task in ["kessler/survival", "kessler/eco_station"] {
        for level in 0..10 {
            let planted = (0..20)
                .filter(|&seed| {
                    let scenario = at_level(task, level, 1000 + seed);
                    let Some((planted, bracket)) = scenario.task().plant_contested(&scenario) else {
                        return false;
                    };
                    let admission = admit(&planted);
                    assert_eq!(admission.bracket.as_ref(), Some(&bracket));
                    admission.contested
                })
                .count();
            println!("{task} L{level}: {planted} of 20 planted");
            assert!(planted >= 8, "{task} L{level}: {planted} of 20");
        }
    }
}
