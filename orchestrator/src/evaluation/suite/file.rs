//! The file form of a suite: JSON, a line per scenario, its last line the hash of every byte before it.
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
//! `planner` is the version of the planner that made the brackets; a group made by another than the suite's, as tasks of
//! another world have it, says so by a `planner` of its own after its level. No witness is stored: whoever doubts a
//! reference has it planned again (`sparring suite verify`).
//!
//! A recipe stands once per task and level; `canonical` is the scenario's canonical bytes in hex. A suite is written in
//! one way only, so `head -n -1 FILE | b3sum` gives its hash.

use std::fmt::Write;
use std::path::Path;
use std::sync::{Arc, OnceLock};

use env_core::{ActionLog, Bracket, Flown, Recipe, Scenario, Seed, SeedSpace};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::{Entry, Group, Part, Suite, SuiteError};

/// A suite that comes with the program, read.
#[derive(Debug)]
pub struct BuiltIn {
    /// The suite.
    pub suite: Suite,
    /// Its hash.
    pub hash: String,
}

/// The suites that come with the program: name and file.
pub const BUILT_IN: &[(&str, &[u8])] = &[
    ("kessler-heldout-v2", include_bytes!("../../../suites/kessler-heldout-v2.json")),
    ("docking-heldout-v1", include_bytes!("../../../suites/docking-heldout-v1.json")),
    ("kessler-heldout-v1", include_bytes!("../../../suites/kessler-heldout-v1.json")),
];

/// A suite that comes with the program, read once; none that there is not.
#[must_use]
pub fn built_in(name: &str) -> Option<&'static BuiltIn> {
    static READ: [OnceLock<Option<BuiltIn>>; BUILT_IN.len()] = [const { OnceLock::new() }; BUILT_IN.len()];
    let at = BUILT_IN.iter().position(|(known, _)| *known == name)?;
    let reading = || read(BUILT_IN[at].1).ok().map(|(suite, hash)| BuiltIn { suite, hash });
    READ[at].get_or_init(reading).as_ref()
}

/// The suite that is meant where nobody says which.
pub const DEFAULT: &str = "kessler-heldout-v2";

/// The names of the suites that come with the program, for people.
#[must_use]
pub fn names() -> String {
    BUILT_IN.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ")
}

const FORMAT: &str = "sparring-suite/1";
const FORMAT_START: &str = "{\"format\":\"";
const HASH_LINE: &str = "\n\"hash\":\"";
const ROW: [&str; 6] = ["score", "total", "steps", "lost", "goal", "fuel_used"];

/// How one plan fared: the columns of [`ROW`].
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Row(f64, f64, u32, u32, Option<f64>, f64);

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct StoredScenario {
    part: Part,
    seed: u64,
    id: String,
    canonical: String,
    floor: f64,
    reference: Row,
    panel: Vec<Row>,
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

/// A built-in suite by its name, or a suite file by its path; with its hash.
///
/// # Errors
/// Neither, or a file that is no suite of these worlds, or was altered.
pub fn open(which: &str) -> Result<(Suite, String), SuiteError> {
    if let Some((_, bytes)) = BUILT_IN.iter().find(|(name, _)| *name == which) {
        return read(bytes);
    }
    let path = Path::new(which);
    if !path.exists() {
        return Err(SuiteError::Unknown { which: which.to_owned(), known: names() });
    }
    let bytes =
        std::fs::read(path).map_err(|source| SuiteError::Unreadable { path: path.to_owned(), source })?;
    read(&bytes)
}

/// Reads the file form: the suite and its hash.
///
/// # Errors
/// Anything that is not, byte for byte, a suite that was built by these worlds.
pub fn read(bytes: &[u8]) -> Result<(Suite, String), SuiteError> {
    let stranger = |reason: String| SuiteError::NotASuite { reason };
    let text = std::str::from_utf8(bytes).map_err(|error| stranger(error.to_string()))?;
    let format = text
        .strip_prefix(FORMAT_START)
        .and_then(|rest| rest.split('"').next())
        .ok_or_else(|| stranger(format!("it does not begin with {FORMAT_START}")))?;
    if format != FORMAT {
        return Err(SuiteError::Format { found: format.chars().take(60).collect(), known: FORMAT });
    }
    let hash = check_hash(text)?;
    let stored: StoredSuite = serde_json::from_str(text).map_err(|error| stranger(error.to_string()))?;
    if stored.row != ROW {
        return Err(stranger(format!("its rows are {:?}, not {ROW:?}", stored.row)));
    }
    let groups = stored.groups.into_iter().map(|group| read_group(group, stored.planner));
    let groups = groups.collect::<Result<Vec<_>, _>>()?;
    Ok((Suite { name: stored.name, planner: stored.planner, created_by: stored.created_by, groups }, hash))
}

/// The hash of every byte before the last line, which must name it.
fn check_hash(text: &str) -> Result<String, SuiteError> {
    let end = text.rfind(HASH_LINE).ok_or_else(|| SuiteError::NotASuite {
        reason: "its last line is not its hash; it may be cut off".to_owned(),
    })?;
    let (body, tail) = text.split_at(end + 1);
    let found = blake3::hash(body.as_bytes()).to_hex().to_string();
    if tail == hash_line(&found) {
        return Ok(found);
    }
    let told =
        tail.trim_start_matches("\"hash\":").trim_matches(|c: char| c.is_whitespace() || "\"}".contains(c));
    Err(SuiteError::Altered { found, told: told.chars().take(80).collect() })
}

fn hash_line(hash: &str) -> String {
    format!("\"hash\":\"{hash}\"}}\n")
}

fn read_group(stored: StoredGroup, planner: u32) -> Result<Group, SuiteError> {
    let StoredGroup { task, level, planner: own, recipe, scenarios } = stored;
    let planner = own.unwrap_or(planner);
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
            let told = recipe.task().id();
            if told == task { Ok(entry) } else { Err(format!("its recipe is one of {told}").into()) }
        });
        entries.push(entry.map_err(|fault| {
            let task = task.clone();
            match fault {
                Fault::Scenario(source) => SuiteError::Scenario { task, level, index, source },
                Fault::Contradiction(reason) => SuiteError::Contradiction { task, level, index, reason },
            }
        })?);
    }
    Ok(Group { level, recipe, entries })
}

