//! `sparring bench`: environment steps a second on one thread.

use std::hint::black_box;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use clap::ValueEnum;
use env_core::chance::{Chance, Seeded, Stream};
use env_core::kessler::constants::{FRAGMENTS, HORIZON, SATELLITES};
use env_core::kessler::flight::Flight;
use env_core::kessler::setup::Setup;
use env_core::kessler::{Kessler, TASKS};
use env_core::{JointAction, Recipe, Seed, SeedSpace};
use serde::Serialize;

use super::bootstrap::quantile;
use super::output;

/// Debris at the start: that of the public environment's hardest task.
const DEBRIS: u32 = 50;
/// What a step of the public Python kessler-env costs in-process, as measured for this project on one core.
const PYTHON_ENV_US_PER_STEP: f64 = 125.0;
/// Pieces a measurement is cut into; their median is told, so that one disturbance does not count.
const SLICES: u32 = 20;
/// Share of the time spent before anything is counted.
const WARM_UP: f64 = 0.1;
/// Steps between two looks at the clock.
const STEPS_PER_LOOK: u32 = 1000;
/// Largest burn of the bench per axis, LU/TU.
const BURN: f64 = 0.05;
/// Joint actions drawn beforehand, flown in turn: more than an episode has steps, and prime to it.
const ACTIONS: usize = 997;

/// A world to measure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum World {
    /// Three satellites and 50 debris (survival).
    Kessler,
}

