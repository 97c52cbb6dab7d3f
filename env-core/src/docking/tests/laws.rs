//! Determinism, bounds, and that deputies that have left take no further part.

use proptest::prelude::*;
use serde_json::json;

use crate::bracket::admit;
use crate::chance::Seeded;
use crate::docking::TASKS;
use crate::docking::constants::MAX_DEPUTIES;
use crate::docking::flight::{Flight, Status};
use crate::docking::relative::{distance, separation, speed, speed_limit};
use crate::docking::setup::Setup;
use crate::log::{ActionLog, JointAction, Precision};
use crate::rollout::{fly, replay};
use crate::scenario::{Recipe, Scenario};
use crate::seed::Seed;
use crate::task::{StepReport, TaskSpec};

/// A scenario anywhere in the parameter space: each param at a share of its range.
fn anywhere(task: usize, shares: &[f64], seed: u64) -> Scenario {
    let task = &TASKS[task];
    let params = task.params().iter().zip(shares).map(|(spec, share)| {
        let value = spec.min + (spec.max - spec.min) * share;
        (spec.name, if spec.whole { libm::round(value) } else { value })
    });
    Scenario::new(Recipe::with_params(task, params).unwrap(), Seed::user(seed).unwrap())
}

fn shares() -> impl Strategy<Value = Vec<f64>> {
    proptest::collection::vec(0.0..=1.0f64, 5)
}

