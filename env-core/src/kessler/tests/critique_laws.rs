//! Property tests of the critique over random scenarios and logs.

use proptest::prelude::*;

use super::at_level;
use crate::bracket::EpisodeOutcome;
use crate::critique::{ActionVerdict, Critique, Failure, Remedy, Verdict};
use crate::kessler::KESSLER_TASKS;
use crate::kessler::constants::SATELLITES;
use crate::kessler::telemetry::KesslerTelemetry;
use crate::log::{ActionLog, Precision, StopReason};
use crate::rollout::{replay, roll_out};
use crate::seed::Seed;
use crate::task::{Episode, StepReport, TaskSpec};
use crate::task::{Recipe, Scenario};

/// Failure modes of a lost satellite; each lost satellite has exactly one failure with one of them.
const LOSS_MODES: [&str; 5] = ["collision", "rogue", "fragment", "risk", "decay"];

fn any_scenario() -> impl Strategy<Value = Scenario> {
    let physics: [&[(&str, &str)]; 6] = [
        &[],
        &[],
        &[("compat", "upstream")],
        &[("contact", "swept")],
        &[("contact", "swept"), ("gravity", "j2")],
        &[("risk", "pc")],
    ];
    (0usize..KESSLER_TASKS.len(), 0usize..10, 0u64..1 << 40, prop::sample::select(physics.to_vec())).prop_map(
        |(task, level, seed, physics)| {
            let scenario = at_level(KESSLER_TASKS[task].id(), level, seed);
            let mut recipe = Recipe::clone(scenario.recipe());
            for (option, choice) in physics {
                recipe = recipe.with_option(option, choice).unwrap();
            }
            Scenario::new(recipe, Seed::user(seed).unwrap())
        },
    )
}

/// Random burn of one satellite.
#[derive(Debug, Clone)]
struct RandomBurn {
    /// Step, counted from 0.
    step: usize,
    satellite: u32,
    dv: [f64; 2],
}

/// Random burns of any size, many of them small. Several burns of one satellite in a step are likely.
fn any_burns() -> impl Strategy<Value = Vec<RandomBurn>> {
    let size = prop_oneof![-0.3..0.3f64, -2.0..2.0f64, Just(0.0)];
    let burn = (0usize..50, 0u32..3, size.clone(), size).prop_map(|(step, satellite, dvx, dvy)| RandomBurn {
        step,
        satellite,
        dv: [dvx, dvy],
    });
    prop::collection::vec(burn, 0..60)
}

/// Log of these burns, truncated at the end of the episode.
fn log_of(scenario: &Scenario, burns: &[RandomBurn]) -> ActionLog {
    let mut log = ActionLog::new(2, Precision::F64);
    for step in 0..50 {
        for burn in burns.iter().filter(|b| b.step == step) {
            log.push_entry(burn.satellite, &burn.dv);
        }
        log.end_step();
    }
    truncate_at_end(scenario, &log)
}

/// Truncates a log at the end of the episode; after its own end it holds.
fn truncate_at_end(scenario: &Scenario, log: &ActionLog) -> ActionLog {
    let mut episode = scenario.task().start(scenario).unwrap();
    let mut report = StepReport::default();
    let mut outcome = ActionLog::new(2, log.precision());
    for action in log.steps() {
        if !episode.done() {
            episode.step(action, &mut report).unwrap();
            outcome.push_step(action);
        }
    }
    outcome.stopped = Some(StopReason::TooLong);
    outcome
}

/// The log without the burns of one satellite in one step.
fn without_burn(scenario: &Scenario, log: &ActionLog, verdict: &ActionVerdict) -> ActionLog {
    let mut other = ActionLog::new(2, log.precision());
    for (step, action) in (1u32..).zip(log.steps()) {
        for (i, &agent) in action.agents.iter().enumerate() {
            if (step, agent) != (verdict.step, verdict.agent) {
                other.push_entry(agent, &action.values[2 * i..2 * i + 2]);
            }
        }
        other.end_step();
    }
    truncate_at_end(scenario, &other)
}

