//! Speed of the tasking world: batches, single environments and resets, with random actions and all observations.

mod windows;

use std::sync::Arc;
use std::time::Instant;

use anyhow::Context;
use commands::machine;
use env_core::episode_rng::{EpisodeRng, RngStream, SeededRng};
use env_core::rollout::{ReplayItem, replay_all, roll_out};
use env_core::tasking::environments::TaskingEnvironment;
use env_core::tasking::simulation::{AgentAction, StepResult, TaskingSim, step_all};
use env_core::tasking::tick::dispatch::InstructionSet;
use env_core::{Recipe, Scenario, Seed, TaskSpec};
use serde_json::{Value, json};

use crate::Row;

/// Environments of a batch.
const ENVS: usize = 64;
/// Episodes that are replayed together, as many as an audit replays on one thread.
const AUDITED: usize = 32;
/// Duration of a measurement, s.
const SECONDS: f64 = 3.0;
/// Multiples of BSK-RL's speed that a batch, a single environment and a reset must reach.
const BATCH_GOAL: f64 = 1000.0;
const SINGLE_GOAL: f64 = 250.0;
const RESET_GOAL: f64 = 100.0;

/// Speed of BSK-RL in one environment, measured for this project by `bsk_peers.py` in another run.
struct OriginalSpeed {
    /// Time of a second of a satellite, ns.
    satellite_second_ns: f64,
    /// Duration of a reset, s.
    reset_s: f64,
}

impl OriginalSpeed {
    const fn of(environment: TaskingEnvironment) -> Self {
        let (satellite_second_ns, reset_s) = match environment {
            TaskingEnvironment::Scanning(_) => (57_000.0, 0.0626),
            TaskingEnvironment::Imaging(_) => (254_000.0, 0.280),
            TaskingEnvironment::Constellation(_) => (175_000.0, 0.565),
        };
        Self { satellite_second_ns, reset_s }
    }
}

/// Measures the environments of the world.
pub(crate) fn measure() -> anyhow::Result<Vec<Row>> {
    let mut rows = vec![machine_row()];
    for environment in TaskingEnvironment::defaults() {
        rows.push(Stepper::new(environment, ENVS)?.row(BATCH_GOAL)?);
        rows.push(Stepper::new(environment, 1)?.row(SINGLE_GOAL)?);
        rows.push(reset_row(environment)?);
        if matches!(environment, TaskingEnvironment::Imaging(_)) {
            rows.push(windows::row(environment)?);
        }
    }
    for task in env_core::tasks().filter(|task| task.world() == env_core::tasking::WORLD_ID) {
        rows.push(audit_row(task)?);
    }
    Ok(rows)
}

/// Measures one environment for a number of seconds, and its resets for a third of that. Returns the rates as JSON.
pub(crate) fn measure_turn(id: &str, envs: usize, seconds: f64) -> anyhow::Result<Value> {
    let environment =
        TaskingEnvironment::from_id(id).with_context(|| format!("there is no environment {id}"))?;
    let mut stepper = Stepper::new(environment, envs.max(1))?;
    let taken = stepper.run_for(seconds)?;
    Ok(json!({
        "cpu": machine::cpu_model(),
        "instruction_set": machine::instruction_set(),
        "satellite_seconds_per_s": stepper.satellite_seconds / taken,
        "steps_per_s": stepper.steps as f64 / taken,
        "resets_per_s": stepper.resets as f64 / taken,
        "reset_s": seconds_per_reset(environment, seconds / 3.0)?,
    }))
}

/// Environments that are stepped side by side; each is reset when its episode ends.
struct Stepper {
    environment: TaskingEnvironment,
    sims: Vec<TaskingSim>,
    actions: Vec<Vec<Option<AgentAction>>>,
    rng: SeededRng,
    next_seed: u64,
    observation: Vec<f64>,
    set: InstructionSet,
    satellite_seconds: f64,
    steps: usize,
    resets: usize,
    part_seconds: [f64; 4],
}

impl Stepper {
    fn new(environment: TaskingEnvironment, envs: usize) -> anyhow::Result<Self> {
        let mut stepper = Self {
            environment,
            sims: Vec::new(),
            actions: vec![Vec::new(); envs],
            rng: SeededRng::new(Seed::user(0).context("0 is a seed")?),
            next_seed: 1,
            observation: Vec::new(),
            set: InstructionSet::detect(),
            satellite_seconds: 0.0,
            steps: 0,
            resets: 0,
            part_seconds: [0.0; 4],
        };
        for _ in 0..envs {
            let sim = stepper.reset()?;
            stepper.sims.push(sim);
        }
        Ok(stepper)
    }

    /// Starts an episode of a new seed.
    fn reset(&mut self) -> anyhow::Result<TaskingSim> {
        self.next_seed += 1;
        let mut rng = SeededRng::new(Seed::user(self.next_seed).context("the seed is too large")?);
        Ok(TaskingSim::new(self.environment.setup(&mut rng))?)
    }

    fn draw_actions(&mut self) {
        for (sim, actions) in self.sims.iter().zip(&mut self.actions) {
            actions.clear();
            for index in 0..sim.len() {
                let count = sim.action_count(index) as f64;
                let action = (self.rng.uniform(RngStream::Policy) * count) as usize;
                actions.push(sim.needs_action(index).then_some(AgentAction::Index(action)));
            }
        }
    }

