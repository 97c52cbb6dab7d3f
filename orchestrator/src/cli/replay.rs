//! `sparring replay`: recorded episodes, flown again and compared.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, anyhow, ensure};
use env_core::kessler::constants::SATELLITES;
use env_core::kessler::record::{Differences, Recording, compare};
use serde::Serialize;

use super::output::{self, Format};

/// Replay recorded episodes and compare them number by number.
///
/// Each file holds episodes recorded in the public kessler-env, with the burns, the random draws and the state after
/// every step. They are flown again under `compat: upstream` with the same draws; every satellite, debris, reward and
/// score is compared, and every status, alert and visible debris. Exit 1 where a number differs by more than the
/// tolerance or a word differs at all.
#[derive(Debug, clap::Args)]
#[command(after_help = AFTER_HELP)]
pub struct Args {
    /// Recordings, as .json or .json.gz
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Largest absolute difference of a number that passes
    #[arg(long, default_value = "1e-9", value_parser = tolerance)]
    tolerance: f64,
    /// How the result is printed
    #[arg(long, value_enum, default_value = "table")]
    format: Format,
}

const AFTER_HELP: &str = "\
JSON (--format json): one object {tolerance, files}. Each file: {file, within, episodes, steps, satellite, debris, reward, \
total_score, first}: the worst absolute difference of each quantity (null: not a finite number), and the first step that \
differs as {episode (from 0), step (from 1), what}, or null.

Example:
  sparring replay env-core/fixtures/kessler-episodes.json.gz --tolerance 1e-12";

/// Bytes of JSON that are read from one file at most.
const MOST_BYTES: u64 = 1 << 30;

/// What a file's episodes came to.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Compared {
    file: String,
    within: bool,
    episodes: usize,
    steps: usize,
    satellite: f64,
    debris: f64,
    reward: f64,
    total_score: f64,
    first: Option<FirstDifference>,
}

/// The first step that differs.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct FirstDifference {
    episode: usize,
    step: usize,
    what: String,
}

#[derive(Serialize)]
struct Answer<'a> {
    tolerance: f64,
    files: &'a [Compared],
}

/// Replays every file and prints what was found.
///
/// # Errors
/// A file that cannot be read or holds no recording; what the others came to is printed all the same.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let (compared, verdict) = judge(args);
    match args.format {
        Format::Json => output::print_json(&Answer { tolerance: args.tolerance, files: &compared })?,
        Format::Table if compared.is_empty() => {}
        Format::Table => output::print(&table(&compared, args.tolerance))?,
    }
    verdict
}

/// What could be compared, and what it all comes to.
fn judge(args: &Args) -> (Vec<Compared>, anyhow::Result<ExitCode>) {
    let mut compared = Vec::new();
    let mut faults = Vec::new();
    for path in &args.files {
        match compare_file(path, args.tolerance) {
            Ok(found) => compared.push(found),
            Err(error) => faults.push(format!("{}: {error:#}", path.display())),
        }
    }
    let verdict = if !faults.is_empty() {
        Err(anyhow!(faults.join("; ")))
    } else if compared.iter().all(|file| file.within) {
        Ok(ExitCode::SUCCESS)
    } else {
        Ok(ExitCode::FAILURE)
    };
    (compared, verdict)
}

fn compare_file(path: &Path, tolerance: f64) -> anyhow::Result<Compared> {
    let recording = read(path)?;
    ensure!(!recording.episodes.is_empty(), "it holds no episodes");
    let mut all = Compared {
        file: path.display().to_string(),
        within: true,
        episodes: recording.episodes.len(),
        steps: 0,
        satellite: 0.0,
        debris: 0.0,
        reward: 0.0,
        total_score: 0.0,
        first: None,
    };
    for (index, episode) in recording.episodes.iter().enumerate() {
        ensure!(!episode.steps.is_empty(), "episode {index}: it has no steps");
        // What a step leaves out could not differ.
        if let Some(step) = episode.steps.iter().position(|step| step.satellites.len() != SATELLITES) {
            return Err(anyhow!("episode {index}: step {} does not have {SATELLITES} satellites", step + 1));
        }
        let found = compare(episode, tolerance).with_context(|| format!("episode {index}"))?;
        all.add(index, &found);
    }
    Ok(all)
}

impl Compared {
    fn add(&mut self, episode: usize, found: &Differences) {
        self.steps += found.steps;
        self.satellite = self.satellite.max(found.satellite);
        self.debris = self.debris.max(found.debris);
        self.reward = self.reward.max(found.reward);
        self.total_score = self.total_score.max(found.total_score);
        let first =
            [&found.first_beyond, &found.first_mismatch].into_iter().flatten().min_by_key(|(step, _)| *step);
        if let Some((step, what)) = first {
            self.within = false;
            self.first.get_or_insert_with(|| FirstDifference { episode, step: *step, what: what.clone() });
        }
    }
}

