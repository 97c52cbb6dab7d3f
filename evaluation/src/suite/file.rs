//! The file format of a suite: JSON with one line for each scenario. The last line is the hash of all bytes before it.
//!
//! ```text
//! {"format":"sparring-suite/1","name":…,"planner":1,"created_by":…,"row":["score","total",…],"groups":[
//! {"task":…,"level":0,"recipe":{…},"scenarios":[
//! {"part":"contested","seed":…,"id":…,"canonical":…,"floor":…,"reference":[…],"panel":[[…],…]},
//! …
//! ]}
//! ],
//! "hash":"<blake3>"}
//! ```
//!
//! `row` has the columns of outcomes. The last one, `time_s`, exists if the suite has tasks whose steps differ in duration.
//!
//! `planner` is the version of the planner that made the brackets. A group whose brackets another planner made, as for
//! tasks of another world, has a `planner` of its own after its level. The reference's plan is not stored;
//! `sparring suite verify` plans it again.
//!
//! Each task and level has one recipe; `canonical` has the scenario's canonical bytes in hex. A suite has exactly one
//! serialized form, so that `head -n -1 FILE | b3sum` prints its hash.

use std::fmt::Write;
use std::path::Path;
use std::sync::{Arc, OnceLock};

use env_core::{ActionLog, Bracket, EpisodeOutcome, Recipe, Scenario, Seed, SeedSpace};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::{Suite, SuiteEntry, SuiteError, SuiteGroup, SuitePart};

/// Suite that was read from its file.
#[derive(Debug, PartialEq)]
pub struct LoadedSuite {
    /// Suite in the file.
    pub suite: Suite,
    /// Hash of its file in hex.
    pub hash: String,
}

/// Suite that is part of the program.
#[derive(Debug, Clone, Copy)]
pub struct BuiltInSuite {
    /// Name of the suite.
    pub name: &'static str,
    /// Bytes of its file.
    pub bytes: &'static [u8],
}

/// All suites that are part of the program.
pub const BUILT_IN_SUITES: &[BuiltInSuite] = &[
    BuiltInSuite {
        name: "kessler-heldout-v2",
        bytes: include_bytes!("../../suites/kessler-heldout-v2.json"),
    },
    BuiltInSuite {
        name: "docking-heldout-v1",
        bytes: include_bytes!("../../suites/docking-heldout-v1.json"),
    },
    BuiltInSuite {
        name: "tasking-heldout-v1",
        bytes: include_bytes!("../../suites/tasking-heldout-v1.json"),
    },
    BuiltInSuite {
        name: "kessler-heldout-v1",
        bytes: include_bytes!("../../suites/kessler-heldout-v1.json"),
    },
];

/// Name of the suite that is used by default.
pub const DEFAULT_SUITE: &str = "kessler-heldout-v2";

const FORMAT: &str = "sparring-suite/1";
const FORMAT_START: &str = "{\"format\":\"";
const HASH_LINE: &str = "\n\"hash\":\"";
/// Names of the columns of [`OutcomeRow`].
const ROW: [&str; 7] = ["score", "total", "steps", "lost", "goal", "fuel_used", "time_s"];
/// Number of columns of a suite without durations.
const UNTIMED_COLUMNS: usize = 6;

