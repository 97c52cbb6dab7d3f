//! Tests of the tasks.

use std::sync::Arc;

use super::TASKING_TASKS;
use super::run::TaskRun;
use super::task_setup::TaskSetup;
use crate::batch::{
    Autoreset, Batch, BatchBuffers, BatchConfig, BatchError, BatchOutput, ObservationMode, SeedSequence,
};
use crate::episode_rng::{EpisodeRng, RngStream, SeededRng};
use crate::error::StepError;
use crate::log::{ActionLog, JointAction, Precision, StopReason};
use crate::rollout::{ReplayItem, replay, replay_all, roll_out};
use crate::seed::Seed;
use crate::space::ActionSpace;
use crate::task::{Recipe, Scenario, StepReport, TaskSpec};
use crate::tasking::constants::EARTH_RADIUS_M;
use crate::tasking::vector3::norm;

/// A recipe of a task at a level, of a short episode.
fn recipe(task: &'static dyn TaskSpec, level: usize) -> Arc<Recipe> {
    let levels = task.levels().params(level);
    let short = levels.filter(|(name, _)| *name != "targets").chain([("time_limit_s", 3000.0)]);
    let targets = task.params().iter().any(|param| param.name == "targets").then_some(("targets", 300.0));
    Arc::new(Recipe::with_params(task, short.chain(targets)).unwrap())
}

fn tasks() -> impl Iterator<Item = &'static dyn TaskSpec> {
    TASKING_TASKS.iter().map(|task| task as &dyn TaskSpec)
}

fn scenario(task: &'static dyn TaskSpec, level: usize, seed: u64) -> Scenario {
    Scenario::new(recipe(task, level), Seed::user(seed).unwrap())
}

fn batch(recipe: &Arc<Recipe>, envs: usize) -> (Box<dyn Batch>, BatchBuffers) {
    let config = BatchConfig::new(envs, Autoreset::SameStep, ObservationMode::All { bodies: None });
    let mut batch = recipe.task().batch(Box::new(SeedSequence::new(Arc::clone(recipe), 5)), config).unwrap();
    let mut buffers = BatchBuffers::new(batch.shape(), Autoreset::SameStep);
    batch.reset(None, &mut buffers.observations).unwrap();
    let mut needs_action = vec![false; batch.shape().agents];
    batch.write_needs_action(0, &mut needs_action);
    assert!(needs_action.iter().all(|needs| *needs), "all agents need an action after a reset");
    (batch, buffers)
}

/// An action of each agent, now and then hold: a function of slot and step.
fn actions(task: &dyn TaskSpec, slot: usize, step: usize, agents: usize) -> Vec<f32> {
    let mut rng = SeededRng::new(Seed::user((slot * 100_000 + step) as u64).unwrap());
    let count = task.action_space().names().len() as f64;
    (0..agents)
        .map(|_| {
            let draw = rng.uniform(RngStream::Policy) * 1.1;
            if draw >= 1.0 { ActionSpace::GO_ON } else { (draw * count).floor() as f32 }
        })
        .collect()
}

#[test]
fn a_batch_has_the_bits_of_single_episodes() {
    for task in tasks() {
        for level in [0, 9] {
            let recipe = recipe(task, level);
            let (mut batch, mut buffers) = batch(&recipe, 5);
            let agents = batch.shape().agents;
            let start = |batch: &dyn Batch, env: usize| {
                task.start(&batch.running_episode(env).unwrap().scenario).unwrap()
            };
            let mut singles: Vec<_> = (0..5).map(|env| start(&*batch, env)).collect();
            let mut report = StepReport::default();
            for step in 0..60 {
                let chosen: Vec<f32> = (0..5).flat_map(|env| actions(task, env, step, agents)).collect();
                batch.step(&chosen, buffers.output()).unwrap();
                for (env, single) in singles.iter_mut().enumerate() {
                    let mut log = ActionLog::new(1, Precision::F64);
                    log.push_by_agent(&task.action_space(), &chosen[env * agents..(env + 1) * agents]);
                    single.step(log.step(0), &mut report).unwrap();
                    assert_eq!(buffers.team_rewards[env].to_bits(), (report.reward as f32).to_bits());
                    assert_eq!(buffers.elapsed[env].to_bits(), (report.elapsed as f32).to_bits());
                    assert_eq!(buffers.done[env], report.done, "{} {env} {step}", task.id());
                    for agent in &report.agents {
                        let at = env * agents + agent.agent as usize;
                        assert_eq!(buffers.rewards[at].to_bits(), (agent.reward as f32).to_bits());
                        assert_eq!(
                            (buffers.terminated[at], buffers.truncated[at], buffers.needs_action[at]),
                            (agent.terminated, agent.truncated, agent.needs_action || report.done)
                        );
                    }
                    if report.done {
                        *single = start(&*batch, env);
                    }
                    assert_eq!(batch.state_hash(env), Some(single.state_hash()));
                }
                assert!(buffers.observations.iter().all(|value| value.is_finite()));
            }
        }
    }
}

