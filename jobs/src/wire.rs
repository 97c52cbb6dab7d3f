//! Compact forms of scenarios, logs and brackets, as MessagePack arrays.
//!
//! Every number keeps its bits. Recipes and proposals are JSON text inside, the form in which the database keeps them.

use std::fmt;
use std::marker::PhantomData;
use std::sync::Arc;

use env_core::{ActionLog, Bracket, EpisodeOutcome, LogError, Recipe, Scenario, ScenarioError, Seed};
use serde::de::{DeserializeOwned, Error, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Reason why a payload or a result cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum WireError {
    /// The message is no valid MessagePack of the expected form.
    #[error("the message cannot be decoded: {0}")]
    Decode(#[from] rmp_serde::decode::Error),
    /// The value cannot be written as MessagePack.
    #[error("the message cannot be encoded: {0}")]
    Encode(#[from] rmp_serde::encode::Error),
    /// The JSON inside is invalid.
    #[error("the JSON of the message cannot be decoded: {0}")]
    Json(#[from] serde_json::Error),
    /// A scenario is invalid.
    #[error("a scenario of the message is invalid: {0}")]
    Scenario(#[from] ScenarioError),
    /// An action log is invalid.
    #[error("an action log of the message is invalid: {0}")]
    Log(#[from] LogError),
    /// The message refers to a recipe that it does not contain.
    #[error("the message refers to recipe {index} of {recipes}")]
    MissingRecipe {
        /// Index of the recipe.
        index: u32,
        /// Number of recipes in the message.
        recipes: usize,
    },
    /// The message contradicts itself or its job.
    #[error("the message does not fit its job: {0}")]
    Mismatch(&'static str),
}

/// Writes a value as MessagePack.
pub(crate) fn to_bytes<T: Serialize>(value: &T) -> Result<Vec<u8>, WireError> {
    Ok(rmp_serde::to_vec(value)?)
}

/// Reads a value from MessagePack.
pub(crate) fn from_bytes<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, WireError> {
    Ok(rmp_serde::from_slice(bytes)?)
}

/// Largest number of entries of a list in a message. An entry can be much larger in memory than in the message, so the size of the
/// message alone is no bound.
pub(crate) const MAX_ENTRIES: usize = 65_536;

/// Reads a list with at most `N` entries. To be used with `deserialize_with`.
pub(crate) fn list<'de, D: Deserializer<'de>, T: Deserialize<'de>, const N: usize>(
    deserializer: D,
) -> Result<Vec<T>, D::Error> {
    deserializer.deserialize_seq(ListVisitor::<T, N>(PhantomData))
}

struct ListVisitor<T, const N: usize>(PhantomData<T>);

impl<'de, T: Deserialize<'de>, const N: usize> Visitor<'de> for ListVisitor<T, N> {
    type Value = Vec<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a list of at most {N} entries")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Vec<T>, A::Error> {
        let mut entries = Vec::new();
        while let Some(entry) = seq.next_element()? {
            if entries.len() == N {
                return Err(A::Error::invalid_length(N + 1, &self));
            }
            entries.push(entry);
        }
        Ok(entries)
    }
}

/// Bytes that take one byte each in MessagePack.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct WireBytes(pub(crate) Vec<u8>);

impl Serialize for WireBytes {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(&self.0)
    }
}

impl<'de> Deserialize<'de> for WireBytes {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_byte_buf(WireBytesVisitor)
    }
}

struct WireBytesVisitor;

impl<'de> Visitor<'de> for WireBytesVisitor {
    type Value = WireBytes;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("bytes")
    }

    fn visit_bytes<E: Error>(self, bytes: &[u8]) -> Result<WireBytes, E> {
        Ok(WireBytes(bytes.to_vec()))
    }

    fn visit_byte_buf<E: Error>(self, bytes: Vec<u8>) -> Result<WireBytes, E> {
        Ok(WireBytes(bytes))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<WireBytes, A::Error> {
        let mut bytes = Vec::new();
        while let Some(byte) = seq.next_element()? {
            bytes.push(byte);
        }
        Ok(WireBytes(bytes))
    }
}

/// A scenario: index of its recipe in the message's [`RecipeTable`], and its seed.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(crate) struct WireScenario(u32, u64);

/// Recipes of a message as JSON, each once.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(crate) struct RecipeTable(#[serde(deserialize_with = "list::<_, _, MAX_ENTRIES>")] Vec<String>);

/// Writes scenarios, and collects their recipes.
#[derive(Default)]
pub(crate) struct ScenarioWriter {
    recipes: Vec<Arc<Recipe>>,
}

impl ScenarioWriter {
    /// Returns the compact form of a scenario.
    pub(crate) fn add(&mut self, scenario: &Scenario) -> WireScenario {
        let recipe = scenario.recipe();
        let known = self.recipes.iter().rposition(|known| Arc::ptr_eq(known, recipe));
        let index = known.unwrap_or_else(|| {
            self.recipes.push(Arc::clone(recipe));
            self.recipes.len() - 1
        });
        WireScenario(u32::try_from(index).unwrap_or(u32::MAX), scenario.seed().get())
    }

    /// Returns the recipes of all scenarios that were added.
    pub(crate) fn table(&self) -> RecipeTable {
        RecipeTable(self.recipes.iter().map(|recipe| recipe.to_json().to_string()).collect())
    }
}

/// Reads the scenarios of a message. Scenarios of one recipe share it.
pub(crate) struct ScenarioReader(Vec<Arc<Recipe>>);

impl ScenarioReader {
    pub(crate) fn new(table: &RecipeTable) -> Result<Self, WireError> {
        let parse = |text: &String| -> Result<_, WireError> {
            Ok(Arc::new(Recipe::from_json(&serde_json::from_str(text)?)?))
        };
        table.0.iter().map(parse).collect::<Result<_, _>>().map(Self)
    }

    pub(crate) fn get(&self, WireScenario(index, seed): WireScenario) -> Result<Scenario, WireError> {
        let recipe = self.0.get(index as usize);
        let recipe = recipe.ok_or(WireError::MissingRecipe { index, recipes: self.0.len() })?;
        Ok(Scenario::new(Arc::clone(recipe), Seed::new(seed)?))
    }
}

/// Writes an action log.
pub(crate) fn log_to_wire(log: &ActionLog) -> WireBytes {
    WireBytes(log.encode())
}

/// Reads an action log.
pub(crate) fn log_from_wire(bytes: &WireBytes) -> Result<ActionLog, WireError> {
    Ok(ActionLog::decode(&bytes.0)?)
}

/// Outcome of an episode, field by field.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(crate) struct WireOutcome {
    score: f64,
    total_reward: f64,
    steps: u32,
    lost: u32,
    goal: Option<f64>,
    fuel_used: f64,
    time_s: Option<f64>,
}

impl From<EpisodeOutcome> for WireOutcome {
    fn from(outcome: EpisodeOutcome) -> Self {
        let EpisodeOutcome { score, total_reward, steps, lost, goal, fuel_used, time_s } = outcome;
        Self { score, total_reward, steps, lost, goal, fuel_used, time_s }
    }
}

impl From<WireOutcome> for EpisodeOutcome {
    fn from(outcome: WireOutcome) -> Self {
        let WireOutcome { score, total_reward, steps, lost, goal, fuel_used, time_s } = outcome;
        Self { score, total_reward, steps, lost, goal, fuel_used, time_s }
    }
}

/// Bracket of a scenario.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct WireBracket {
    planner_version: u32,
    #[serde(deserialize_with = "list::<_, _, MAX_ENTRIES>")]
    panel: Vec<WireOutcome>,
    floor: f64,
    reference: WireOutcome,
    reference_plan: WireBytes,
}

impl From<&Bracket> for WireBracket {
    fn from(bracket: &Bracket) -> Self {
        Self {
            planner_version: bracket.planner_version,
            panel: bracket.panel.iter().map(|outcome| (*outcome).into()).collect(),
            floor: bracket.floor,
            reference: bracket.reference.into(),
            reference_plan: log_to_wire(&bracket.reference_plan),
        }
    }
}

impl WireBracket {
    pub(crate) fn read(self) -> Result<Bracket, WireError> {
        Ok(Bracket {
            planner_version: self.planner_version,
            panel: self.panel.into_iter().map(Into::into).collect(),
            floor: self.floor,
            reference: self.reference.into(),
            reference_plan: log_from_wire(&self.reference_plan)?,
        })
    }
}