/// Thrusts of a few deputies, some ids and sizes beyond what is taken as it is.
fn thrusts() -> impl Strategy<Value = Vec<(u32, [f64; 3])>> {
    let axis = -2.0..2.0f64;
    proptest::collection::vec((0u32..5, [axis.clone(), axis.clone(), axis]), 1..60)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Same scenario and actions, same bits; scores in range; no NaN; rewards add up; ids survive the wire; the log
    /// replays to what was flown.
    #[test]
    fn episodes_are_determined_and_bounded(
        task in 0usize..2, shares in shares(), seed in 0u64..1 << 50, thrusts in thrusts(),
    ) {
        let scenario = anywhere(task, &shares, seed);
        let text = scenario.to_json().to_string();
        let again = Scenario::from_json(&serde_json::from_str(&text).unwrap()).unwrap();
        prop_assert_eq!(scenario.id(), again.id());
        let agents = TASKS[task].agents(scenario.recipe());
        let mut log = ActionLog::new(3, Precision::F64);
        let mut flown = Vec::new();
        for scenario in [&scenario, &again] {
            let mut episode = TASKS[task].start(scenario).unwrap();
            let (mut report, mut sum) = (StepReport::default(), 0.0);
            let mut returns = [0.0; MAX_DEPUTIES];
            log = ActionLog::new(3, Precision::F64);
            while !episode.done() {
                let (agent, thrust) = thrusts[episode.steps() as usize % thrusts.len()];
                let agent = agent % agents;
                log.act(agent, &thrust);
                log.end_step();
                episode.step(JointAction { agents: &[agent], values: &thrust }, &mut report).unwrap();
                sum += report.reward;
                for told in &report.agents {
                    assert!(told.reward.is_finite());
                    returns[told.agent as usize] += told.reward;
                }
            }
            let seen = episode.telemetry();
            for deputy in seen["deputies"].as_array().unwrap() {
                for value in deputy["observation"].as_array().unwrap() {
                    prop_assert!(value.as_f64().is_some_and(f64::is_finite));
                }
            }
            prop_assert_eq!(episode.flown().total, sum);
            let mean = returns.iter().sum::<f64>() / f64::from(agents);
            // The same rewards added up in another order: at most 2000 roundings of 14.
            prop_assert!((mean - sum).abs() < 1e-10);
            flown.push((episode.state_hash(), episode.flown()));
        }
        prop_assert_eq!(flown[0], flown[1]);
        prop_assert_eq!(replay(&scenario, &log).unwrap(), flown[0].1);
        let range = TASKS[task].score_range();
        prop_assert!(flown[0].1.score >= range.min && flown[0].1.score <= range.max);
    }

    /// The worst that can be done about the range: start as fast as a layout may, and push on.
    #[test]
    fn the_range_holds_at_its_edges(
        place in [-5000.0..5000.0f64, -5000.0..5000.0, -5000.0..5000.0],
        way in [-1.0..=1.0f64, -1.0..=1.0, -1.0..=1.0],
    ) {
        let row: Vec<f64> = place.into_iter().chain(way.map(|v| 10.0 * libm::copysign(1.0, v))).collect();
        prop_assume!(distance(&[place[0], place[1], place[2], 0.0, 0.0, 0.0]) > 1.0);
        let scenario = Scenario::from_json(&json!({
            "task": "docking/single", "seed": 1,
            "layout": {"mode": "replace", "bodies": {"deputies": [row]}},
        })).unwrap();
        let mut episode = TASKS[0].start(&scenario).unwrap();
        let mut report = StepReport::default();
        while !episode.done() {
            episode.step(JointAction { agents: &[0], values: &way.map(|v| 9.0 * v) }, &mut report).unwrap();
        }
        let range = TASKS[0].score_range();
        let score = episode.flown().score;
        prop_assert!(score >= range.min && score <= range.max, "{}", score);
    }

    /// A deputy that has left moves no more, is told nothing more, and what is sent for it changes nothing.
    #[test]
    fn those_that_have_left_take_no_part(seed in 0u64..1 << 50, thrusts in thrusts()) {
        let scenario = anywhere(1, &[1.0, 0.0, 0.8, 0.3, 1.0], seed);
        let (mut one, mut two) = (TASKS[1].start(&scenario).unwrap(), TASKS[1].start(&scenario).unwrap());
        let (mut told, mut report) = (StepReport::default(), StepReport::default());
        let mut left = [false; MAX_DEPUTIES];
        let mut last = one.telemetry();
        while !one.done() {
            let (agent, thrust) = thrusts[one.steps() as usize % thrusts.len()];
            one.step(JointAction { agents: &[agent], values: &thrust }, &mut report).unwrap();
            let (agents, values): (Vec<u32>, Vec<[f64; 3]>) = (0..5)
                .filter(|&i| left[i as usize] || i == agent)
                .map(|i| (i, if i == agent { thrust } else { [1.0, -1.0, 1.0] }))
                .unzip();
            two.step(JointAction { agents: &agents, values: &values.concat() }, &mut told).unwrap();
            prop_assert_eq!(&report, &told);
            let now = one.telemetry();
            for i in 0..MAX_DEPUTIES {
                prop_assert_eq!(left[i], !report.agents.iter().any(|a| a.agent == i as u32));
                if left[i] {
                    prop_assert_eq!(&now["deputies"][i]["observation"], &last["deputies"][i]["observation"]);
                }
            }
            report.agents.iter().filter(|a| a.terminated).for_each(|a| left[a.agent as usize] = true);
            last = now;
        }
        prop_assert_eq!(one.state_hash(), two.state_hash());
    }

    /// Starts are where the params say, apart from each other, and within the speed ratio.
    #[test]
    fn starts_are_as_the_params_say(shares in shares(), seed in 0u64..1 << 50) {
        let scenario = anywhere(1, &shares, seed);
        let setup = Setup::read(scenario.recipe()).unwrap();
        let start = setup.start(&mut Seeded::new(scenario.seed())).unwrap();
        let outer = scenario.recipe().param("start_radius").unwrap();
        let ratio = scenario.recipe().param("speed_ratio").unwrap();
        for (i, state) in start.states[..start.deputies].iter().enumerate() {
            let d = distance(state);
            // Sines and cosines are rounded.
            prop_assert!(d >= outer * 2.0 / 3.0 * (1.0 - 1e-12) && d <= outer * (1.0 + 1e-12));
            prop_assert!(speed(state) <= ratio * speed_limit(d) * (1.0 + 1e-12));
            for other in &start.states[..i] {
                prop_assert!(separation(state, other) >= 1.0);
            }
        }
    }

    /// More deputies keep the first; another radius keeps the directions.
    #[test]
    fn changing_one_param_keeps_the_other_draws(seed in 0u64..1 << 50) {
        let start = |shares: [f64; 5]| {
            let scenario = anywhere(1, &shares, seed);
            Setup::read(scenario.recipe()).unwrap().start(&mut Seeded::new(scenario.seed())).unwrap()
        };
        let (few, many) = (start([0.25, 0.2, 0.2, 1.0, 1.0]), start([1.0, 0.2, 0.2, 1.0, 1.0]));
        prop_assert_eq!(&few.states[..2], &many.states[..2]);
        let far = start([0.25, 0.9, 0.2, 1.0, 1.0]);
        for (near, far) in few.states[..2].iter().zip(&far.states) {
            let (a, b) = (distance(near), distance(far));
            (0..3).for_each(|i| assert!((near[i] / a - far[i] / b).abs() < 1e-12));
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// The witness earns the reference, anywhere in the parameter space, and a critique of it names nobody who docked.
    #[test]
    fn witnesses_earn_their_reference(task in 0usize..2, shares in shares(), seed in 0u64..1 << 50) {
        let scenario = anywhere(task, &shares, seed);
        let bracket = admit(&scenario).bracket.unwrap();
        prop_assert_eq!(replay(&scenario, &bracket.witness).unwrap(), bracket.reference);
        let seen = TASKS[task].critique(&scenario, &bracket.witness).unwrap();
        prop_assert_eq!(seen.failures.len() as u32, bracket.reference.lost);
        prop_assert!((-1.0..=1.0).contains(&seen.judged.value));
    }
}

#[test]
fn several_thrusts_add_up_and_none_is_coasting() {
    let scenario = anywhere(1, &[0.0, 0.2, 0.2, 1.0, 0.5], 4);
    let fly = |agents: &[u32], values: &[f64]| {
        let mut episode = TASKS[1].start(&scenario).unwrap();
        episode.step(JointAction { agents, values }, &mut StepReport::default()).unwrap();
        episode.state_hash()
    };
    assert_eq!(fly(&[0, 0], &[0.1, 0.0, 0.2, 0.2, 0.0, 0.1]), fly(&[0], &[0.1 + 0.2, 0.0, 0.2 + 0.1]));
    assert_eq!(fly(&[], &[]), fly(&[0], &[0.0; 3]));
    // The bound is 0.505 N here; sums are clamped after they are added.
    assert_eq!(fly(&[0, 0], &[5.0, 0.0, 0.0, -4.0, 0.0, 0.0]), fly(&[0], &[0.9, 0.0, 0.0]));
    assert_eq!(fly(&[0], &[f64::MAX, 0.0, 0.0]), fly(&[0, 0], &[f64::MAX, 0.0, 0.0, f64::MAX, 0.0, 0.0]));
}

/// A timeout is termination, since the rules pay −1 for it, and truncation, since it is the horizon.
#[test]
fn a_timeout_is_both() {
    let scenario = anywhere(0, &[0.5, 0.0, 0.0, 1.0], 4);
    assert_eq!(TASKS[0].horizon(scenario.recipe()), 20);
    let mut episode = TASKS[0].start(&scenario).unwrap();
    let mut report = StepReport::default();
    while !episode.done() {
        episode.step(JointAction::HOLD, &mut report).unwrap();
    }
    assert_eq!((episode.steps(), report.agents[0].terminated, report.agents[0].truncated), (20, true, true));
    assert!(report.agents[0].reward < -0.9);
    let flown = episode.flown();
    assert_eq!((flown.lost, flown.goal), (1, Some(0.0)));
}

#[test]
fn restart_forgets_everything() {
    let scenario = anywhere(1, &[1.0, 0.1, 0.2, 0.2, 1.0], 9);
    let setup = Setup::read(scenario.recipe()).unwrap();
    let start = setup.start(&mut Seeded::new(scenario.seed())).unwrap();
    let mut flight = Flight::new(setup, &start);
    let fresh = flight.state_hash();
    for _ in 0..100 {
        flight.fly([[0.3, -0.2, 0.1]; MAX_DEPUTIES]);
    }
    assert_ne!(flight.state_hash(), fresh);
    flight.restart(&start);
    assert_eq!(flight.state_hash(), fresh);
    assert!((0..MAX_DEPUTIES).all(|i| flight.status(i) == Status::Active));
    let mut seen = [9.0; 8 * MAX_DEPUTIES + 3];
    flight.observe_into(&mut seen);
    assert_eq!(seen[8 * MAX_DEPUTIES..], [0.0; 3]);
    assert_eq!(f64::from(seen[0]), f64::from((start.states[0][0] / 100.0) as f32));
}

/// The default start is the original's: the inner radius is 100 m to the bit.
#[test]
fn the_default_radii_are_those_of_the_original() {
    let recipe = Recipe::new(&TASKS[1]).unwrap();
    let setup = Setup::read(&recipe).unwrap();
    assert_eq!(setup.start_radius * crate::docking::constants::INNER_RATIO, 100.0);
    assert_eq!(
        (setup.deputies, setup.speed_ratio, setup.time_limit, setup.thrust_bound),
        (3, 0.8, 2000, 1.0)
    );
}

/// Cross-entropy over the six numbers finds a reflex that docks, from numbers that mostly do not.
#[test]
fn the_reflex_can_be_learnt() {
    use crate::chance::{Chance, Stream};
    let reflex = TASKS[0].reflex();
    let mut chance = Seeded::new(Seed::user(7).unwrap());
    let docked = |numbers: &[f64], seeds: std::ops::Range<u64>| -> (f64, f64) {
        let n = (seeds.end - seeds.start) as f64;
        let flown = seeds.map(|seed| {
            let scenario = super::at_level("docking/single", 2, seed);
            fly(&scenario, (reflex.policy)(numbers).as_mut()).unwrap().0
        });
        let (score, won) = flown.fold((0.0, 0.0), |(s, w), f| (s + f.score, w + f.goal.unwrap_or(0.0)));
        (score / n, won / n)
    };
    let mut mean = vec![0.5; reflex.names.len()];
    let mut spread = vec![0.3; reflex.names.len()];
    let mut first = 0.0;
    for generation in 0..6 {
        let mut tried: Vec<(f64, Vec<f64>)> = (0..24)
            .map(|_| {
                let numbers: Vec<f64> = mean
                    .iter()
                    .zip(&spread)
                    .map(|(m, s)| (m + 1.7 * s * chance.between(Stream::Planner, -1.0, 1.0)).clamp(0.0, 1.0))
                    .collect();
                let (score, won) = docked(&numbers, 0..4);
                first += if generation == 0 { won / 24.0 } else { 0.0 };
                (score, numbers)
            })
            .collect();
        tried.sort_by(|a, b| b.0.total_cmp(&a.0));
        for i in 0..mean.len() {
            let best: Vec<f64> = tried[..6].iter().map(|(_, numbers)| numbers[i]).collect();
            mean[i] = best.iter().sum::<f64>() / 6.0;
            spread[i] = (best.iter().map(|v| (v - mean[i]) * (v - mean[i])).sum::<f64>() / 6.0).sqrt() + 0.02;
        }
    }
    let (_, learnt) = docked(&mean, 100..120);
    assert!(first < 0.5 && learnt >= 0.9, "{first} at first, {learnt} learnt");
}
