//! `sparring bench`: environment steps a second on one thread.

pub mod stepped_batch;

use std::collections::BTreeMap;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::Context;
use clap::builder::PossibleValuesParser;
use env_core::batch::ObservationMode;
use env_core::world::BenchSpec;
use env_core::{Recipe, World};
use serde::Serialize;

use self::stepped_batch::SteppedBatch;
use super::machine;
use super::options::{self, ChosenOption};
use super::output::{self, Column, Report, TextTable};
use evaluation::bootstrap::quantile;

/// Slices of a measurement. Their median is reported, so that one disturbance does not count.
const SLICE_COUNT: u32 = 20;
/// Share of the measured time that is spent on warm-up.
const WARM_UP: f64 = 0.1;
/// Default number of environments: few enough to stay in the nearest caches.
const DEFAULT_ENVS: u32 = 64;
/// Observation by tracks, with the same defaults as in Python.
const TRACKS: ObservationMode = ObservationMode::Tracks { threats: 8, look_ahead: 15 };
/// Steps of the batch between two readings of the clock.
const STEPS_PER_CLOCK_READING: u32 = 16;

/// Measure the environment steps per second of one thread.
///
/// Steps a batch of environments of one world in this process, with the task and params of the world's benchmark
/// (kessler: survival with 50 debris; tasking: scanning). In every step about half of the agents take a small action, or all
/// choose one of the named actions. Every episode has a
/// new seed, and full f32 observations are written after every step and reset. Resets count as part of the measured
/// time. The time is divided into 20 slices; the result is their median, with the 5th and 95th percentile as its spread.
#[derive(Debug, clap::Args)]
#[command(after_help = after_help())]
pub struct Args {
    /// World or task to measure
    #[arg(long, value_name = "WORLD|TASK", value_parser = PossibleValuesParser::new(benchmark_names()), default_value = "kessler")]
    env: String,
    /// Set a physics option; repeat the flag to set several
    #[arg(long = "physics", value_name = "[TASK|WORLD:]NAME=CHOICE", value_parser = options::parse)]
    options: Vec<ChosenOption>,
    /// Number of environments in the batch
    #[arg(long, value_name = "N", default_value_t = DEFAULT_ENVS, value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    envs: u32,
    /// Write observations as tracks, the format for neural policies, where the world has them
    #[arg(long)]
    tracks: bool,
    /// Length of the measurement in seconds
    #[arg(long, value_name = "S", default_value = "3", value_parser = parse_seconds)]
    seconds: f64,
    /// Print the result as one JSON object
    #[arg(long)]
    json: bool,
}

fn after_help() -> String {
    format!("{}\n\n{AFTER_HELP}", options::help())
}

const AFTER_HELP: &str = "\
JSON (--json): one object {env, task, envs, tracks, debris, physics, seconds, slices, single_thread_env_steps_per_s, low, high, us_per_step, \
resets_per_s, cpu, instruction_set, python_env_us_per_step, times_python_env}; low and high are the 5th and 95th percentile of the slices. \
debris is null in worlds without debris. cpu is the model of the processor. python_env_us_per_step, the time of a step of the public original in Python, is a \
constant (kessler: 125 µs) that was measured on another machine; it is null if it was not measured. The scripts in bench/ \
measure both on this machine.

Examples:
  sparring bench
  sparring bench --physics contact=swept
  sparring bench --envs 1024 --tracks
  sparring bench --env tasking/scanning
  sparring bench --env kessler --seconds 10 --json";

/// Result of a measurement, printed as one JSON object.
#[derive(Debug, Serialize)]
pub struct Measurement {
    env: &'static str,
    task: &'static str,
    envs: usize,
    tracks: bool,
    debris: Option<u32>,
    physics: BTreeMap<&'static str, &'static str>,
    seconds: f64,
    slices: u32,
    /// Median rate in environment steps per second.
    pub single_thread_env_steps_per_s: f64,
    /// 5th percentile of the slices' rates, in steps per second.
    pub low: f64,
    /// 95th percentile of the slices' rates, in steps per second.
    pub high: f64,
    us_per_step: f64,
    resets_per_s: f64,
    /// Model of the processor.
    cpu: String,
    /// Widest instruction set of the processor that the simulations use.
    instruction_set: &'static str,
    /// Time of a step of the public original in Python, in microseconds; `None` if it was not measured.
    pub python_env_us_per_step: Option<f64>,
    /// Speed relative to the public original in Python.
    pub times_python_env: Option<f64>,
    /// Task, params and options as text.
    #[serde(skip)]
    pub description: String,
}

