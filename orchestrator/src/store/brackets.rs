//! Brackets, keyed by scenario and planner version.

use std::collections::HashMap;

use env_core::{ActionLog, Bracket, Flown};
use serde::{Deserialize, Serialize};
use sqlx::{QueryBuilder, SqliteConnection, query};

use super::pack::{pack, unpack};
use super::{ROWS, StoreError, hex_list, to_json};

/// How a plan or an episode fared, as stored and sent.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct StoredFlown {
    /// The world's score.
    pub score: f64,
    /// The sum of rewards, as the wire shows it.
    pub total: f64,
    /// Steps flown.
    pub steps: u32,
    /// Agents lost.
    pub lost: u32,
    /// How well the task's goal was held towards the end, where it has one.
    pub goal: Option<f64>,
    /// Fuel spent by all agents.
    pub fuel_used: f64,
}

impl From<Flown> for StoredFlown {
    fn from(f: Flown) -> Self {
        let Flown { score, total, steps, lost, goal, fuel_used } = f;
        Self { score, total, steps, lost, goal, fuel_used }
    }
}

impl From<StoredFlown> for Flown {
    fn from(f: StoredFlown) -> Self {
        let StoredFlown { score, total, steps, lost, goal, fuel_used } = f;
        Self { score, total, steps, lost, goal, fuel_used }
    }
}

#[derive(Serialize, Deserialize)]
struct Body {
    floor: f64,
    panel: Vec<StoredFlown>,
    reference: StoredFlown,
}

/// Stores brackets of scenarios, once each.
///
/// # Errors
/// The database's.
pub async fn insert(conn: &mut SqliteConnection, brackets: &[(&[u8], &Bracket)]) -> Result<(), StoreError> {
    let body = |bracket: &Bracket| {
        let json = to_json(&Body {
            floor: bracket.floor,
            panel: bracket.panel.iter().map(|f| (*f).into()).collect(),
            reference: bracket.reference.into(),
        })?;
        Ok::<_, StoreError>(pack(json.into_bytes()))
    };
    for rows in brackets.chunks(ROWS) {
        let rows = rows.iter().map(|(scenario, bracket)| Ok((*scenario, bracket, body(bracket)?)));
        let rows = rows.collect::<Result<Vec<_>, StoreError>>()?;
        let mut statement = QueryBuilder::new("INSERT INTO brackets (scenario, planner, body, witness) ");
        statement.push_values(&rows, |mut values, (scenario, bracket, body)| {
            values.push_bind(*scenario).push_bind(i64::from(bracket.planner)).push_bind(body);
            values.push_bind(pack(bracket.witness.encode()));
        });
        let statement = statement.push(" ON CONFLICT (scenario, planner) DO NOTHING").build();
        statement.execute(&mut *conn).await?;
    }
    Ok(())
}

/// The newest bracket of a scenario.
///
/// # Errors
/// The database's, or a bracket that cannot be read.
pub async fn newest(conn: &mut SqliteConnection, scenario: &[u8]) -> Result<Option<Bracket>, StoreError> {
    Ok(newest_of(conn, &[scenario]).await?.remove(scenario))
}

/// The newest brackets of scenarios, by their ids, in one statement however many they are.
///
/// # Errors
/// The database's, or a bracket that cannot be read.
pub async fn newest_of<T: AsRef<[u8]>>(
    conn: &mut SqliteConnection,
    scenarios: &[T],
) -> Result<HashMap<Vec<u8>, Bracket>, StoreError> {
    let scenarios = hex_list(scenarios)?;
    let rows = query!(
        "SELECT scenario, planner, body, witness FROM brackets
         WHERE scenario IN (SELECT unhex(value) FROM json_each(?)) ORDER BY scenario, planner",
        scenarios
    )
    .fetch_all(conn)
    .await?;
    let read = rows.into_iter().map(|row| {
        let body: Body = serde_json::from_slice(&unpack("a bracket", &row.body)?)
            .map_err(|error| StoreError::unreadable("a bracket", error))?;
        let bracket = Bracket {
            planner: super::small(row.planner),
            panel: body.panel.into_iter().map(Into::into).collect(),
            floor: body.floor,
            reference: body.reference.into(),
            witness: ActionLog::decode(&unpack("a witness", &row.witness)?)?,
        };
        Ok((row.scenario, bracket))
    });
    read.collect() // of each scenario the last one stays: the newest
}