/// Visible state after a step.
struct VisibleState {
    active: [bool; SATELLITES],
    /// Ids of the visible debris.
    debris: Vec<u32>,
}

/// Visible states of an episode at the start and after each step.
fn visible_states(scenario: &Scenario, log: &ActionLog) -> Vec<VisibleState> {
    let observe = |episode: &dyn Episode| {
        let telemetry: KesslerTelemetry = serde_json::from_value(episode.telemetry()).unwrap();
        let debris = telemetry.radar_debris.iter().map(|d| d.id).collect();
        VisibleState { active: std::array::from_fn(|i| telemetry.satellites[i].is_active()), debris }
    };
    let mut episode = scenario.task().start(scenario).unwrap();
    let mut report = StepReport::default();
    let mut steps = vec![observe(&*episode)];
    while !episode.done() {
        episode.step(log.step(episode.steps() as usize), &mut report).unwrap();
        steps.push(observe(&*episode));
    }
    steps
}

/// The log with the remedy of one satellite, which holds afterwards. The other satellites act as before.
fn with_remedy(log: &ActionLog, agent: u32, remedy: &Remedy) -> ActionLog {
    let mut other = ActionLog::new(2, Precision::F64);
    for (step, action) in (1u32..).zip(log.steps()) {
        for (i, &of) in action.agents.iter().enumerate() {
            if of != agent || step < remedy.step {
                other.push_entry(of, &action.values[2 * i..2 * i + 2]);
            }
        }
        if step == remedy.step {
            other.push_entry(agent, &remedy.values);
        }
        other.end_step();
    }
    other
}

/// Facts of an episode that the engine reports.
struct EngineFacts {
    /// Satellites that were destroyed or decayed.
    destroyed: [bool; SATELLITES],
    /// Number of burns that took fuel, at most one per satellite and step.
    applied_burns: usize,
}

/// Steps the engine through a log and collects its facts.
fn engine_facts(scenario: &Scenario, log: &ActionLog) -> EngineFacts {
    let fuel = |truth: &serde_json::Value, i: usize| truth["satellites"][i]["fuel"].as_f64().unwrap();
    let mut episode = scenario.task().start(scenario).unwrap();
    let mut report = StepReport::default();
    let mut applied_burns = 0;
    while !episode.done() {
        let before = episode.truth();
        episode.step(log.step(episode.steps() as usize), &mut report).unwrap();
        let after = episode.truth();
        applied_burns += (0..SATELLITES).filter(|&i| fuel(&after, i) < fuel(&before, i)).count();
    }
    let end = episode.truth();
    let destroyed = std::array::from_fn(|i| end["satellites"][i]["status"] == "destroyed");
    EngineFacts { destroyed, applied_burns }
}

