//! Laws: determinism, bounds, and that deputies that have left have no effect.

use proptest::prelude::*;
use serde_json::json;

use crate::admission::admit;
use crate::docking::DOCKING_TASKS;
use crate::docking::constants::MAX_DEPUTIES;
use crate::docking::end_conditions::DeputyStatus;
use crate::docking::relative_motion::{distance, separation, speed, speed_limit};
use crate::docking::setup::DockingSetup;
use crate::docking::simulation::DockingSim;
use crate::episode_rng::SeededRng;
use crate::log::{ActionLog, JointAction, Precision};
use crate::rollout::{replay, roll_out};
use crate::seed::Seed;
use crate::task::{Recipe, Scenario, StepReport, TaskSpec};

/// A scenario with each param at a share of its range.
fn scenario_at(task: usize, shares: &[f64], seed: u64) -> Scenario {
    let task = &DOCKING_TASKS[task];
    let params = task.params().iter().zip(shares).map(|(spec, share)| {
        let value = spec.min + (spec.max - spec.min) * share;
        (spec.name, if spec.whole { libm::round(value) } else { value })
    });
    Scenario::new(Recipe::with_params(task, params).unwrap(), Seed::user(seed).unwrap())
}

/// Strategy for the arguments of [`scenario_at`].
fn shares() -> impl Strategy<Value = Vec<f64>> {
    proptest::collection::vec(0.0..=1.0f64, 5)
}