/// Measures a world and prints the result.
///
/// # Errors
/// Returns an error if the world cannot start or stdout cannot be written.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let spec = env_core::benchmark(&args.env).context("there is no such benchmark")?;
    let options = options::by_task(&args.options, &[spec.task])?.remove(spec.task.id()).unwrap_or_default();
    let options: Vec<_> = options.iter().map(|(name, choice)| (name.as_str(), choice.as_str())).collect();
    let batch = BatchSettings { envs: args.envs as usize, tracks: args.tracks };
    let measured = measure(spec, &options, batch, args.seconds)?;
    if args.json {
        output::print_json(&measured)?;
    } else {
        output::print_report(&measured.text_report())?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Settings of the measured batch.
#[derive(Debug, Clone, Copy)]
pub struct BatchSettings {
    /// Number of environments in the batch.
    pub envs: usize,
    /// True to observe by tracks; otherwise everything is observed.
    pub tracks: bool,
}

impl Default for BatchSettings {
    fn default() -> Self {
        Self { envs: DEFAULT_ENVS as usize, tracks: false }
    }
}

/// Returns the names of all worlds with benchmarks, then those of the tasks that are measured.
fn benchmark_names() -> Vec<&'static str> {
    let worlds = env_core::worlds().map(World::name);
    let tasks = env_core::worlds().flat_map(World::benchmarks).map(|spec| spec.task.id());
    worlds.chain(tasks).collect()
}

/// Runs a benchmark under these options for about `seconds` seconds.
///
/// # Errors
/// Returns an error if the world lacks an option or the observations, or the benchmark cannot start.
pub fn measure(
    spec: BenchSpec,
    options: &[(&str, &str)],
    batch: BatchSettings,
    seconds: f64,
) -> anyhow::Result<Measurement> {
    let recipe =
        Recipe::with_params(spec.task, spec.params.iter().copied())?.with_options(options.iter().copied())?;
    let options = recipe.chosen_options();
    let observe = if batch.tracks { TRACKS } else { ObservationMode::All { bodies: None } };
    let mut stepped_batch = SteppedBatch::from_recipe(recipe, batch.envs, spec.action, observe)?;
    let thread = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    thread.install(|| step_for(&mut stepped_batch, Duration::from_secs_f64(seconds * WARM_UP)))?;
    let slice = Duration::from_secs_f64(seconds / f64::from(SLICE_COUNT));
    let mut rates = Vec::new();
    let mut resets = Vec::new();
    for _ in 0..SLICE_COUNT {
        let counts = thread.install(|| step_for(&mut stepped_batch, slice))?;
        rates.push(counts.steps as f64 / counts.seconds);
        resets.push(counts.resets as f64 / counts.seconds);
    }
    rates.sort_by(f64::total_cmp);
    resets.sort_by(f64::total_cmp);
    let at = |sorted: &[f64], share| quantile(sorted, share).unwrap_or(0.0);
    let median = at(&rates, 0.5);
    let params = spec.params.iter().map(|(name, value)| format!(", {name} {value}"));
    let chosen = options.iter().map(|(name, choice)| format!(", {name} {choice}"));
    let settings: String = params.chain(chosen).collect();
    Ok(Measurement {
        env: spec.task.id().split('/').next().unwrap_or_default(),
        task: spec.task.id(),
        envs: batch.envs,
        tracks: batch.tracks,
        debris: spec.params.iter().find(|(name, _)| *name == "debris").map(|(_, value)| *value as u32),
        seconds,
        slices: SLICE_COUNT,
        single_thread_env_steps_per_s: median,
        low: at(&rates, 0.05),
        high: at(&rates, 0.95),
        us_per_step: 1e6 / median,
        resets_per_s: at(&resets, 0.5),
        cpu: machine::cpu_model(),
        instruction_set: machine::instruction_set(),
        python_env_us_per_step: spec.original_us_per_step,
        times_python_env: spec.original_us_per_step.map(|us| us * median / 1e6),
        description: format!("{}{settings}", spec.task.id()),
        physics: options,
    })
}

