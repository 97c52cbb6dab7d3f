//! Tests of the comparison and its reports.

use std::io::Write;

use super::*;
use crate::output::OutputTarget;

fn fixture() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../env-core/fixtures/kessler-episodes.json.gz")
}

fn args(files: Vec<PathBuf>) -> Args {
    Args { files, tolerance: 1e-9, output: JsonFlag { json: true } }
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
        assert_eq!(keys, 9 + found.compared.worst.len(), "{told}");
        assert!(found.compared.worst.iter().all(|worst| worst.difference <= worst.allowed), "{found:?}");
        let table = text_report(&[found], 1e-9).render(OutputTarget::Terminal(100));
        let widest = table.lines().map(|line| line.chars().count()).max();
        assert!(widest <= Some(120) && !table.contains("DIFFERS"), "{widest:?} {table}");
    }
}

/// Recordings of BSK-RL are compared within the world's tolerances, whatever the requested one is, and a change is found.
#[test]
fn validate_bsk_a_recording_replays() {
    let file = fixture().parent().unwrap().join("tasking/recorded/deaths_general.json.gz");
    let found = compare_file(&file, 0.0).unwrap();
    assert!(found.is_within_tolerance() && found.world == "tasking" && found.compared.steps > 5, "{found:?}");
    let mut value: Value =
        serde_json::from_reader(flate2::read::GzDecoder::new(&std::fs::read(&file).unwrap()[..])).unwrap();
    let end = &mut value["steps"][2]["t_end"];
    *end = serde_json::json!(end.as_f64().unwrap() + 1.0);
    let mut changed = tempfile::NamedTempFile::new().unwrap();
    changed.write_all(&serde_json::to_vec(&value).unwrap()).unwrap();
    let first = compare_file(changed.path(), 0.0).unwrap().compared.first.unwrap();
    assert_eq!(first.step, 3, "{}", first.what);
    assert!(first.what.starts_with("end of the step"), "{}", first.what);
}

/// A recording of BSK-RL with a number changed at a place, as a file.
fn changed_recording(name: &str, pointer: &str, change: f64) -> tempfile::NamedTempFile {
    let packed = std::fs::read(fixture().parent().unwrap().join(format!("tasking/{name}.json.gz"))).unwrap();
    let mut value: Value = serde_json::from_reader(flate2::read::GzDecoder::new(&packed[..])).unwrap();
    let number = value.pointer_mut(pointer).unwrap();
    *number = serde_json::json!(number.as_f64().unwrap() + change);
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(&serde_json::to_vec(&value).unwrap()).unwrap();
    file
}

/// Small changes of what satellites observe and choose are found: opening, priority, eclipse, the reset, and the chosen window.
#[test]
fn validate_bsk_altered_recordings_are_exit_1() {
    /// Duration by which times are divided, s.
    const ORBIT_S: f64 = 5700.0;
    let changes = [
        ("reference/b_gym_seed0", "/steps/5/observation/0/1", 0.1 / ORBIT_S),
        ("reference/b_gym_seed0", "/steps/5/observation/2/6", 5e-5),
        ("reference/a_random_seed1", "/steps/5/observation/9", 0.5 / ORBIT_S),
        ("reference/b_pz_seed0", "/initial/observation/EO_2/3", 0.1 / ORBIT_S),
        ("reference/b_pz_seed0", "/steps/0/selected/EO_1/open", 100.0),
        ("reference/a_random_seed1", "/steps/5/net_power_W", 1.0),
    ];
    for (name, pointer, change) in changes {
        for (change, expected) in [(0.0, ExitCode::SUCCESS), (change, ExitCode::FAILURE)] {
            let file = changed_recording(name, pointer, change);
            let verdict = compare_files(&args(vec![file.path().to_owned()])).verdict;
            assert_eq!(verdict.unwrap(), expected, "{name} {pointer} {change}");
        }
    }
}

/// Comparisons of two worlds; one has a difference and a documented deviation.
fn judged() -> [FileComparison; 2] {
    let compared = |worst: &[(&'static str, f64)], first, documented| RecordingComparison {
        episodes: 2,
        steps: 90,
        worst: worst
            .iter()
            .map(|&(quantity, difference)| WorstDifference {
                quantity,
                difference,
                allowed: 1e-9,
                is_compared: true,
                values: 90,
            })
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
    insta::assert_snapshot!("tables", text_report(&judged(), 1e-9).render(OutputTarget::Terminal(100)));
    insta::assert_json_snapshot!("json", ReplayReport { tolerance: 1e-9, files: &judged() });
}

#[test]
fn bad_files_are_one_sentence_each() {
    let error_of = |path: &Path| {
        let error = compare_file(path, 1e-9).map(|_| ()).unwrap_err();
        format!("{error:#}").replace(&path.display().to_string(), "FILE")
    };
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
    FILE does not exist; check the path
    FILE is not JSON: EOF while parsing an object at line 1 column 1
    FILE: it holds no episodes
    FILE cannot be unpacked: unexpected end of file
    FILE: it is not a recording of a world known here (kessler, docking, tasking)
    FILE: it is not a recording of a world known here (kessler, docking, tasking)
    FILE: episode 1: step 5 does not have 3 satellites
    FILE: episode 1: it has no steps
    ");
    let Comparisons { files: compared, verdict } =
        compare_files(&args(vec![fixture(), PathBuf::from("/nowhere.json")]));
    assert_eq!(compared.len(), 1);
    let both = verdict.unwrap_err().to_string();
    assert!(both.starts_with("/nowhere.json does not exist"), "{both}");
}

#[test]
fn tolerances_are_finite_and_not_negative() {
    assert_eq!(tolerance("0"), Ok(0.0));
    for bad in ["-1", "NaN", "inf", "x"] {
        assert!(tolerance(bad).is_err(), "{bad}");
    }
}