/// Checks the critique of a log against the engine, and returns it with the outcome.
fn check(scenario: &Scenario, log: &ActionLog) -> Result<(Critique, EpisodeOutcome), TestCaseError> {
    let outcome = replay(scenario, log).unwrap();
    let critique = scenario.task().critique(scenario, log).unwrap();
    prop_assert_eq!(&critique, &scenario.task().critique(scenario, log).unwrap());

    let EngineFacts { destroyed, applied_burns } = engine_facts(scenario, log);
    let states = visible_states(scenario, log);
    let has_risk = scenario.recipe().option("risk") == Some("pc");
    let mut losses = [0; SATELLITES];
    // Risk without an encounter is a goal that was held with too little survival, not a loss.
    let is_goal_risk = |f: &Failure| f.mode == "risk" && f.encounter.is_none();
    for failure in critique.failures.iter().filter(|f| LOSS_MODES.contains(&f.mode) && !is_goal_risk(f)) {
        losses[failure.agent as usize] += 1;
    }
    for (count, destroyed) in losses.iter().zip(destroyed) {
        // Under `risk: pc` a satellite that still flies may count as lost.
        prop_assert!(
            *count == u32::from(destroyed) || (!destroyed && *count == 1 && has_risk),
            "{:?} {:?}",
            losses,
            destroyed
        );
    }
    prop_assert_eq!(losses.iter().sum::<u32>(), outcome.lost);
    prop_assert_eq!(critique.actions.len(), applied_burns);
    let judged = &critique.assessment;
    prop_assert!((-1.0..=1.0).contains(&judged.value), "{:?}", judged);
    for failure in &critique.failures {
        let known = scenario.task().failure_modes().iter().any(|mode| mode.name == failure.mode);
        prop_assert!(known && failure.explanation.ends_with('.'));
        prop_assert!(failure.step >= 1 && failure.step <= outcome.steps);
        prop_assert!(failure.measures.iter().all(|m| m.value.is_finite()), "{:?}", failure);
        if let Some(encounter) = &failure.encounter {
            prop_assert!(
                (0.0..360.0).contains(&encounter.bearing_deg) && encounter.relative_speed.is_finite()
            );
            let first =
                (0..failure.step).find(|&step| states[step as usize].debris.contains(&encounter.body));
            prop_assert_eq!(encounter.first_visible_step, first);
            if let Some(remedy) = &encounter.cheapest_avoidance {
                prop_assert!(remedy.step > first.unwrap() && remedy.step <= failure.step);
                let other = visible_states(
                    scenario,
                    &truncate_at_end(scenario, &with_remedy(log, failure.agent, remedy)),
                );
                prop_assert!(other[failure.step as usize].active[failure.agent as usize], "{:?}", failure);
            }
            prop_assert_eq!(encounter.avoidable.is_none(), encounter.first_visible_step.is_none());
            prop_assert_eq!(encounter.avoidable == Some(true), encounter.cheapest_avoidance.is_some());
            prop_assert_eq!(
                encounter.first_visible_step.map_or(0, |visible| failure.step - visible),
                encounter.steps_left
            );
        }
    }
    Ok((critique, outcome))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    /// The critique never panics and is deterministic. It has one loss failure per lost satellite and a
    /// verdict per applied burn. Each gain is the difference of two replays by the engine, to the bit.
    #[test]
    fn critique_agrees_with_the_engine(scenario in any_scenario(), burns in any_burns()) {
        let log = log_of(&scenario, &burns);
        let (critique, outcome) = check(&scenario, &log)?;
        for verdict in &critique.actions {
            let other = replay(&scenario, &without_burn(&scenario, &log, verdict)).unwrap();
            prop_assert_eq!(verdict.gain.to_bits(), (outcome.score - other.score).to_bits(), "{:?}", verdict);
        }
    }

    /// A success without loss and waste has no failure and is never judged as missed; any other episode has a
    /// failure.
    #[test]
    fn successful_episodes_have_no_failures(
        scenario in any_scenario(),
        policy in prop::sample::select(vec!["hold", "heuristic", "reference", "frozen", "random"]),
    ) {
        let mut policy = scenario.task().policy(policy, &scenario, 3).unwrap();
        let log = roll_out(&scenario, &mut *policy).unwrap().log;
        let (critique, outcome) = check(&scenario, &log)?;
        let goal_met = outcome.goal.is_none_or(|goal| goal >= 0.9);
        if outcome.lost == 0 && goal_met {
            let wasted = critique.failures.iter().all(|f| f.mode == "wasted_fuel");
            prop_assert!(wasted, "{:?}", critique.failures);
            let waste = critique.actions.iter().any(|a| a.verdict == Verdict::Wasteful);
            prop_assert!(waste || critique.failures.is_empty(), "{:?}", critique.failures);
            prop_assert!(!["threat_missed", "unavoidable", "goal_missed"].contains(&critique.assessment.case));
        } else {
            prop_assert!(!critique.failures.is_empty(), "{outcome:?}");
        }
    }
}