impl Measurement {
    fn text_report(&self) -> Report {
        let mut report = Report::default();
        report.paragraph(format!(
            "{}, one thread, observations and resets included ({} slices in {} s):",
            self.description, self.slices, self.seconds
        ));
        report.line(format!("Processor: {}, {}.", self.cpu, self.instruction_set));
        let titles = ["steps/s", "5 % quantile", "95 % quantile", "µs per step", "resets/s"];
        let mut table = TextTable::new(titles.map(Column::number));
        table.add_row([
            format!("{:.0}", self.single_thread_env_steps_per_s),
            format!("{:.0}", self.low),
            format!("{:.0}", self.high),
            format!("{:.3}", self.us_per_step),
            format!("{:.0}", self.resets_per_s),
        ]);
        report.table(table);
        if let Some((times, us)) = self.times_python_env.zip(self.python_env_us_per_step) {
            report.line(format!(
                "{times:.0} times the public Python environment, which takes {us} µs per step."
            ));
        }
        report
    }
}

/// Counts of one slice of a measurement.
struct SliceCounts {
    steps: usize,
    resets: usize,
    seconds: f64,
}

/// Steps the batch for at least `time`.
fn step_for(stepped_batch: &mut SteppedBatch, time: Duration) -> anyhow::Result<SliceCounts> {
    let begun = Instant::now();
    let (mut steps, mut resets) = (0, 0);
    loop {
        for _ in 0..STEPS_PER_CLOCK_READING {
            stepped_batch.step()?;
            steps += stepped_batch.shape().envs;
            resets += stepped_batch.ended();
        }
        let took = begun.elapsed();
        if took >= time {
            return Ok(SliceCounts { steps, resets, seconds: took.as_secs_f64() });
        }
    }
}

pub(crate) fn parse_seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (0.05..=3600.0).contains(&value) => Ok(value),
        _ => Err("must be 0.05 to 3600 seconds".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn benchmark(name: &str) -> BenchSpec {
        env_core::benchmark(name).unwrap()
    }

    #[test]
    fn measurement_is_consistent() {
        let found = measure(benchmark("kessler"), &[], BatchSettings::default(), 0.2).unwrap();
        assert!(
            found.low <= found.single_thread_env_steps_per_s
                && found.single_thread_env_steps_per_s <= found.high
        );
        assert!((found.us_per_step * found.single_thread_env_steps_per_s - 1e6).abs() < 1.0);
        // Small burns lose few satellites early: episodes are nearly always as long as the horizon.
        let length = found.single_thread_env_steps_per_s / found.resets_per_s;
        assert!((20.0..=60.0).contains(&length), "{length} steps per reset");
        let told = serde_json::to_value(&found).unwrap();
        assert!(told["single_thread_env_steps_per_s"].is_f64() && told["debris"] == 50, "{told}");
        assert!(told["python_env_us_per_step"] == 125.0 && told["times_python_env"].is_f64(), "{told}");
        assert_eq!(told.as_object().unwrap().len(), 17);
        let text = found.text_report().render(output::OutputTarget::Piped);
        let machine = format!("Processor: {}, {}.", machine::cpu_model(), machine::instruction_set());
        assert!(text.contains(&machine), "{text}");
    }

    #[test]
    fn options_are_applied_and_reported() {
        let kessler = benchmark("kessler");
        let found =
            measure(kessler, &[("contact", "swept"), ("warnings", "exact")], BatchSettings::default(), 0.1)
                .unwrap();
        let told = serde_json::to_value(&found).unwrap();
        assert_eq!(told["physics"], serde_json::json!({"contact": "swept", "warnings": "exact"}));
        assert!(
            found
                .text_report()
                .render(output::OutputTarget::Piped)
                .contains("debris 50, contact swept, warnings exact, one thread")
        );
        assert!(
            measure(kessler, &[("contact", "swept"), ("risk", "pc")], BatchSettings::default(), 0.1).is_err()
        );
    }

    #[test]
    fn tracks_are_observed_where_there_are_any() {
        let batch = BatchSettings { envs: 5, tracks: true };
        let told = measure(benchmark("kessler"), &[], batch, 0.1).unwrap();
        assert!(told.single_thread_env_steps_per_s > 0.0);
        assert!(measure(benchmark("docking"), &[], batch, 0.1).is_err());
    }

    #[test]
    fn every_benchmark_is_stepped() {
        for spec in env_core::worlds().flat_map(World::benchmarks) {
            let recipe = Recipe::with_params(spec.task, spec.params.iter().copied()).unwrap();
            let all = ObservationMode::All { bodies: None };
            let mut stepped_batch = SteppedBatch::from_recipe(recipe, 8, spec.action, all).unwrap();
            let mut ended = 0;
            for _ in 0..2100 {
                stepped_batch.step().unwrap();
                ended += stepped_batch.ended();
            }
            assert!(ended >= 8, "{}: {ended} episodes", spec.task.id());
        }
    }
}