    /// Steps every environment once, observes it, and resets those that ended.
    fn step(&mut self) -> anyhow::Result<()> {
        let mut part = Instant::now();
        let mut lap = |seconds: &mut f64| {
            *seconds += part.elapsed().as_secs_f64();
            part = Instant::now();
        };
        self.draw_actions();
        lap(&mut self.part_seconds[0]);
        let results: Vec<StepResult> = if self.sims.len() == 1 {
            vec![self.sims[0].step(&self.actions[0], self.set)?]
        } else {
            let mut sims: Vec<_> = self.sims.iter_mut().collect();
            step_all(&mut sims, &self.actions, self.set).into_iter().collect::<Result<_, _>>()?
        };
        lap(&mut self.part_seconds[1]);
        for (index, result) in results.iter().enumerate() {
            self.steps += 1;
            self.satellite_seconds += result.elapsed_s * self.sims[index].len() as f64;
            if result.truncated || result.terminated.iter().any(|ended| *ended) {
                self.resets += 1;
                self.sims[index] = self.reset()?;
                lap(&mut self.part_seconds[2]);
            }
            let sim = &mut self.sims[index];
            self.observation.clear();
            for satellite in 0..sim.len() {
                sim.observe(satellite, &mut self.observation)?;
            }
            std::hint::black_box(&self.observation);
            lap(&mut self.part_seconds[3]);
        }
        Ok(())
    }

    /// Steps for at least this many seconds; returns the seconds that it took.
    fn run_for(&mut self, seconds: f64) -> anyhow::Result<f64> {
        let begun = Instant::now();
        while begun.elapsed().as_secs_f64() < seconds {
            self.step()?;
        }
        Ok(begun.elapsed().as_secs_f64())
    }

    /// Steps for the duration of a measurement. The goal is a multiple of BSK-RL's speed.
    fn row(mut self, goal: f64) -> anyhow::Result<Row> {
        let seconds = self.run_for(SECONDS)?;
        let ns = seconds * 1e9 / self.satellite_seconds;
        let original = OriginalSpeed::of(self.environment).satellite_second_ns;
        let share = self.part_seconds.map(|part| 100.0 * part / seconds);
        Ok(Row {
            label: format!("{} × {}", self.environment.id(), self.sims.len()),
            measured: format!(
                "{ns:.1} ns a satellite-second, {:.0} steps/s, {:.0} resets/s (ticks {:.0} %, resets {:.0} %, observations {:.0} %)",
                self.steps as f64 / seconds,
                self.resets as f64 / seconds,
                share[1],
                share[2],
                share[3],
            ),
            goal: format!("{goal} times BSK-RL, {original:.0} ns"),
            ratio: Some(original / ns / goal),
        })
    }
}

/// Names processor and instruction set.
fn machine_row() -> Row {
    Row {
        label: "machine".to_owned(),
        measured: format!("{}, {}", machine::cpu_model(), machine::instruction_set()),
        goal: String::new(),
        ratio: None,
    }
}

/// Measures resets without any steps.
fn reset_row(environment: TaskingEnvironment) -> anyhow::Result<Row> {
    let (seconds, original) = (seconds_per_reset(environment, 1.0)?, OriginalSpeed::of(environment).reset_s);
    Ok(Row {
        label: format!("{} reset", environment.id()),
        measured: format!("{:.0} µs", seconds * 1e6),
        goal: format!("{RESET_GOAL} times BSK-RL, {:.0} ms", original * 1e3),
        ratio: Some(original / seconds / RESET_GOAL),
    })
}

/// Measures replays of episodes of level 3 on one core, as an audit makes them.
fn audit_row(task: &'static dyn TaskSpec) -> anyhow::Result<Row> {
    /// Goal for the scanning task, episodes/s.
    const GOAL: f64 = 500.0;
    let recipe = Arc::new(Recipe::with_params(task, task.levels().params(3))?);
    let mut episodes = Vec::with_capacity(AUDITED);
    for seed in 0..AUDITED as u64 {
        let scenario = Scenario::new(Arc::clone(&recipe), Seed::user(seed).context("the seed is too large")?);
        let mut policy = task.policy("heuristic", &scenario, 0)?;
        let log = roll_out(&scenario, &mut *policy)?.log;
        episodes.push((scenario, log));
    }
    let items: Vec<_> = episodes.iter().map(|(scenario, log)| ReplayItem { scenario, log }).collect();
    let begun = Instant::now();
    let mut replayed = 0;
    while begun.elapsed().as_secs_f64() < 1.0 {
        replayed += replay_all(&items).into_iter().filter(Result::is_ok).count();
    }
    let rate = replayed as f64 / begun.elapsed().as_secs_f64();
    let is_scanning = task.id() == "tasking/scanning";
    Ok(Row {
        label: format!("audit of {}, {AUDITED} episodes together", task.id()),
        measured: format!("{rate:.0} episodes/s"),
        goal: if is_scanning { format!("≥ {GOAL} episodes/s") } else { String::new() },
        ratio: is_scanning.then_some(rate / GOAL),
    })
}

/// Seconds of a reset with its observation, measured for about `seconds` seconds.
fn seconds_per_reset(environment: TaskingEnvironment, seconds: f64) -> anyhow::Result<f64> {
    let mut stepper = Stepper::new(environment, 1)?;
    let begun = Instant::now();
    let mut count = 0;
    while begun.elapsed().as_secs_f64() < seconds {
        stepper.sims[0] = stepper.reset()?;
        for satellite in 0..stepper.sims[0].len() {
            stepper.sims[0].observe(satellite, &mut stepper.observation)?;
        }
        stepper.observation.clear();
        count += 1;
    }
    Ok(begun.elapsed().as_secs_f64() / f64::from(count))
}