/// Reads a recording, unpacking it where it is packed, whatever its name says.
fn read(path: &Path) -> anyhow::Result<Recording> {
    let bytes = std::fs::read(path).context("it cannot be read")?;
    let unpacked = if bytes.starts_with(&[0x1f, 0x8b]) {
        let mut unpacked = Vec::new();
        let reader = flate2::read::MultiGzDecoder::new(&bytes[..]);
        reader.take(MOST_BYTES + 1).read_to_end(&mut unpacked).context("it cannot be unpacked")?;
        unpacked
    } else {
        bytes
    };
    ensure!(unpacked.len() as u64 <= MOST_BYTES, "it is larger than {MOST_BYTES} bytes");
    serde_json::from_slice(&unpacked).context("it is not a recording")
}

fn table(compared: &[Compared], tolerance: f64) -> String {
    let header = ["file", "episodes", "steps", "satellite", "debris", "reward", "total_score", "verdict"];
    let mut table = output::table(&header, 1);
    for file in compared {
        let verdict = if file.within { "within" } else { "DIFFERS" };
        let worst = [file.satellite, file.debris, file.reward, file.total_score].map(|d| format!("{d:.1e}"));
        let counts = [file.episodes.to_string(), file.steps.to_string()];
        let cells = std::iter::once(file.file.clone()).chain(counts).chain(worst);
        table.add_row(cells.chain([verdict.to_owned()]).collect::<Vec<_>>());
    }
    let mut text = format!("Worst absolute differences; the tolerance is {tolerance:e}.\n{table}\n");
    for file in compared {
        if let Some(first) = &file.first {
            text.push_str(&format!(
                "{}: the first difference is in episode {}, step {}: {}\n",
                file.file, first.episode, first.step, first.what
            ));
        }
    }
    text
}

fn tolerance(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value >= 0.0 => Ok(value),
        _ => Err("a tolerance is a finite number, 0 or more".to_owned()),
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

    /// The fixture as JSON with one change, as a file.
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
        assert!(found.within, "{found:?}");
        assert_eq!((found.episodes, found.steps, found.first.clone()), (30, 1361, None));
        assert_eq!(judge(&args(vec![fixture()])).1.unwrap(), ExitCode::SUCCESS);
    }

    #[test]
    fn a_tampered_recording_is_exit_1_and_the_step_is_named() {
        let number = tampered(|v| {
            let x = &mut v["episodes"][3]["steps"][6]["satellites"][1][0];
            *x = serde_json::json!(x.as_f64().unwrap() + 1e-6);
        });
        let found = compare_file(number.path(), 1e-9).unwrap();
        let first = found.first.unwrap();
        assert_eq!((first.episode, first.step), (3, 7));
        assert!(first.what.starts_with("satellite 1: "), "{}", first.what);
        assert!(!found.within && (found.satellite - 1e-6).abs() < 1e-9);
        let file = vec![number.path().to_owned()];
        assert_eq!(judge(&args(file.clone())).1.unwrap(), ExitCode::FAILURE);
        let loose = Args { tolerance: 1e-5, ..args(file) };
        assert_eq!(judge(&loose).1.unwrap(), ExitCode::SUCCESS);

        let word = tampered(|v| v["episodes"][0]["steps"][2]["satellites"][0][5] = "lost".into());
        let found = compare_file(word.path(), 1e-9).unwrap();
        assert_eq!(found.first.map(|f| (f.episode, f.step)), Some((0, 3)));
    }

    #[test]
    fn bad_files_are_one_sentence_each() {
        let tell =
            |path: &Path| compare_file(path, 1e-9).map(|_| ()).map_err(|e| format!("{e:#}")).unwrap_err();
        let with = |bytes: &[u8]| {
            let mut file = tempfile::NamedTempFile::new().unwrap();
            file.write_all(bytes).unwrap();
            tell(file.path())
        };
        let cut = tampered(|v| v["episodes"][1]["steps"][4]["satellites"] = serde_json::json!([]));
        let short = tampered(|v| v["episodes"][1]["steps"] = serde_json::json!([]));
        insta::assert_snapshot!([
            tell(Path::new("/nowhere/at-all.json")),
            with(b"{"),
            with(b"{\"episodes\": []}"),
            with(&[0x1f, 0x8b, 8, 0]),
            with(b"{\"episodes\": 5}"),
            tell(cut.path()),
            tell(short.path()),
        ].join("\n"), @r"
        it cannot be read: No such file or directory (os error 2)
        it is not a recording: EOF while parsing an object at line 1 column 1
        it holds no episodes
        it cannot be unpacked: unexpected end of file
        it is not a recording: invalid type: integer `5`, expected a sequence at line 1 column 14
        episode 1: step 5 does not have 3 satellites
        episode 1: it has no steps
        ");
        let (compared, verdict) = judge(&args(vec![fixture(), PathBuf::from("/nowhere.json")]));
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
