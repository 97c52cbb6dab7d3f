//! `sparring replay`: replays recorded episodes and compares them with the recording.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, anyhow, bail, ensure};
use env_core::World;
use env_core::world::{FirstDifference, RecordingComparison, WorstDifference};
use serde::Serialize;
use serde_json::Value;

use super::output::{self, Format};
use super::worlds;

/// Replay recorded episodes and compare every number.
///
/// Each file holds episodes recorded in the public original of a world, with actions, random draws and the state after every
/// step. The command replays them in the original's arithmetic with the same draws. It compares numbers within the tolerance
/// and text exactly. The exit code is 1 if a number differs by more than the tolerance or a text differs. Intended
/// differences that the world documents are listed, but do not count.
#[derive(Debug, clap::Args)]
#[command(after_help = AFTER_HELP)]
pub struct Args {
    /// Recordings (.json or .json.gz); the world of each file is detected from its contents
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Largest accepted absolute difference of a number, unless the world defines a larger one for it
    #[arg(long, default_value = "1e-9", value_parser = tolerance)]
    tolerance: f64,
    /// Set the output format
    #[arg(long, value_enum, default_value = "table")]
    format: Format,
}

const AFTER_HELP: &str = "\
JSON (--format json): one object {tolerance, files}. Each file: {file, world, within, episodes, steps, allowed, first, \
documented} and the worst absolute difference of each of the world's quantities under its name (null: not a finite number), \
which are satellite, debris, reward and total_score for kessler; state, observation, reward_distance, reward_delta_v, \
reward_velocity, reward_success, reward_failure, reward, return and done for docking (done is 1 where a flag or a reason \
differs). allowed has the largest accepted difference under the same names: the tolerance, or the precision of the recording if \
that is larger. first is the first step that differs, {episode (from 0), step (from 1), what}, or null; documented is a list of \
sentences.

Example:
  sparring replay env-core/fixtures/kessler-episodes.json.gz --tolerance 1e-12";

/// Width of wrapped text, in characters.
const TEXT_WIDTH: usize = 100;
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
            first: Option<FirstStep<'a>>,
            documented: &'a [String],
        }
        /// One number of each quantity, in the world's order.
        struct QuantityMap<'a>(&'a [WorstDifference], fn(&WorstDifference) -> f64);
        impl Serialize for QuantityMap<'_> {
            fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.collect_map(self.0.iter().map(|worst| (worst.quantity, self.1(worst))))
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
    match args.format {
        Format::Json => output::print_json(&ReplayReport { tolerance: args.tolerance, files: &judged })?,
        Format::Table if judged.is_empty() => {}
        Format::Table => output::print(&tables(&judged, args.tolerance))?,
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
            Err(error) => faults.push(format!("{}: {error:#}", path.display())),
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
    let none = |value: &Value| value.as_array().is_some_and(Vec::is_empty);
    ensure!(!recording.get("episodes").is_some_and(none), "it holds no episodes");
    let file = path.display().to_string();
    for world in env_core::worlds() {
        if let Some(compared) = world.compare_recording(&recording, tolerance) {
            let compared = compared?;
            ensure!(compared.episodes > 0, "it holds no episodes");
            return Ok(FileComparison { file, world: World::name(world), compared });
        }
    }
    bail!("it is not a recording of a world known here ({})", worlds::names().join(", "))
}

/// Reads a JSON file and unpacks it if it has a gzip header, regardless of its name.
fn read(path: &Path) -> anyhow::Result<Value> {
    let bytes = std::fs::read(path).context("it cannot be read")?;
    let unpacked = if bytes.starts_with(&[0x1f, 0x8b]) {
        let mut unpacked = Vec::new();
        let reader = flate2::read::MultiGzDecoder::new(&bytes[..]);
        reader.take(MAX_RECORDING_BYTES + 1).read_to_end(&mut unpacked).context("it cannot be unpacked")?;
        unpacked
    } else {
        bytes
    };
    ensure!(unpacked.len() as u64 <= MAX_RECORDING_BYTES, "it is larger than {MAX_RECORDING_BYTES} bytes");
    serde_json::from_slice(&unpacked).context("it is not JSON")
}

