//! What groups are flown and judged by.

use std::collections::HashMap;

use env_core::{Bracket, Scenario};
use sqlx::SqliteConnection;

use crate::store::groups::GroupRow;
use crate::store::scenarios::{Loader, Scenarios};
use crate::store::{StoreError, brackets};

/// The scenarios and brackets of groups that are wanted together.
#[derive(Debug)]
pub struct Sets {
    scenarios: Scenarios,
    /// The newest of each scenario that has one.
    brackets: HashMap<Vec<u8>, Bracket>,
}

impl Sets {
    /// Reads those of scenarios by their ids: a statement each, however many they are.
    ///
    /// # Errors
    /// The store's.
    pub async fn of<T: AsRef<[u8]>>(conn: &mut SqliteConnection, ids: &[T]) -> Result<Self, StoreError> {
        let scenarios = Loader::default().all(conn, ids).await?;
        Ok(Self { scenarios, brackets: brackets::newest_of(conn, ids).await? })
    }

    /// Reads those of groups.
    ///
    /// # Errors
    /// The store's.
    pub async fn of_groups(conn: &mut SqliteConnection, groups: &[GroupRow]) -> Result<Self, StoreError> {
        Self::of(conn, &groups.iter().map(|group| &group.scenario).collect::<Vec<_>>()).await
    }

    /// A scenario with its bracket. Only one of a lease of columns may have none: it is bracketed when it is audited.
    ///
    /// # Errors
    /// One that is not there, or cannot be read.
    pub fn get(&self, id: &[u8], of_columns: bool) -> Result<(&Scenario, Option<&Bracket>), StoreError> {
        let bracket = self.brackets.get(id);
        if bracket.is_none() && !of_columns {
            return Err(StoreError::unreadable("a bracket", "there is none for a leased scenario"));
        }
        Ok((self.scenarios.get(id)?, bracket))
    }
}
