//! Scenarios and brackets of groups, read together.

use std::collections::HashMap;

use env_core::{Bracket, Scenario};
use sqlx::SqliteConnection;

use store::groups::GroupRow;
use store::scenarios::{LoadedScenarios, ScenarioLoader};
use store::{StoreError, brackets};

/// Scenarios and brackets of the groups that one request needs.
#[derive(Debug)]
pub struct ScenarioCache {
    scenarios: LoadedScenarios,
    /// Newest bracket of each scenario that has one, by scenario id.
    brackets: HashMap<Vec<u8>, Bracket>,
}

impl ScenarioCache {
    /// Reads scenarios and brackets by scenario ids, in one statement each.
    ///
    /// # Errors
    /// Returns an error if a statement fails or a stored scenario is unreadable.
    pub async fn of<T: AsRef<[u8]>>(conn: &mut SqliteConnection, ids: &[T]) -> Result<Self, StoreError> {
        let scenarios = ScenarioLoader::default().all(conn, ids).await?;
        Ok(Self { scenarios, brackets: brackets::newest_of(conn, ids).await? })
    }

    /// Reads scenarios and brackets of groups.
    ///
    /// # Errors
    /// Returns an error if a statement fails or a stored scenario is unreadable.
    pub async fn of_groups(conn: &mut SqliteConnection, groups: &[GroupRow]) -> Result<Self, StoreError> {
        Self::of(conn, &groups.iter().map(|group| &group.scenario).collect::<Vec<_>>()).await
    }

    /// Returns a scenario with its bracket. Only a scenario of a lease of columns may have none: it is bracketed by the audit.
    ///
    /// # Errors
    /// Returns an error if the scenario is missing, or if its bracket is missing and `is_columns` is false.
    pub fn get(&self, id: &[u8], is_columns: bool) -> Result<(&Scenario, Option<&Bracket>), StoreError> {
        let bracket = self.brackets.get(id);
        if bracket.is_none() && !is_columns {
            return Err(StoreError::corrupt("a bracket", "there is none for a leased scenario"));
        }
        Ok((self.scenarios.get(id)?, bracket))
    }
}