/// Outcome of one plan as a JSON array with the columns [`ROW`]. The last one is left out where steps have one duration.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct OutcomeRow(
    f64,
    f64,
    u32,
    u32,
    Option<f64>,
    f64,
    #[serde(default, skip_serializing_if = "Option::is_none")] Option<f64>,
);

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredScenario {
    part: SuitePart,
    seed: u64,
    id: String,
    canonical: String,
    floor: f64,
    reference: OutcomeRow,
    panel: Vec<OutcomeRow>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredGroup {
    task: String,
    level: usize,
    planner: Option<u32>,
    recipe: Value,
    scenarios: Vec<StoredScenario>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredSuite {
    #[serde(rename = "format")]
    _format: String,
    name: String,
    planner: u32,
    created_by: String,
    row: Vec<String>,
    groups: Vec<StoredGroup>,
    #[serde(rename = "hash")]
    _hash: String,
}

/// Returns a built-in suite, which is parsed once; `None` if there is no suite with this name.
#[must_use]
pub fn built_in(name: &str) -> Option<&'static LoadedSuite> {
    static PARSED: [OnceLock<Option<LoadedSuite>>; BUILT_IN_SUITES.len()] =
        [const { OnceLock::new() }; BUILT_IN_SUITES.len()];
    let index = BUILT_IN_SUITES.iter().position(|suite| suite.name == name)?;
    PARSED[index].get_or_init(|| parse_suite(BUILT_IN_SUITES[index].bytes).ok()).as_ref()
}

/// Returns the names of the built-in suites, separated by commas.
#[must_use]
pub fn built_in_names() -> String {
    BUILT_IN_SUITES.iter().map(|suite| suite.name).collect::<Vec<_>>().join(", ")
}

/// Loads a built-in suite by its name, or a suite file by its path.
///
/// # Errors
/// Returns [`SuiteError::Unknown`] if neither exists, [`SuiteError::Unreadable`] if the file cannot be read, and the errors
/// of [`parse_suite`].
pub fn load_suite(name_or_path: &str) -> Result<LoadedSuite, SuiteError> {
    if let Some(suite) = BUILT_IN_SUITES.iter().find(|suite| suite.name == name_or_path) {
        return parse_suite(suite.bytes);
    }
    let path = Path::new(name_or_path);
    if !path.exists() {
        return Err(SuiteError::Unknown { requested: name_or_path.to_owned(), known: built_in_names() });
    }
    let bytes =
        std::fs::read(path).map_err(|reason| SuiteError::Unreadable { path: path.to_owned(), reason })?;
    parse_suite(&bytes)
}

/// Parses the file format.
///
/// # Errors
/// Returns an error if the bytes are not a suite, have another format or another hash, or if these worlds would build other
/// scenarios from it.
pub fn parse_suite(bytes: &[u8]) -> Result<LoadedSuite, SuiteError> {
    let not_a_suite = |reason: String| SuiteError::NotASuite { reason };
    let text = std::str::from_utf8(bytes).map_err(|error| not_a_suite(error.to_string()))?;
    let format = text
        .strip_prefix(FORMAT_START)
        .and_then(|rest| rest.split('"').next())
        .ok_or_else(|| not_a_suite(format!("it does not begin with {FORMAT_START}")))?;
    if format != FORMAT {
        return Err(SuiteError::Format { found: format.chars().take(60).collect(), known: FORMAT });
    }
    let hash = check_hash(text)?;
    let stored: StoredSuite = serde_json::from_str(text).map_err(|error| not_a_suite(error.to_string()))?;
    let StoredSuite { name, planner, created_by, row, groups, .. } = stored;
    let groups = groups.into_iter().map(|group| read_group(group, planner)).collect::<Result<_, _>>()?;
    let suite = Suite { name, planner, created_by, groups };
    let columns = columns(&suite);
    if row != columns {
        return Err(not_a_suite(format!("its rows are {row:?}, not {columns:?}")));
    }
    Ok(LoadedSuite { suite, hash })
}

/// Hashes the bytes before the last line, and compares the hash with the last line.
fn check_hash(text: &str) -> Result<String, SuiteError> {
    let end = text.rfind(HASH_LINE).ok_or_else(|| SuiteError::NotASuite {
        reason: "its last line is not its hash; it may be cut off".to_owned(),
    })?;
    let (body, tail) = text.split_at(end + 1);
    let found = blake3::hash(body.as_bytes()).to_hex().to_string();
    if tail == hash_line(&found) {
        return Ok(found);
    }
    let stated =
        tail.trim_start_matches("\"hash\":").trim_matches(|c: char| c.is_whitespace() || "\"}".contains(c));
    Err(SuiteError::Altered { found, stated: stated.chars().take(80).collect() })
}

fn hash_line(hash: &str) -> String {
    format!("\"hash\":\"{hash}\"}}\n")
}

fn read_group(stored: StoredGroup, planner: u32) -> Result<SuiteGroup, SuiteError> {
    let StoredGroup { task, level, planner: group_planner, recipe, scenarios } = stored;
    let planner = group_planner.unwrap_or(planner);
    let recipe = Recipe::from_json(&recipe).map_err(|source| SuiteError::Scenario {
        task: task.clone(),
        level,
        index: 0,
        source,
    })?;
    let recipe = Arc::new(recipe);
    let mut entries = Vec::with_capacity(scenarios.len());
    for (index, stored) in scenarios.into_iter().enumerate() {
        let entry = read_entry(&recipe, stored, planner).and_then(|entry| {
            let recipe_task = recipe.task().id();
            if recipe_task == task {
                Ok(entry)
            } else {
                Err(format!("its recipe belongs to {recipe_task}").into())
            }
        });
        entries.push(entry.map_err(|error| {
            let task = task.clone();
            match error {
                EntryError::Scenario(source) => SuiteError::Scenario { task, level, index, source },
                EntryError::Contradiction(reason) => SuiteError::Contradiction { task, level, index, reason },
            }
        })?);
    }
    Ok(SuiteGroup { level, recipe, entries })
}

/// Error of one scenario, without its position in the suite.
enum EntryError {
    Scenario(env_core::ScenarioError),
    Contradiction(String),
}

impl From<String> for EntryError {
    fn from(reason: String) -> Self {
        Self::Contradiction(reason)
    }
}

fn read_entry(recipe: &Arc<Recipe>, stored: StoredScenario, planner: u32) -> Result<SuiteEntry, EntryError> {
    let seed = Seed::new(stored.seed).map_err(EntryError::Scenario)?;
    if seed.space() != SeedSpace::Evaluation {
        return Err(format!("seed {} is not an evaluation seed", stored.seed).into());
    }
    let scenario = Scenario::new(Arc::clone(recipe), seed);
    if hex(&scenario.canonical()) != stored.canonical {
        return Err("recipe and seed give other canonical bytes here".to_owned().into());
    }
    let id = scenario.id().to_string();
    if id != stored.id {
        return Err(format!("its canonical bytes hash to {id}, but its id is {}", stored.id).into());
    }
    let OutcomeRow(..) = stored.panel.first().ok_or_else(|| "its panel is empty".to_owned())?;
    let bracket = Bracket {
        planner_version: planner,
        panel: stored.panel.into_iter().map(OutcomeRow::into_outcome).collect(),
        floor: stored.floor,
        reference: stored.reference.into_outcome(),
        reference_plan: ActionLog::new(recipe.task().action_space().dim(), env_core::log::Precision::F64),
    };
    Ok(SuiteEntry { part: stored.part, scenario, bracket })
}

/// Names of the columns of a suite's outcomes.
fn columns(suite: &Suite) -> &'static [&'static str] {
    let mut entries = suite.groups.iter().flat_map(|group| &group.entries);
    if entries.any(|entry| entry.bracket.reference.time_s.is_some()) { &ROW } else { &ROW[..UNTIMED_COLUMNS] }
}

