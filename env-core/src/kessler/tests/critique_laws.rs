//! Laws of the critique over random scenarios and logs.

use proptest::prelude::*;

use super::at_level;
use crate::bracket::Flown;
use crate::critique::{ActionVerdict, Critique, Failure, Remedy, Verdict};
use crate::kessler::TASKS;
use crate::kessler::constants::SATELLITES;
use crate::kessler::telemetry::Telemetry;
use crate::log::{ActionLog, Precision, Stopped};
use crate::rollout::{fly, replay};
use crate::scenario::{Recipe, Scenario};
use crate::seed::Seed;
use crate::task::{Episode, StepReport, TaskSpec};

/// Modes of which a lost satellite has exactly one.
const LOSSES: [&str; 5] = ["collision", "rogue", "fragment", "risk", "decay"];

fn any_scenario() -> impl Strategy<Value = Scenario> {
    let physics: [&[(&str, &str)]; 6] = [
        &[],
        &[],
        &[("compat", "upstream")],
        &[("contact", "swept")],
        &[("contact", "swept"), ("gravity", "j2")],
        &[("risk", "pc")],
    ];
    (0usize..TASKS.len(), 0usize..10, 0u64..1 << 40, prop::sample::select(physics.to_vec())).prop_map(
        |(task, level, seed, physics)| {
            let scenario = at_level(TASKS[task].id(), level, seed);
            let mut recipe = Recipe::clone(scenario.recipe());
            for (option, choice) in physics {
                recipe = recipe.with_option(option, choice).unwrap();
            }
            Scenario::new(recipe, Seed::user(seed).unwrap())
        },
    )
}

type Burn = (usize, u32, f64, f64);

/// Some burns of any size, many of them small; several of one satellite in a step are likely.
fn any_burns() -> impl Strategy<Value = Vec<Burn>> {
    let size = prop_oneof![-0.3..0.3f64, -2.0..2.0f64, Just(0.0)];
    prop::collection::vec((0usize..50, 0u32..3, size.clone(), size), 0..60)
}

/// A log that says these burns, cut where the episode ends.
fn log_of(scenario: &Scenario, burns: &[Burn]) -> ActionLog {
    let mut log = ActionLog::new(2, Precision::F64);
    for step in 0..50 {
        for (_, agent, dvx, dvy) in burns.iter().filter(|b| b.0 == step) {
            log.act(*agent, &[*dvx, *dvy]);
        }
        log.end_step();
    }
    cut(scenario, &log)
}

/// The same log up to the end of the episode; past its own end it holds.
fn cut(scenario: &Scenario, log: &ActionLog) -> ActionLog {
    let mut episode = scenario.task().start(scenario).unwrap();
    let mut report = StepReport::default();
    let mut flown = ActionLog::new(2, log.precision());
    for action in log.steps() {
        if !episode.done() {
            episode.step(action, &mut report).unwrap();
            flown.push(action);
        }
    }
    flown.stopped = Some(Stopped::TooLong);
    flown
}

/// The log without what one satellite does in one step.
fn without(scenario: &Scenario, log: &ActionLog, verdict: &ActionVerdict) -> ActionLog {
    let mut other = ActionLog::new(2, log.precision());
    for (step, action) in (1u32..).zip(log.steps()) {
        for (i, &agent) in action.agents.iter().enumerate() {
            if (step, agent) != (verdict.step, verdict.agent) {
                other.act(agent, &action.values[2 * i..2 * i + 2]);
            }
        }
        other.end_step();
    }
    cut(scenario, &other)
}

/// What an episode shows as it goes: per step, the start first, who flies and which debris is seen.
fn watched(scenario: &Scenario, log: &ActionLog) -> Vec<([bool; SATELLITES], Vec<u32>)> {
    let look = |episode: &dyn Episode| {
        let seen: Telemetry = serde_json::from_value(episode.telemetry()).unwrap();
        let ids = seen.radar_debris.iter().map(|d| d.id).collect();
        (std::array::from_fn(|i| seen.satellites[i].active()), ids)
    };
    let mut episode = scenario.task().start(scenario).unwrap();
    let mut report = StepReport::default();
    let mut steps = vec![look(&*episode)];
    while !episode.done() {
        episode.step(log.step(episode.steps() as usize), &mut report).unwrap();
        steps.push(look(&*episode));
    }
    steps
}

/// The log up to the remedy's step; then the remedy and hold for this satellite, what they did for the others.
fn with_remedy(log: &ActionLog, agent: u32, remedy: &Remedy) -> ActionLog {
    let mut other = ActionLog::new(2, Precision::F64);
    for (step, action) in (1u32..).zip(log.steps()) {
        for (i, &of) in action.agents.iter().enumerate() {
            if of != agent || step < remedy.step {
                other.act(of, &action.values[2 * i..2 * i + 2]);
            }
        }
        if step == remedy.step {
            other.act(agent, &remedy.values);
        }
        other.end_step();
    }
    other
}