/// Measure how many environment steps a second one thread does.
///
/// Steps one environment in this process: 50 debris, small burns by about half of the satellites in every step, a fresh
/// seed for every episode, f32 observations written after every step and reset, resets included. The time is cut into
/// 20 slices; their median is told, and the 5th and 95th percentile as its spread.
#[derive(Debug, clap::Args)]
#[command(after_help = AFTER_HELP)]
pub struct Args {
    /// The world
    #[arg(long, value_enum, default_value = "kessler")]
    env: World,
    /// How long to measure, seconds
    #[arg(long, value_name = "S", default_value = "3", value_parser = seconds)]
    seconds: f64,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

const AFTER_HELP: &str = "\
JSON (--json): one object {env, debris, seconds, slices, single_thread_env_steps_per_s, low, high, us_per_step, \
resets_per_s, python_env_us_per_step, times_python_env}; low and high are the 5th and 95th percentile of the slices. \
The public Python environment's 125 µs a step is a stated constant, measured elsewhere; bench/ measures both here.

Examples:
  sparring bench
  sparring bench --env kessler --seconds 10 --json";

/// What was measured.
#[derive(Debug, Serialize)]
pub struct Measured {
    env: &'static str,
    debris: u32,
    seconds: f64,
    slices: u32,
    /// See the help of the command.
    pub single_thread_env_steps_per_s: f64,
    /// See the help of the command.
    pub low: f64,
    /// See the help of the command.
    pub high: f64,
    us_per_step: f64,
    resets_per_s: f64,
    /// See the help of the command.
    pub python_env_us_per_step: f64,
    /// See the help of the command.
    pub times_python_env: f64,
}

/// Measures and prints.
///
/// # Errors
/// A world that cannot start, or stdout that cannot be written.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let World::Kessler = args.env;
    let measured = measure(args.seconds)?;
    if args.json {
        output::print_json(&measured)?;
    } else {
        output::print(&measured.sentences())?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Measures for about so many seconds.
///
/// # Errors
/// Never in practice: the scenarios are valid.
pub fn measure(seconds: f64) -> anyhow::Result<Measured> {
    let mut bench = Bench::new()?;
    bench.fly_for(Duration::from_secs_f64(seconds * WARM_UP))?;
    let slice = Duration::from_secs_f64(seconds / f64::from(SLICES));
    let mut rates = Vec::new();
    let mut resets = Vec::new();
    for _ in 0..SLICES {
        let (steps, begun, took) = bench.fly_for(slice)?;
        rates.push(steps / took);
        resets.push(begun / took);
    }
    rates.sort_by(f64::total_cmp);
    resets.sort_by(f64::total_cmp);
    let at = |sorted: &[f64], share| quantile(sorted, share).unwrap_or(0.0);
    let median = at(&rates, 0.5);
    Ok(Measured {
        env: "kessler",
        debris: DEBRIS,
        seconds,
        slices: SLICES,
        single_thread_env_steps_per_s: median,
        low: at(&rates, 0.05),
        high: at(&rates, 0.95),
        us_per_step: 1e6 / median,
        resets_per_s: at(&resets, 0.5),
        python_env_us_per_step: PYTHON_ENV_US_PER_STEP,
        times_python_env: PYTHON_ENV_US_PER_STEP * median / 1e6,
    })
}

impl Measured {
    fn sentences(&self) -> String {
        format!(
            "{}, one thread, {} debris, observations written, resets included ({} slices in {} s)\n\
             {:.0} env-steps/s ({:.0} to {:.0}), {:.3} µs a step, {:.0} resets/s\n\
             {:.0} times the public Python environment at {} µs a step",
            self.env,
            self.debris,
            self.slices,
            self.seconds,
            self.single_thread_env_steps_per_s,
            self.low,
            self.high,
            self.us_per_step,
            self.resets_per_s,
            self.times_python_env,
            self.python_env_us_per_step
        )
    }
}

/// One environment and what it is flown with.
struct Bench {
    setup: Setup,
    flight: Flight<Seeded>,
    actions: Vec<([u32; SATELLITES], [f64; 2 * SATELLITES], usize)>,
    next_action: usize,
    episodes: u64,
    observation: Vec<f32>,
}

impl Bench {
    fn new() -> anyhow::Result<Self> {
        let [task, ..]: &'static [Kessler; 4] = &TASKS;
        let recipe = Recipe::with_params(task, [("debris", f64::from(DEBRIS))].into_iter())?;
        let setup = Setup::read(&recipe)?;
        let (start, chance) = start(&setup, 0)?;
        let bodies = DEBRIS as usize + SATELLITES * FRAGMENTS;
        let mut bench = Self {
            flight: Flight::new(task.objective(), setup.clone(), &start, chance),
            setup,
            actions: actions(),
            next_action: 0,
            episodes: 1,
            observation: vec![0.0; SATELLITES * 6 + bodies * 5],
        };
        bench.look();
        Ok(bench)
    }

    /// Steps for at least this long: (steps, resets, seconds).
    fn fly_for(&mut self, time: Duration) -> anyhow::Result<(f64, f64, f64)> {
        let begun = Instant::now();
        let episodes = self.episodes;
        let mut steps = 0.0;
        loop {
            for _ in 0..STEPS_PER_LOOK {
                self.step()?;
            }
            steps += f64::from(STEPS_PER_LOOK);
            let took = begun.elapsed();
            if took >= time {
                return Ok((steps, (self.episodes - episodes) as f64, took.as_secs_f64()));
            }
        }
    }

    fn step(&mut self) -> anyhow::Result<()> {
        let (agents, values, count) = &self.actions[self.next_action];
        self.next_action = (self.next_action + 1) % ACTIONS;
        let action = JointAction { agents: &agents[..*count], values: &values[..2 * count] };
        let stepped = self.flight.step(black_box(action))?;
        self.look();
        if stepped.done {
            let (start, chance) = start(&self.setup, self.episodes)?;
            self.flight.restart(&start, chance);
            self.episodes += 1;
            self.look();
        }
        Ok(())
    }

    fn look(&mut self) {
        self.flight.observe_into(&mut self.observation, DEBRIS as usize + SATELLITES * FRAGMENTS);
        black_box(&self.observation);
    }
}

fn start(setup: &Setup, episode: u64) -> anyhow::Result<(env_core::kessler::setup::Start, Seeded)> {
    let mut chance = Seeded::new(Seed::in_space(SeedSpace::User, episode));
    Ok((setup.start(&mut chance)?, chance))
}

/// Small burns by about half of the satellites in every step, drawn beforehand so that drawing is not measured.
fn actions() -> Vec<([u32; SATELLITES], [f64; 2 * SATELLITES], usize)> {
    let mut chance = Seeded::new(Seed::in_space(SeedSpace::User, u64::from(HORIZON)));
    let mut draw = || {
        let (mut agents, mut values, mut count) = ([0; SATELLITES], [0.0; 2 * SATELLITES], 0);
        for satellite in 0..SATELLITES as u32 {
            if chance.uniform(Stream::Policy) < 0.5 {
                agents[count] = satellite;
                values[2 * count] = chance.between(Stream::Policy, -BURN, BURN);
                values[2 * count + 1] = chance.between(Stream::Policy, -BURN, BURN);
                count += 1;
            }
        }
        (agents, values, count)
    };
    (0..ACTIONS).map(|_| draw()).collect()
}

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (0.05..=3600.0).contains(&value) => Ok(value),
        _ => Err("measure for 0.05 to 3600 seconds".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_measured_is_consistent() {
        let found = measure(0.2).unwrap();
        assert!(
            found.low <= found.single_thread_env_steps_per_s
                && found.single_thread_env_steps_per_s <= found.high
        );
        assert!((found.us_per_step * found.single_thread_env_steps_per_s - 1e6).abs() < 1.0);
        // Small burns lose few satellites early: episodes are nearly always as long as the horizon.
        let length = found.single_thread_env_steps_per_s / found.resets_per_s;
        assert!((20.0..=60.0).contains(&length), "{length} steps per reset");
        assert!(serde_json::to_value(&found).unwrap()["single_thread_env_steps_per_s"].is_f64());
    }

    #[test]
    fn satellites_burn_and_some_are_lost() {
        let mut bench = Bench::new().unwrap();
        bench.fly_for(Duration::from_millis(1)).unwrap();
        assert!(bench.episodes > 10);
        let burning = bench.actions.iter().filter(|(_, _, count)| *count > 0).count();
        assert!(burning > ACTIONS / 2 && burning < ACTIONS);
    }
}
