//! `sparring replay`: replays recorded episodes and compares them with the recording.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, anyhow, bail, ensure};
use env_core::World;
use env_core::world::{FirstDifference, RecordingComparison, WorstDifference};
use serde::Serialize;
use serde_json::Value;

use super::output::{self, Column, JsonFlag, Report, TextTable};
use crate::files;

/// Replay recorded episodes and compare what happens in them.
///
/// Each file holds episodes recorded in the public original of a world, with actions, random draws and the state after every
/// step. The command replays them in the original's arithmetic with the same draws. It compares numbers within the tolerance
/// and text exactly. The exit code is 1 if a number differs by more than the tolerance or a text differs. Intended
/// differences that the world documents are listed, but do not count. tasking replays recordings of BSK-RL and has a tolerance
/// of its own for each quantity.
#[derive(Debug, clap::Args)]
#[command(after_help = AFTER_HELP)]
pub struct Args {
    /// Recordings (.json or .json.gz); the world of each file is detected from its contents
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Largest accepted absolute difference of a number, unless the world defines a larger one for it
    #[arg(long, default_value = "1e-9", value_parser = tolerance)]
    tolerance: f64,
    #[command(flatten)]
    output: JsonFlag,
}

const AFTER_HELP: &str = "\
JSON (--json): one object {tolerance, files}. Each file: {file, world, within, episodes, steps, allowed, values, first, \
documented} and the worst absolute difference of each quantity that the recording has under its name (null: not a finite number). They \
are satellite, debris, reward and total_score for kessler; state, observation, reward_distance, reward_delta_v, \
reward_velocity, reward_success, reward_failure, reward, return and done for docking (done is 1 where a flag or a reason \
differs); for tasking step_end, reward, storage, battery, attitude, rate, wheel_speed, position, velocity, net_power, panel_power, \
illumination, sampled_illumination, pointing_error, guidance, motor_torque, thruster_time, elevation, range, sun, earth_rotation, \
observation, observed_priority, observed_window, observed_eclipse, eclipse, target_window, station_window and outcome (outcome is 1 where \
an image, a flag, a count, a pair or an order differs). Times are in seconds, and the others in SI units; sun is in arcseconds. \
allowed has the largest accepted difference under the same names: the tolerance, or the precision of the recording or the \
world's own tolerance if that is larger. values has the number of compared values. first is the first step that differs, {episode (from 0), step (from 1), what}, or null; documented is a list of \
sentences.

Examples:
  sparring replay kessler-episodes.json.gz --tolerance 1e-12
  sparring replay bsk-rl-episode.json.gz --json";

/// Largest recording in bytes of unpacked JSON.
const MAX_RECORDING_BYTES: u64 = 1 << 30;

/// Comparison of one file's episodes.
#[derive(Debug, Clone, PartialEq)]
struct FileComparison {
    file: String,
    world: &'static str,
    compared: RecordingComparison,
}

impl FileComparison {
    /// Returns true if no difference exceeds its tolerance.
    const fn is_within_tolerance(&self) -> bool {
        self.compared.first.is_none()
    }
}

impl Serialize for FileComparison {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct FileReport<'a> {
            file: &'a str,
            world: &'a str,
            within: bool,
            episodes: usize,
            steps: usize,
            #[serde(flatten)]
            worst: QuantityMap<'a>,
            allowed: QuantityMap<'a>,
            values: CountMap<'a>,
            first: Option<FirstStep<'a>>,
            documented: &'a [String],
        }
        /// One number of each compared quantity, in the world's order.
        struct QuantityMap<'a>(&'a [WorstDifference], fn(&WorstDifference) -> f64);
        impl Serialize for QuantityMap<'_> {
            fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                let compared = self.0.iter().filter(|worst| worst.is_compared);
                serializer.collect_map(compared.map(|worst| (worst.quantity, self.1(worst))))
            }
        }
        /// Number of compared values of each compared quantity.
        struct CountMap<'a>(&'a [WorstDifference]);
        impl Serialize for CountMap<'_> {
            fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                let compared = self.0.iter().filter(|worst| worst.is_compared);
                serializer.collect_map(compared.map(|worst| (worst.quantity, worst.values)))
            }
        }
        #[derive(Serialize)]
        struct FirstStep<'a> {
            episode: usize,
            step: usize,
            what: &'a str,
        }
        let RecordingComparison { episodes, steps, worst, first, documented } = &self.compared;
        FileReport {
            file: &self.file,
            world: self.world,
            within: self.is_within_tolerance(),
            episodes: *episodes,
            steps: *steps,
            worst: QuantityMap(worst, |worst| worst.difference),
            allowed: QuantityMap(worst, |worst| worst.allowed),
            values: CountMap(worst),
            first: first.as_ref().map(|FirstDifference { episode, step, what }| FirstStep {
                episode: *episode,
                step: *step,
                what,
            }),
            documented,
        }
        .serialize(serializer)
    }
}

#[derive(Serialize)]
struct ReplayReport<'a> {
    tolerance: f64,
    files: &'a [FileComparison],
}

/// Replays every file and prints the comparisons.
///
/// # Errors
/// Returns an error if a file cannot be read or holds no recording; the comparisons of the other files are printed first.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let Comparisons { files: judged, verdict } = compare_files(args);
    if args.output.json {
        output::print_json(&ReplayReport { tolerance: args.tolerance, files: &judged })?;
    } else if !judged.is_empty() {
        output::print_report(&text_report(&judged, args.tolerance))?;
    }
    verdict
}