/// Which satellites the engine lost, which burns of each it applied.
fn truth(scenario: &Scenario, log: &ActionLog) -> ([bool; SATELLITES], usize) {
    let fuel = |truth: &serde_json::Value, i: usize| truth["satellites"][i]["fuel"].as_f64().unwrap();
    let mut episode = scenario.task().start(scenario).unwrap();
    let mut report = StepReport::default();
    let mut applied = 0;
    while !episode.done() {
        let before = episode.truth();
        episode.step(log.step(episode.steps() as usize), &mut report).unwrap();
        let after = episode.truth();
        applied += (0..SATELLITES).filter(|&i| fuel(&after, i) < fuel(&before, i)).count();
    }
    let end = episode.truth();
    (std::array::from_fn(|i| end["satellites"][i]["status"] == "destroyed"), applied)
}

fn check(scenario: &Scenario, log: &ActionLog) -> Result<(Critique, Flown), TestCaseError> {
    let flown = replay(scenario, log).unwrap();
    let critique = scenario.task().critique(scenario, log).unwrap();
    prop_assert_eq!(&critique, &scenario.task().critique(scenario, log).unwrap());

    let (lost, applied) = truth(scenario, log);
    let seen = watched(scenario, log);
    let risk = scenario.recipe().option("risk") == Some("pc");
    let mut losses = [0; SATELLITES];
    // Risk without an encounter is a goal that was held and not safe: nobody's loss.
    let goal = |f: &Failure| f.mode == "risk" && f.encounter.is_none();
    for failure in critique.failures.iter().filter(|f| LOSSES.contains(&f.mode) && !goal(f)) {
        losses[failure.agent as usize] += 1;
    }
    for (count, gone) in losses.iter().zip(lost) {
        // Under `risk: pc` one that still flies may count as lost.
        prop_assert!(*count == u32::from(gone) || (!gone && *count == 1 && risk), "{:?} {:?}", losses, lost);
    }
    prop_assert_eq!(losses.iter().sum::<u32>(), flown.lost);
    prop_assert_eq!(critique.actions.len(), applied);
    let judged = &critique.judged;
    prop_assert!((-1.0..=1.0).contains(&judged.value), "{:?}", judged);
    for failure in &critique.failures {
        let known = scenario.task().failure_modes().iter().any(|mode| mode.name == failure.mode);
        prop_assert!(known && failure.words.ends_with('.'));
        prop_assert!(failure.step >= 1 && failure.step <= flown.steps);
        prop_assert!(failure.measures.iter().all(|m| m.value.is_finite()), "{:?}", failure);
        if let Some(met) = &failure.encounter {
            prop_assert!((0.0..360.0).contains(&met.bearing_deg) && met.relative_speed.is_finite());
            let first = (0..failure.step).find(|&step| seen[step as usize].1.contains(&met.body));
            prop_assert_eq!(met.first_visible_step, first);
            if let Some(remedy) = &met.cheapest {
                prop_assert!(remedy.step > first.unwrap() && remedy.step <= failure.step);
                let other = watched(scenario, &cut(scenario, &with_remedy(log, failure.agent, remedy)));
                prop_assert!(other[failure.step as usize].0[failure.agent as usize], "{:?}", failure);
            }
            prop_assert_eq!(met.avoidable.is_none(), met.first_visible_step.is_none());
            prop_assert_eq!(met.avoidable == Some(true), met.cheapest.is_some());
            prop_assert_eq!(met.first_visible_step.map_or(0, |seen| failure.step - seen), met.steps_left);
        }
    }
    Ok((critique, flown))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    /// Never a panic; determined; one loss failure for each satellite lost; a verdict for each burn that was applied;
    /// and each gain is the difference of two replays by the engine, to the bit.
    #[test]
    fn critiques_say_what_the_engine_says(scenario in any_scenario(), burns in any_burns()) {
        let log = log_of(&scenario, &burns);
        let (critique, flown) = check(&scenario, &log)?;
        for verdict in &critique.actions {
            let other = replay(&scenario, &without(&scenario, &log, verdict)).unwrap();
            prop_assert_eq!(verdict.gain.to_bits(), (flown.score - other.score).to_bits(), "{:?}", verdict);
        }
    }

    /// What has nothing to blame: a success with nobody lost and nothing wasted has no failure; and who succeeds is
    /// never judged as one who missed.
    #[test]
    fn pilots_that_succeed_have_no_failures(
        scenario in any_scenario(),
        policy in prop::sample::select(vec!["hold", "heuristic", "reference", "frozen", "random"]),
    ) {
        let mut pilot = scenario.task().policy(policy, &scenario, 3).unwrap();
        let (_, log) = fly(&scenario, &mut *pilot).unwrap();
        let (critique, flown) = check(&scenario, &log)?;
        let held = flown.goal.is_none_or(|goal| goal >= 0.9);
        if flown.lost == 0 && held {
            let wasted = critique.failures.iter().all(|f| f.mode == "wasted_fuel");
            prop_assert!(wasted, "{:?}", critique.failures);
            let waste = critique.actions.iter().any(|a| a.verdict == Verdict::Wasteful);
            prop_assert!(waste || critique.failures.is_empty(), "{:?}", critique.failures);
            prop_assert!(!["threat_missed", "unavoidable", "goal_missed"].contains(&critique.judged.case));
        } else {
            prop_assert!(!critique.failures.is_empty(), "{flown:?}");
        }
    }
}
