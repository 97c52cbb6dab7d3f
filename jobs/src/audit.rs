//! Audits: reported episodes are replayed, and missing brackets are computed.

use env_core::admission::admit;
use env_core::error::ReplayError;
use env_core::rollout::{ReplayItem, replay_all};
use env_core::{Bracket, EpisodeOutcome, Scenario};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::episode_batch::{EpisodeBatch, LoggedEpisode};
use crate::wire::{
    MAX_ENTRIES, RecipeTable, ScenarioReader, ScenarioWriter, WireBracket, WireError, WireOutcome,
    WireScenario, from_bytes, list, to_bytes,
};

/// Largest number of episodes that a thread replays together.
pub const REPLAYED_TOGETHER: usize = 32;

/// Computation of an audit.
#[derive(Debug, Clone)]
pub enum AuditPayload {
    /// Brackets of scenarios that have none.
    Brackets(Vec<Scenario>),
    /// Replays of reported episodes.
    Replays(EpisodeBatch),
}

/// Bracket of a scenario, with its judgement.
#[derive(Debug, Clone, PartialEq)]
pub struct ComputedBracket {
    /// Bracket of the scenario.
    pub bracket: Bracket,
    /// True if the scenario is contested.
    pub is_contested: bool,
}

/// Outcome of a replay, or a sentence with the reason why the log does not replay.
pub type ReplayOutcome = Result<EpisodeOutcome, String>;

/// Result of an audit, in the order of the payload.
#[derive(Debug, Clone, PartialEq)]
pub enum AuditOutput {
    /// Brackets; `None` for a scenario without a fair start.
    Brackets(Vec<Option<ComputedBracket>>),
    /// Outcomes of the replays.
    Replays(Vec<ReplayOutcome>),
}

#[derive(Serialize, Deserialize)]
struct WireScenarios {
    recipes: RecipeTable,
    #[serde(deserialize_with = "list::<_, _, MAX_ENTRIES>")]
    scenarios: Vec<WireScenario>,
}

#[derive(Serialize, Deserialize)]
enum WirePayload {
    Brackets(WireScenarios),
    Replays(crate::wire::WireBytes),
}

#[derive(Serialize, Deserialize)]
struct WireComputed(WireBracket, bool);

#[derive(Serialize, Deserialize)]
enum WireAudit {
    Brackets(#[serde(deserialize_with = "list::<_, _, MAX_ENTRIES>")] Vec<Option<WireComputed>>),
    Replays(#[serde(deserialize_with = "list::<_, _, MAX_ENTRIES>")] Vec<Result<WireOutcome, String>>),
}

impl AuditPayload {
    /// Number of results of the payload.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::Brackets(scenarios) => scenarios.len(),
            Self::Replays(batch) => batch.0.len(),
        }
    }

    /// True if there is nothing to compute.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Computes the results, in parallel on the current thread pool.
    #[must_use]
    pub fn run(&self) -> AuditOutput {
        match self {
            Self::Brackets(scenarios) => {
                AuditOutput::Brackets(scenarios.par_iter().map(compute_bracket).collect())
            }
            Self::Replays(EpisodeBatch(episodes)) => {
                let together = episodes.len().div_ceil(rayon::current_num_threads());
                let chunks = episodes.par_chunks(together.clamp(1, REPLAYED_TOGETHER));
                AuditOutput::Replays(chunks.flat_map_iter(replay_episodes).collect())
            }
        }
    }

    pub(crate) fn encode(&self) -> Result<Vec<u8>, WireError> {
        let payload = match self {
            Self::Brackets(scenarios) => {
                let mut writer = ScenarioWriter::default();
                let scenarios = scenarios.iter().map(|scenario| writer.add(scenario)).collect();
                WirePayload::Brackets(WireScenarios { recipes: writer.table(), scenarios })
            }
            Self::Replays(batch) => WirePayload::Replays(crate::wire::WireBytes(batch.encode()?)),
        };
        to_bytes(&payload)
    }

    pub(crate) fn decode(bytes: &[u8]) -> Result<Self, WireError> {
        Ok(match from_bytes(bytes)? {
            WirePayload::Brackets(WireScenarios { recipes, scenarios }) => {
                let reader = ScenarioReader::new(&recipes)?;
                let scenarios = scenarios.into_iter().map(|scenario| reader.get(scenario));
                Self::Brackets(scenarios.collect::<Result<_, _>>()?)
            }
            WirePayload::Replays(bytes) => Self::Replays(EpisodeBatch::decode(&bytes.0)?),
        })
    }
}

impl AuditOutput {
    pub(crate) fn encode(&self) -> Result<Vec<u8>, WireError> {
        let output = match self {
            Self::Brackets(brackets) => {
                let write = |computed: &ComputedBracket| {
                    WireComputed((&computed.bracket).into(), computed.is_contested)
                };
                WireAudit::Brackets(brackets.iter().map(|computed| computed.as_ref().map(write)).collect())
            }
            Self::Replays(outcomes) => {
                let write = |outcome: &ReplayOutcome| outcome.clone().map(Into::into);
                WireAudit::Replays(outcomes.iter().map(write).collect())
            }
        };
        to_bytes(&output)
    }

    pub(crate) fn decode(bytes: &[u8]) -> Result<Self, WireError> {
        Ok(match from_bytes(bytes)? {
            WireAudit::Brackets(brackets) => {
                let read = |WireComputed(bracket, is_contested): WireComputed| -> Result<_, WireError> {
                    Ok(ComputedBracket { bracket: bracket.read()?, is_contested })
                };
                let brackets = brackets.into_iter().map(|computed| computed.map(read).transpose());
                Self::Brackets(brackets.collect::<Result<_, _>>()?)
            }
            WireAudit::Replays(outcomes) => {
                Self::Replays(outcomes.into_iter().map(|outcome| outcome.map(Into::into)).collect())
            }
        })
    }
}

fn compute_bracket(scenario: &Scenario) -> Option<ComputedBracket> {
    let admission = admit(scenario);
    Some(ComputedBracket { bracket: admission.bracket?, is_contested: admission.contested })
}

fn replay_episodes(episodes: &[LoggedEpisode]) -> Vec<ReplayOutcome> {
    let items: Vec<_> = episodes
        .iter()
        .map(|episode| ReplayItem { scenario: &episode.scenario, log: &episode.log })
        .collect();
    replay_all(&items).into_iter().map(|outcome| outcome.map_err(describe)).collect()
}

/// Returns the sentence that a client receives about a log that does not replay.
#[must_use]
pub fn describe(error: ReplayError) -> String {
    match error {
        ReplayError::Log(error) => error.with_parent("actions").to_string(),
        ReplayError::Scenario(error) => error.to_string(),
        ReplayError::Policy(error) => error.to_string(),
    }
}
