//! Episodes with their action logs, the input of audits and critiques.

use std::sync::Arc;

use env_core::{ActionLog, Scenario};
use serde::{Deserialize, Serialize};

use crate::wire::{
    MAX_ENTRIES, RecipeTable, ScenarioReader, ScenarioWriter, WireBytes, WireError, WireScenario, from_bytes,
    list, log_from_wire, log_to_wire, to_bytes,
};

/// An episode with its actions.
#[derive(Debug, Clone)]
pub struct LoggedEpisode {
    /// Scenario of the episode.
    pub scenario: Scenario,
    /// Actions of the episode.
    pub log: Arc<ActionLog>,
}

/// Episodes of a job, in order.
#[derive(Debug, Clone, Default)]
pub struct EpisodeBatch(pub Vec<LoggedEpisode>);

/// Form of an [`EpisodeBatch`] as MessagePack.
#[derive(Serialize, Deserialize)]
struct WireBatch {
    recipes: RecipeTable,
    #[serde(deserialize_with = "list::<_, _, MAX_ENTRIES>")]
    episodes: Vec<WireEpisode>,
}

#[derive(Serialize, Deserialize)]
struct WireEpisode(WireScenario, WireBytes);

impl EpisodeBatch {
    /// Writes the episodes.
    ///
    /// # Errors
    /// Returns [`WireError::Encode`] if a value cannot be written.
    pub(crate) fn encode(&self) -> Result<Vec<u8>, WireError> {
        let mut writer = ScenarioWriter::default();
        let write =
            |episode: &LoggedEpisode| WireEpisode(writer.add(&episode.scenario), log_to_wire(&episode.log));
        let episodes = self.0.iter().map(write).collect();
        to_bytes(&WireBatch { recipes: writer.table(), episodes })
    }

    /// Reads episodes.
    ///
    /// # Errors
    /// Returns [`WireError`] if the bytes are no valid batch.
    pub(crate) fn decode(bytes: &[u8]) -> Result<Self, WireError> {
        let WireBatch { recipes, episodes } = from_bytes(bytes)?;
        let reader = ScenarioReader::new(&recipes)?;
        let read = |WireEpisode(scenario, log): WireEpisode| -> Result<_, WireError> {
            Ok(LoggedEpisode { scenario: reader.get(scenario)?, log: Arc::new(log_from_wire(&log)?) })
        };
        episodes.into_iter().map(read).collect::<Result<_, _>>().map(Self)
    }
}