/// Writes the file format.
///
/// # Errors
/// Returns the serializer's error; it cannot fail for the names and numbers of a suite.
pub fn write_suite(suite: &Suite) -> Result<String, serde_json::Error> {
    let mut text = format!(
        "{FORMAT_START}{FORMAT}\",\"name\":{},\"planner\":{},\"created_by\":{},\"row\":{},\"groups\":[\n",
        serde_json::to_string(&suite.name)?,
        suite.planner,
        serde_json::to_string(&suite.created_by)?,
        serde_json::to_string(columns(suite))?,
    );
    for (index, group) in suite.groups.iter().enumerate() {
        let task = serde_json::to_string(group.recipe.task().id())?;
        let recipe = group.recipe.to_json();
        let separator = if index == 0 { "" } else { ",\n" };
        let planner = match group.planner() {
            Some(planner) if planner != suite.planner => format!(",\"planner\":{planner}"),
            _ => String::new(),
        };
        let lines: Result<Vec<_>, _> = group.entries.iter().map(write_entry).collect();
        let lines = lines?.join(",\n");
        text.push_str(separator);
        // Writing to a string cannot fail.
        let _ = write!(
            text,
            "{{\"task\":{task},\"level\":{}{planner},\"recipe\":{recipe},\"scenarios\":[\n{lines}\n]}}",
            group.level
        );
    }
    text.push_str("\n],\n");
    let hash = blake3::hash(text.as_bytes()).to_hex();
    text.push_str(&hash_line(&hash));
    Ok(text)
}

fn write_entry(entry: &SuiteEntry) -> Result<String, serde_json::Error> {
    serde_json::to_string(&StoredScenario {
        part: entry.part,
        seed: entry.scenario.seed().get(),
        id: entry.scenario.id().to_string(),
        canonical: hex(&entry.scenario.canonical()),
        floor: entry.bracket.floor,
        reference: OutcomeRow::of(&entry.bracket.reference),
        panel: entry.bracket.panel.iter().map(OutcomeRow::of).collect(),
    })
}

impl OutcomeRow {
    const fn of(outcome: &EpisodeOutcome) -> Self {
        Self(
            outcome.score,
            outcome.total_reward,
            outcome.steps,
            outcome.lost,
            outcome.goal,
            outcome.fuel_used,
            outcome.time_s,
        )
    }

    const fn into_outcome(self) -> EpisodeOutcome {
        let Self(score, total_reward, steps, lost, goal, fuel_used, time_s) = self;
        EpisodeOutcome { score, total_reward, steps, lost, goal, fuel_used, time_s }
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::with_capacity(2 * bytes.len()), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}