/// Formats one table per file with one row per quantity, then the differences of single files.
fn tables(judged: &[FileComparison], tolerance: f64) -> String {
    let mut text = format!(
        "Largest differences and the allowed ones: the tolerance of {tolerance:e}, or the precision of the recording if \
         that is larger.\n"
    );
    text = textwrap::fill(text.trim_end(), TEXT_WIDTH) + "\n";
    for file in judged {
        let RecordingComparison { episodes, steps, worst, .. } = &file.compared;
        let numbers = worst.iter().all(|worst| worst.difference <= worst.allowed);
        // A word can differ even if no number does.
        let word = (numbers && !file.is_within_tolerance())
            .then(|| WorstDifference { difference: 1.0, ..WorstDifference::new("text", 0.0) });
        let mut table = output::table(&["quantity", "verdict", "worst", "allowed"], 2);
        for WorstDifference { quantity, difference, allowed } in worst.iter().chain(&word) {
            let verdict = if difference <= allowed { "within" } else { "DIFFERS" };
            let numbers = [difference, allowed].map(|number| format!("{number:.1e}"));
            table.add_row([*quantity, verdict].map(str::to_owned).into_iter().chain(numbers));
        }
        let (name, world) = (&file.file, file.world);
        text.push_str(&format!("\n{name}: {world}, {episodes} episodes, {steps} steps\n{table}\n"));
    }
    text.push('\n');
    for FileComparison { file, compared, .. } in judged {
        if let Some(FirstDifference { episode, step, what }) = &compared.first {
            let found = format!("the first difference is in episode {episode}, step {step}: {what}");
            text.push_str(&textwrap::fill(&format!("{file}: {found}"), TEXT_WIDTH));
            text.push('\n');
        }
        for documented in &compared.documented {
            text.push_str(&textwrap::fill(&format!("{file}: documented: {documented}"), TEXT_WIDTH));
            text.push('\n');
        }
    }
    text
}