#[test]
fn busy_satellites_ignore_actions_by_default() {
    let task: &'static dyn TaskSpec = &TASKING_TASKS[2];
    for (choice, changes) in [("idle", false), ("any", true)] {
        let recipe = Recipe::clone(&recipe(task, 2)).with_option("retasking", choice).unwrap();
        let scenario = Scenario::new(recipe, Seed::user(3).unwrap());
        let fly = |second: Option<f64>| {
            let mut episode = task.start(&scenario).unwrap();
            let mut report = StepReport::default();
            // Satellite 0 charges for 120 s, and satellite 1 downlinks for 60 s.
            let first = JointAction { agents: &[0, 1, 2], values: &[10.0, 11.0, 10.0] };
            episode.step(first, &mut report).unwrap();
            assert!((report.elapsed - 60.0).abs() < 1e-9, "{}", report.elapsed);
            let needs: Vec<bool> = report.agents.iter().map(|agent| agent.needs_action).collect();
            assert_eq!(needs, [false, true, false]);
            let values: Vec<f64> = second.into_iter().chain([10.0]).collect();
            let agents: &[u32] = if second.is_some() { &[0, 1] } else { &[1] };
            episode.step(JointAction { agents, values: &values }, &mut report).unwrap();
            episode.state_hash()
        };
        assert_eq!(fly(Some(12.0)) != fly(None), changes, "{choice}");
    }
}

#[test]
fn invalid_actions_name_the_agent() {
    let task: &'static dyn TaskSpec = &TASKING_TASKS[0];
    let scenario = scenario(task, 0, 1);
    let mut episode = task.start(&scenario).unwrap();
    let mut report = StepReport::default();
    for value in [-1.0, 0.5, 4.0, 1e300] {
        let action = JointAction { agents: &[0], values: &[value] };
        let error = episode.step(action, &mut report).unwrap_err();
        assert_eq!(error, StepError::UnknownAction { agent: 0, value, last: 3 });
    }
    let (mut batch, mut buffers) = batch(&recipe(task, 0), 2);
    for value in [f32::NAN, 0.5, 4.0, -2.0] {
        let error = batch.step(&[0.0, value], buffers.output()).unwrap_err();
        assert!(matches!(error, BatchError::UnknownAction { env: 1, agent: 0, last: 3, .. }), "{error}");
    }
    let mut executed = [0.0; 2];
    let output = BatchOutput { executed_actions: &mut executed, ..buffers.output() };
    batch.step(&[1.0, ActionSpace::GO_ON], output).unwrap();
    assert_eq!(executed, [1.0, ActionSpace::GO_ON]);
}

#[test]
fn brackets_are_those_of_their_plans() {
    for task in tasks() {
        let scenario = scenario(task, 3, 2);
        let bracket = task.bracket(&scenario).unwrap();
        assert_eq!(bracket.panel.len(), 8);
        assert!(bracket.reference.score >= bracket.floor - 1e-12, "{}", task.id());
        let flown = replay(&scenario, &bracket.reference_plan).unwrap();
        assert_eq!(flown, bracket.reference, "{}", task.id());
        let range = task.score_range();
        for outcome in bracket.panel.iter().chain([&bracket.reference]) {
            assert!((range.min..=range.max).contains(&outcome.score), "{outcome:?}");
        }
    }
}

#[test]
fn policies_fly_and_their_logs_replay() {
    for task in tasks() {
        for policy in task.policies() {
            let scenario = scenario(task, 2, 4);
            let flown = roll_out(&scenario, &mut *task.policy(policy.name, &scenario, 1).unwrap()).unwrap();
            assert_eq!(replay(&scenario, &flown.log).unwrap(), flown.outcome, "{}", policy.name);
            let critique = task.critique(&scenario, &flown.log).unwrap();
            let is_death = |mode: &str| ["power", "wheels", "other"].contains(&mode);
            let deaths = critique.failures.iter().filter(|failure| is_death(failure.mode)).count();
            assert_eq!(deaths, flown.outcome.lost as usize, "{}", policy.name);
            // Observations do not change an episode: the critique made none.
            assert!(critique.assessment.explanation.contains(&format!("{:.3}", flown.outcome.score)));
        }
        assert!(task.policy("none", &scenario(task, 0, 0), 0).is_err());
    }
}