/// Strategy for thrusts, each of one deputy; some ids and sizes are out of range.
fn thrusts() -> impl Strategy<Value = Vec<(u32, [f64; 3])>> {
    let axis = -2.0..2.0f64;
    proptest::collection::vec((0u32..5, [axis.clone(), axis.clone(), axis]), 1..60)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// The same scenario and actions give the same bits, also after a JSON round trip of the scenario and by replay. Scores
    /// are in range, values are finite, and rewards sum to the score.
    #[test]
    fn episodes_are_deterministic_and_bounded(
        task in 0usize..2, shares in shares(), seed in 0u64..1 << 50, thrusts in thrusts(),
    ) {
        let scenario = scenario_at(task, &shares, seed);
        let text = scenario.to_json().to_string();
        let again = Scenario::from_json(&serde_json::from_str(&text).unwrap()).unwrap();
        prop_assert_eq!(scenario.id(), again.id());
        let agents = DOCKING_TASKS[task].agents(scenario.recipe());
        let mut log = ActionLog::new(3, Precision::F64);
        let mut results = Vec::new();
        for scenario in [&scenario, &again] {
            let mut episode = DOCKING_TASKS[task].start(scenario).unwrap();
            let (mut report, mut sum) = (StepReport::default(), 0.0);
            let mut returns = [0.0; MAX_DEPUTIES];
            log = ActionLog::new(3, Precision::F64);
            while !episode.done() {
                let (agent, thrust) = thrusts[episode.steps() as usize % thrusts.len()];
                let agent = agent % agents;
                log.push_entry(agent, &thrust);
                log.end_step();
                episode.step(JointAction { agents: &[agent], values: &thrust }, &mut report).unwrap();
                sum += report.reward;
                for agent in &report.agents {
                    assert!(agent.reward.is_finite());
                    returns[agent.agent as usize] += agent.reward;
                }
            }
            let seen = episode.telemetry();
            for deputy in seen["deputies"].as_array().unwrap() {
                for value in deputy["observation"].as_array().unwrap() {
                    prop_assert!(value.as_f64().is_some_and(f64::is_finite));
                }
            }
            prop_assert_eq!(episode.outcome().total_reward, sum);
            let mean = returns.iter().sum::<f64>() / f64::from(agents);
            // The same rewards in another order of summation: at most 2000 roundings of 14.
            prop_assert!((mean - sum).abs() < 1e-10);
            results.push((episode.state_hash(), episode.outcome()));
        }
        prop_assert_eq!(results[0], results[1]);
        prop_assert_eq!(replay(&scenario, &log).unwrap(), results[0].1);
        let range = DOCKING_TASKS[task].score_range();
        prop_assert!(results[0].1.score >= range.min && results[0].1.score <= range.max);
    }

    /// The worst case: the largest initial speed of a layout, and full thrust in its direction.
    #[test]
    fn score_range_holds_in_the_worst_case(
        position in [-5000.0..5000.0f64, -5000.0..5000.0, -5000.0..5000.0],
        direction in [-1.0..=1.0f64, -1.0..=1.0, -1.0..=1.0],
    ) {
        let row: Vec<f64> = position.into_iter().chain(direction.map(|v| 10.0 * libm::copysign(1.0, v))).collect();
        prop_assume!(distance(&[position[0], position[1], position[2], 0.0, 0.0, 0.0]) > 1.0);
        let scenario = Scenario::from_json(&json!({
            "task": "docking/single", "seed": 1,
            "layout": {"mode": "replace", "bodies": {"deputies": [row]}},
        })).unwrap();
        let mut episode = DOCKING_TASKS[0].start(&scenario).unwrap();
        let mut report = StepReport::default();
        while !episode.done() {
            episode.step(JointAction { agents: &[0], values: &direction.map(|v| 9.0 * v) }, &mut report).unwrap();
        }
        let range = DOCKING_TASKS[0].score_range();
        let score = episode.outcome().score;
        prop_assert!(score >= range.min && score <= range.max, "{}", score);
    }

    /// A deputy that has left keeps its state and gets no report; actions for it change nothing.
    #[test]
    fn deputies_that_left_have_no_effect(seed in 0u64..1 << 50, thrusts in thrusts()) {
        let scenario = scenario_at(1, &[1.0, 0.0, 0.8, 0.3, 1.0], seed);
        let (mut one, mut two) = (DOCKING_TASKS[1].start(&scenario).unwrap(), DOCKING_TASKS[1].start(&scenario).unwrap());
        let (mut other_report, mut report) = (StepReport::default(), StepReport::default());
        let mut left = [false; MAX_DEPUTIES];
        let mut last = one.telemetry();
        while !one.done() {
            let (agent, thrust) = thrusts[one.steps() as usize % thrusts.len()];
            one.step(JointAction { agents: &[agent], values: &thrust }, &mut report).unwrap();
            let (agents, values): (Vec<u32>, Vec<[f64; 3]>) = (0..5)
                .filter(|&i| left[i as usize] || i == agent)
                .map(|i| (i, if i == agent { thrust } else { [1.0, -1.0, 1.0] }))
                .unzip();
            two.step(JointAction { agents: &agents, values: &values.concat() }, &mut other_report).unwrap();
            prop_assert_eq!(&report, &other_report);
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

    /// Starts are within the start radius and the speed ratio, and apart from each other.
    #[test]
    fn starts_respect_the_params(shares in shares(), seed in 0u64..1 << 50) {
        let scenario = scenario_at(1, &shares, seed);
        let setup = DockingSetup::read(scenario.recipe()).unwrap();
        let start = setup.sample_starts(&mut SeededRng::new(scenario.seed())).unwrap();
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

    /// More deputies keep the first ones; another radius keeps the directions.
    #[test]
    fn changing_one_param_keeps_the_other_draws(seed in 0u64..1 << 50) {
        let start = |shares: [f64; 5]| {
            let scenario = scenario_at(1, &shares, seed);
            DockingSetup::read(scenario.recipe()).unwrap().sample_starts(&mut SeededRng::new(scenario.seed())).unwrap()
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

    /// The reference plan reaches the reference outcome, and its critique has a failure for each lost deputy only.
    #[test]
    fn reference_plans_reach_their_reference(task in 0usize..2, shares in shares(), seed in 0u64..1 << 50) {
        let scenario = scenario_at(task, &shares, seed);
        let bracket = admit(&scenario).bracket.unwrap();
        prop_assert_eq!(replay(&scenario, &bracket.reference_plan).unwrap(), bracket.reference);
        let seen = DOCKING_TASKS[task].critique(&scenario, &bracket.reference_plan).unwrap();
        prop_assert_eq!(seen.failures.len() as u32, bracket.reference.lost);
        prop_assert!((-1.0..=1.0).contains(&seen.assessment.value));
    }
}

#[test]
fn thrusts_are_summed_and_none_is_coasting() {
    let scenario = scenario_at(1, &[0.0, 0.2, 0.2, 1.0, 0.5], 4);
    let hash_after = |agents: &[u32], values: &[f64]| {
        let mut episode = DOCKING_TASKS[1].start(&scenario).unwrap();
        episode.step(JointAction { agents, values }, &mut StepReport::default()).unwrap();
        episode.state_hash()
    };
    assert_eq!(
        hash_after(&[0, 0], &[0.1, 0.0, 0.2, 0.2, 0.0, 0.1]),
        hash_after(&[0], &[0.1 + 0.2, 0.0, 0.2 + 0.1])
    );
    assert_eq!(hash_after(&[], &[]), hash_after(&[0], &[0.0; 3]));
    // The bound is 0.505 N here; sums are clamped after they are added.
    assert_eq!(hash_after(&[0, 0], &[5.0, 0.0, 0.0, -4.0, 0.0, 0.0]), hash_after(&[0], &[0.9, 0.0, 0.0]));
    assert_eq!(
        hash_after(&[0], &[f64::MAX, 0.0, 0.0]),
        hash_after(&[0, 0], &[f64::MAX, 0.0, 0.0, f64::MAX, 0.0, 0.0])
    );
}

/// A timeout is a termination, since it has a reward of −1, and a truncation, since it is the horizon.
#[test]
fn timeout_is_termination_and_truncation() {
    let scenario = scenario_at(0, &[0.5, 0.0, 0.0, 1.0], 4);
    assert_eq!(DOCKING_TASKS[0].horizon(scenario.recipe()), 20);
    let mut episode = DOCKING_TASKS[0].start(&scenario).unwrap();
    let mut report = StepReport::default();
    while !episode.done() {
        episode.step(JointAction::HOLD, &mut report).unwrap();
    }
    assert_eq!((episode.steps(), report.agents[0].terminated, report.agents[0].truncated), (20, true, true));
    assert!(report.agents[0].reward < -0.9);
    let outcome = episode.outcome();
    assert_eq!((outcome.lost, outcome.goal), (1, Some(0.0)));
}

#[test]
fn reset_restores_the_initial_state() {
    let scenario = scenario_at(1, &[1.0, 0.1, 0.2, 0.2, 1.0], 9);
    let setup = DockingSetup::read(scenario.recipe()).unwrap();
    let start = setup.sample_starts(&mut SeededRng::new(scenario.seed())).unwrap();
    let mut sim = DockingSim::new(setup, &start);
    let fresh = sim.state_hash();
    for _ in 0..100 {
        sim.apply_thrusts([[0.3, -0.2, 0.1]; MAX_DEPUTIES]);
    }
    assert_ne!(sim.state_hash(), fresh);
    sim.reset(&start);
    assert_eq!(sim.state_hash(), fresh);
    assert!((0..MAX_DEPUTIES).all(|i| sim.status(i) == DeputyStatus::Active));
    let mut seen = [9.0; 8 * MAX_DEPUTIES + 3];
    sim.observe_into(&mut seen);
    assert_eq!(seen[8 * MAX_DEPUTIES..], [0.0; 3]);
    assert_eq!(f64::from(seen[0]), f64::from((start.states[0][0] / 100.0) as f32));
}

/// The default start equals the original's: the inner radius is 100 m to the bit.
#[test]
fn default_radii_equal_the_original() {
    let recipe = Recipe::new(&DOCKING_TASKS[1]).unwrap();
    let setup = DockingSetup::read(&recipe).unwrap();
    assert_eq!(setup.start_radius * crate::docking::constants::MIN_START_RATIO, 100.0);
    assert_eq!(
        (setup.deputies, setup.speed_ratio, setup.time_limit, setup.thrust_bound),
        (3, 0.8, 2000, 1.0)
    );
}

/// The cross-entropy method finds parameters that dock, starting from parameters that mostly do not.
#[test]
fn reflex_can_be_trained() {
    use crate::episode_rng::{EpisodeRng, RngStream};
    let reflex = DOCKING_TASKS[0].reflex();
    let mut rng = SeededRng::new(Seed::user(7).unwrap());
    let evaluate = |numbers: &[f64], seeds: std::ops::Range<u64>| -> (f64, f64) {
        let n = (seeds.end - seeds.start) as f64;
        let outcomes = seeds.map(|seed| {
            let scenario = super::at_level("docking/single", 2, seed);
            roll_out(&scenario, (reflex.policy)(numbers).as_mut()).unwrap().outcome
        });
        let (score, won) = outcomes.fold((0.0, 0.0), |(s, w), f| (s + f.score, w + f.goal.unwrap_or(0.0)));
        (score / n, won / n)
    };
    let mut mean = vec![0.5; reflex.names.len()];
    let mut spread = vec![0.3; reflex.names.len()];
    let mut first = 0.0;
    for generation in 0..6 {
        let mut candidates: Vec<(f64, Vec<f64>)> = (0..24)
            .map(|_| {
                let numbers: Vec<f64> = mean
                    .iter()
                    .zip(&spread)
                    .map(|(m, s)| {
                        (m + 1.7 * s * rng.uniform_in(RngStream::Planner, -1.0, 1.0)).clamp(0.0, 1.0)
                    })
                    .collect();
                let (score, won) = evaluate(&numbers, 0..4);
                first += if generation == 0 { won / 24.0 } else { 0.0 };
                (score, numbers)
            })
            .collect();
        candidates.sort_by(|a, b| b.0.total_cmp(&a.0));
        for i in 0..mean.len() {
            let best: Vec<f64> = candidates[..6].iter().map(|(_, numbers)| numbers[i]).collect();
            mean[i] = best.iter().sum::<f64>() / 6.0;
            spread[i] = (best.iter().map(|v| (v - mean[i]) * (v - mean[i])).sum::<f64>() / 6.0).sqrt() + 0.02;
        }
    }
    let (_, trained) = evaluate(&mean, 100..120);
    assert!(first < 0.5 && trained >= 0.9, "{first} at first, {trained} trained");
}