/// Comparisons of all readable files, and the exit code or the errors of the others.
struct Comparisons {
    files: Vec<FileComparison>,
    verdict: anyhow::Result<ExitCode>,
}

/// Compares all files of the command line.
fn compare_files(args: &Args) -> Comparisons {
    let mut judged = Vec::new();
    let mut faults = Vec::new();
    for path in &args.files {
        match compare_file(path, args.tolerance) {
            Ok(found) => judged.push(found),
            Err(error) => faults.push(output::error_text(&error)),
        }
    }
    let verdict = if !faults.is_empty() {
        Err(anyhow!(faults.join("; ")))
    } else if judged.iter().all(FileComparison::is_within_tolerance) {
        Ok(ExitCode::SUCCESS)
    } else {
        Ok(ExitCode::FAILURE)
    };
    Comparisons { files: judged, verdict }
}

/// Finds the world that recorded the file and compares the recording with a replay.
///
/// # Errors
/// Returns an error if the file cannot be read, is empty, or belongs to no known world.
fn compare_file(path: &Path, tolerance: f64) -> anyhow::Result<FileComparison> {
    let recording = read(path)?;
    compare_recording(&recording, path, tolerance).with_context(|| path.display().to_string())
}

fn compare_recording(recording: &Value, path: &Path, tolerance: f64) -> anyhow::Result<FileComparison> {
    let none = |value: &Value| value.as_array().is_some_and(Vec::is_empty);
    ensure!(!recording.get("episodes").is_some_and(none), "it holds no episodes");
    let file = path.display().to_string();
    for world in env_core::worlds() {
        if let Some(compared) = world.compare_recording(recording, tolerance) {
            let compared = compared?;
            ensure!(compared.episodes > 0, "it holds no episodes");
            return Ok(FileComparison { file, world: world.name(), compared });
        }
    }
    let names: Vec<_> = env_core::worlds().map(World::name).collect();
    bail!("it is not a recording of a world known here ({})", names.join(", "))
}

/// Reads a JSON file and unpacks it if it has a gzip header, regardless of its name.
fn read(path: &Path) -> anyhow::Result<Value> {
    let bytes = files::read(path)?;
    let unpacked = if bytes.starts_with(&[0x1f, 0x8b]) {
        let mut unpacked = Vec::new();
        let reader = flate2::read::MultiGzDecoder::new(&bytes[..]);
        reader
            .take(MAX_RECORDING_BYTES + 1)
            .read_to_end(&mut unpacked)
            .map_err(|error| anyhow!("{} cannot be unpacked: {error}", path.display()))?;
        unpacked
    } else {
        bytes
    };
    let size = unpacked.len() as u64;
    ensure!(size <= MAX_RECORDING_BYTES, "{} is larger than {MAX_RECORDING_BYTES} bytes", path.display());
    serde_json::from_slice(&unpacked).map_err(|error| anyhow!("{} is not JSON: {error}", path.display()))
}

/// Builds one table per file with one row per quantity, then the differences of single files.
fn text_report(judged: &[FileComparison], tolerance: f64) -> Report {
    let mut report = Report::default();
    report.paragraph(format!(
        "Largest differences and the allowed ones: the tolerance of {tolerance:e}, or the precision of the recording or the \
         world's own tolerance if that is larger."
    ));
    for file in judged {
        let RecordingComparison { episodes, steps, .. } = &file.compared;
        let (name, world) = (&file.file, file.world);
        report
            .paragraph(format!("{name}: {world}, {episodes} episodes, {steps} steps"))
            .table(quantities(file));
    }
    for FileComparison { file, compared, .. } in judged {
        if let Some(FirstDifference { episode, step, what }) = &compared.first {
            report.paragraph(format!(
                "{file}: the first difference is in episode {episode}, step {step}: {what}"
            ));
        }
        for documented in &compared.documented {
            report.paragraph(format!("{file}: documented: {documented}"));
        }
    }
    report
}

/// Builds the table of a file's quantities.
fn quantities(file: &FileComparison) -> TextTable {
    let worst = &file.compared.worst;
    let numbers = worst.iter().all(|worst| worst.difference <= worst.allowed);
    // A word can differ even if no number does.
    let word = (numbers && !file.is_within_tolerance()).then(|| WorstDifference {
        difference: 1.0,
        is_compared: true,
        values: 1,
        ..WorstDifference::new("text", 0.0)
    });
    let mut table = TextTable::new([
        Column::text("quantity"),
        Column::text("verdict"),
        Column::number("worst"),
        Column::number("allowed"),
        Column::number("values"),
    ]);
    for WorstDifference { quantity, difference, allowed, is_compared, values } in worst.iter().chain(&word) {
        let verdict = match is_compared {
            false => "not compared",
            true if difference <= allowed => "within",
            true => "DIFFERS",
        };
        let number = |number: &f64| if *is_compared { format!("{number:.1e}") } else { "–".to_owned() };
        let numbers = [difference, allowed].map(number);
        let cells = [*quantity, verdict].map(str::to_owned).into_iter().chain(numbers);
        table.add_row(cells.chain([values.to_string()]));
    }
    table
}

fn tolerance(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value >= 0.0 => Ok(value),
        _ => Err("a tolerance must be a finite number, at least 0".to_owned()),
    }
}

#[cfg(test)]
mod tests;