#[test]
fn targets_can_be_cities() {
    let task: &'static dyn TaskSpec = &TASKING_TASKS[1];
    let recipe = Recipe::clone(&recipe(task, 1)).with_option("targets", "cities").unwrap();
    let setup = TaskSetup::read(&recipe).unwrap().draw(&mut SeededRng::new(Seed::user(1).unwrap()));
    let names: std::collections::HashSet<_> = setup.targets.iter().map(|target| &target.name).collect();
    assert_eq!((setup.targets.len(), names.len()), (300, 300));
    // More people live in the north: uniform targets would be north of the equator half of the time.
    let north = setup.targets.iter().filter(|target| target.position[2] > 0.0).count();
    assert!(north > 200, "{north}");
    assert!(setup.targets.iter().all(|target| (norm(&target.position) - EARTH_RADIUS_M).abs() < 1e-6));
}

#[test]
fn levels_are_valid() {
    for task in tasks() {
        for level in 0..task.levels().len() {
            assert!(Recipe::at_level(task, level).is_ok(), "{} {level}", task.id());
        }
        let contradiction = [("charge_min", 0.9), ("charge_max", 0.2)];
        let error = Recipe::with_params(task, contradiction.into_iter()).unwrap_err();
        assert_eq!(error.field(), "params.charge_min");
    }
}

/// BSK-RL's forecast of eclipses depends on the times of earlier observations; that of tasks does not.
#[test]
fn observations_do_not_depend_on_earlier_ones() {
    for task in tasks() {
        for seed in 0..4 {
            let scenario = scenario(task, 5, seed);
            let setup = TaskSetup::read(scenario.recipe()).unwrap();
            let [mut seldom, mut often] =
                [(); 2].map(|()| TaskRun::start(setup.clone(), scenario.seed()).unwrap());
            let agents = seldom.sim.len();
            let (mut memory, width) = (Vec::new(), seldom.sim.observation_columns(0).len());
            let mut observe = |run: &mut TaskRun| {
                let mut out = vec![0.0; agents * width];
                run.observe(&mut memory, &mut out, agents);
                out
            };
            let mut step = 0;
            while !seldom.is_done() {
                let given = actions(task, 0, step, agents);
                for run in [&mut seldom, &mut often] {
                    let chosen = run.choose(|agent| (given[agent] >= 0.0).then_some(given[agent] as usize));
                    run.step(&chosen);
                }
                observe(&mut often);
                step += 1;
            }
            assert_eq!(observe(&mut seldom), observe(&mut often), "{} {seed}", task.id());
        }
    }
}

#[test]
fn replays_in_lanes_have_single_outcomes() {
    let scenarios: Vec<Scenario> =
        tasks().flat_map(|task| [0, 3, 6, 9].map(|level| scenario(task, level, level as u64 + 11))).collect();
    let mut logs: Vec<ActionLog> = scenarios
        .iter()
        .map(|scenario| {
            let mut policy = scenario.task().policy("random", scenario, 5).unwrap();
            roll_out(scenario, &mut *policy).unwrap().log
        })
        .collect();
    // One log is too long, one too short, one has an unknown action, and one stops early.
    logs[1].end_step();
    for index in [2, 6] {
        let half = logs[index].len() / 2;
        logs[index].truncate(half);
    }
    logs[5].push_entry(0, &[99.0]);
    logs[5].end_step();
    logs[6].stopped = Some(StopReason::TooLate);
    let items: Vec<_> =
        scenarios.iter().zip(&logs).map(|(scenario, log)| ReplayItem { scenario, log }).collect();
    let outcomes = replay_all(&items);
    assert_eq!(outcomes.len(), items.len());
    for (index, (item, outcome)) in items.iter().zip(outcomes).enumerate() {
        let single = replay(item.scenario, item.log);
        assert_eq!(format!("{outcome:?}"), format!("{single:?}"));
        assert_eq!(outcome.is_err(), [1, 2, 5].contains(&index), "{index}");
    }
}