fn tolerance(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value >= 0.0 => Ok(value),
        _ => Err("a tolerance must be a finite number, at least 0".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    fn fixture() -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../env-core/fixtures/kessler-episodes.json.gz")
    }

    fn args(files: Vec<PathBuf>) -> Args {
        Args { files, tolerance: 1e-9, format: Format::Json }
    }

    /// Writes the fixture with one change to a JSON file.
    fn tampered(change: impl Fn(&mut serde_json::Value)) -> tempfile::NamedTempFile {
        let packed = std::fs::read(fixture()).unwrap();
        let mut value = serde_json::from_reader(flate2::read::GzDecoder::new(&packed[..])).unwrap();
        change(&mut value);
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(&serde_json::to_vec(&value).unwrap()).unwrap();
        file
    }

    #[test]
    fn validate_kessler_env_the_fixture_replays() {
        let found = compare_file(&fixture(), 1e-9).unwrap();
        assert!(found.is_within_tolerance() && found.world == "kessler", "{found:?}");
        assert_eq!((found.compared.episodes, found.compared.steps), (30, 1361));
        assert_eq!(compare_files(&args(vec![fixture()])).verdict.unwrap(), ExitCode::SUCCESS);
    }

    #[test]
    fn a_tampered_recording_is_exit_1_and_the_step_is_named() {
        let number = tampered(|v| {
            let x = &mut v["episodes"][3]["steps"][6]["satellites"][1][0];
            *x = serde_json::json!(x.as_f64().unwrap() + 1e-6);
        });
        let found = compare_file(number.path(), 1e-9).unwrap();
        let first = found.compared.first.clone().unwrap();
        assert_eq!((first.episode, first.step), (3, 7));
        assert!(first.what.starts_with("satellite 1: "), "{}", first.what);
        let satellite = serde_json::to_value(&found).unwrap()["satellite"].as_f64().unwrap();
        assert!(!found.is_within_tolerance() && (satellite - 1e-6).abs() < 1e-9);
        let file = vec![number.path().to_owned()];
        assert_eq!(compare_files(&args(file.clone())).verdict.unwrap(), ExitCode::FAILURE);
        let loose = Args { tolerance: 1e-5, ..args(file) };
        assert_eq!(compare_files(&loose).verdict.unwrap(), ExitCode::SUCCESS);

        let word = tampered(|v| v["episodes"][0]["steps"][2]["satellites"][0][5] = "lost".into());
        let found = compare_file(word.path(), 1e-9).unwrap();
        assert_eq!(found.compared.first.map(|f| (f.episode, f.step)), Some((0, 3)));
    }

    /// The recordings of every world are recognised and replay. No quantity has the name of a key that every file has.
    #[test]
    fn validate_safe_autonomy_sims_the_fixtures_replay() {
        let folder = fixture().parent().unwrap().to_owned();
        for name in ["docking-docks", "docking-edge", "docking-random", "docking-timeout"] {
            let found = compare_file(&folder.join(format!("{name}.json.gz")), 1e-9).unwrap();
            assert!(
                found.is_within_tolerance() && found.world == "docking" && found.compared.steps > 0,
                "{found:?}"
            );
            let told = serde_json::to_value(&found).unwrap();
            let keys = told.as_object().unwrap().len();
            assert_eq!(keys, 8 + found.compared.worst.len(), "{told}");
            assert!(found.compared.worst.iter().all(|worst| worst.difference <= worst.allowed), "{found:?}");
            let table = tables(&[found], 1e-9);
            let widest = table.lines().map(|line| line.chars().count()).max();
            assert!(widest <= Some(120) && !table.contains("DIFFERS"), "{widest:?} {table}");
        }
    }

    /// Comparisons of two worlds; one has a difference and a documented deviation.
    fn judged() -> [FileComparison; 2] {
        let compared = |worst: &[(&'static str, f64)], first, documented| RecordingComparison {
            episodes: 2,
            steps: 90,
            worst: worst
                .iter()
                .map(|&(quantity, difference)| WorstDifference { quantity, difference, allowed: 1e-9 })
                .collect(),
            first,
            documented,
        };
        let first = FirstDifference { episode: 1, step: 7, what: "reward: 1 here, 2 recorded".to_owned() };
        let known = ["episode 0, step 9: the recording pays twice".to_owned()];
        [
            FileComparison {
                file: "a.json".to_owned(),
                world: "kessler",
                compared: compared(&[("satellite", 2.5e-13), ("reward", 0.0)], None, Vec::new()),
            },
            FileComparison {
                file: "b.json".to_owned(),
                world: "elsewhere",
                compared: compared(&[("position", f64::INFINITY)], Some(first), known.to_vec()),
            },
        ]
    }

    #[test]
    fn every_world_has_its_own_quantities() {
        insta::assert_snapshot!("tables", tables(&judged(), 1e-9));
        insta::assert_json_snapshot!("json", ReplayReport { tolerance: 1e-9, files: &judged() });
    }

    #[test]
    fn bad_files_are_one_sentence_each() {
        let error_of =
            |path: &Path| compare_file(path, 1e-9).map(|_| ()).map_err(|e| format!("{e:#}")).unwrap_err();
        let with = |bytes: &[u8]| {
            let mut file = tempfile::NamedTempFile::new().unwrap();
            file.write_all(bytes).unwrap();
            error_of(file.path())
        };
        let cut = tampered(|v| v["episodes"][1]["steps"][4]["satellites"] = serde_json::json!([]));
        let short = tampered(|v| v["episodes"][1]["steps"] = serde_json::json!([]));
        insta::assert_snapshot!([
            error_of(Path::new("/nowhere/at-all.json")),
            with(b"{"),
            with(b"{\"episodes\": []}"),
            with(&[0x1f, 0x8b, 8, 0]),
            with(b"{\"episodes\": 5}"),
            with(b"[1, 2]"),
            error_of(cut.path()),
            error_of(short.path()),
        ].join("\n"), @r"
        it cannot be read: No such file or directory (os error 2)
        it is not JSON: EOF while parsing an object at line 1 column 1
        it holds no episodes
        it cannot be unpacked: unexpected end of file
        it is not a recording of a world known here (kessler, docking)
        it is not a recording of a world known here (kessler, docking)
        episode 1: step 5 does not have 3 satellites
        episode 1: it has no steps
        ");
        let Comparisons { files: compared, verdict } =
            compare_files(&args(vec![fixture(), PathBuf::from("/nowhere.json")]));
        assert_eq!(compared.len(), 1);
        let both = verdict.unwrap_err().to_string();
        assert!(both.starts_with("/nowhere.json: it cannot be read"), "{both}");
    }

    #[test]
    fn tolerances_are_finite_and_not_negative() {
        assert_eq!(tolerance("0"), Ok(0.0));
        for bad in ["-1", "NaN", "inf", "x"] {
            assert!(tolerance(bad).is_err(), "{bad}");
        }
    }
}