enum Fault {
    Scenario(env_core::ScenarioError),
    Contradiction(String),
}

impl From<String> for Fault {
    fn from(reason: String) -> Self {
        Self::Contradiction(reason)
    }
}

fn read_entry(recipe: &Arc<Recipe>, stored: StoredScenario, planner: u32) -> Result<Entry, Fault> {
    let seed = Seed::new(stored.seed).map_err(Fault::Scenario)?;
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
    let Row(..) = stored.panel.first().ok_or_else(|| "its panel is empty".to_owned())?;
    let bracket = Bracket {
        planner,
        panel: stored.panel.into_iter().map(Row::flown).collect(),
        floor: stored.floor,
        reference: stored.reference.flown(),
        witness: ActionLog::new(recipe.task().action_space().columns.len(), env_core::log::Precision::F64),
    };
    Ok(Entry { part: stored.part, scenario, bracket })
}

/// The file form.
///
/// # Errors
/// Never for suites that exist: numbers and names can always be written.
pub fn write(suite: &Suite) -> Result<String, serde_json::Error> {
    let mut text = format!(
        "{FORMAT_START}{FORMAT}\",\"name\":{},\"planner\":{},\"created_by\":{},\"row\":{},\"groups\":[\n",
        serde_json::to_string(&suite.name)?,
        suite.planner,
        serde_json::to_string(&suite.created_by)?,
        serde_json::to_string(&ROW)?,
    );
    for (at, group) in suite.groups.iter().enumerate() {
        let task = serde_json::to_string(group.recipe.task().id())?;
        let recipe = group.recipe.to_json();
        let separator = if at == 0 { "" } else { ",\n" };
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

fn write_entry(entry: &Entry) -> Result<String, serde_json::Error> {
    serde_json::to_string(&StoredScenario {
        part: entry.part,
        seed: entry.scenario.seed().get(),
        id: entry.scenario.id().to_string(),
        canonical: hex(&entry.scenario.canonical()),
        floor: entry.bracket.floor,
        reference: Row::of(&entry.bracket.reference),
        panel: entry.bracket.panel.iter().map(Row::of).collect(),
    })
}

impl Row {
    const fn of(flown: &Flown) -> Self {
        Self(flown.score, flown.total, flown.steps, flown.lost, flown.goal, flown.fuel_used)
    }

    const fn flown(self) -> Flown {
        let Self(score, total, steps, lost, goal, fuel_used) = self;
        Flown { score, total, steps, lost, goal, fuel_used }
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::with_capacity(2 * bytes.len()), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}
