//! Brackets of scenarios, by scenario and planner version. Table `brackets`.

use std::collections::HashMap;

use env_core::{ActionLog, Bracket, EpisodeOutcome};
use serde::{Deserialize, Serialize};
use sqlx::{QueryBuilder, SqliteConnection, query_as};

use super::pack::{pack, unpack};
use super::{MAX_ROWS, StoreError, hex_list, to_json};

/// Outcome of one episode or plan, as it is stored.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct StoredOutcome {
    /// Score that the world computed.
    pub score: f64,
    /// Sum of the rewards.
    pub total_reward: f64,
    /// Number of its steps.
    pub steps: u32,
    /// Number of agents lost.
    pub lost: u32,
    /// Quality of holding the goal towards the end, from 0 to 1; `None` for tasks without a goal.
    pub goal: Option<f64>,
    /// Fuel spent by all agents.
    pub fuel_used: f64,
    /// Duration, s; `None` in a world that counts steps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_s: Option<f64>,
}

impl From<EpisodeOutcome> for StoredOutcome {
    fn from(outcome: EpisodeOutcome) -> Self {
        let EpisodeOutcome { score, total_reward, steps, lost, goal, fuel_used, time_s } = outcome;
        Self { score, total_reward, steps, lost, goal, fuel_used, time_s }
    }
}

impl From<StoredOutcome> for EpisodeOutcome {
    fn from(outcome: StoredOutcome) -> Self {
        let StoredOutcome { score, total_reward, steps, lost, goal, fuel_used, time_s } = outcome;
        Self { score, total_reward, steps, lost, goal, fuel_used, time_s }
    }
}

/// JSON of the `body` column.
#[derive(Serialize, Deserialize)]
struct BracketBody {
    floor: f64,
    panel: Vec<StoredOutcome>,
    reference: StoredOutcome,
}

/// Stores brackets by the ids of their scenarios. A bracket that is stored already stays as it is.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn insert(conn: &mut SqliteConnection, brackets: &[(&[u8], &Bracket)]) -> Result<(), StoreError> {
    for rows in brackets.chunks(MAX_ROWS) {
        let rows = rows.iter().map(|(scenario, bracket)| Ok((*scenario, bracket, pack_bracket(bracket)?)));
        let rows = rows.collect::<Result<Vec<_>, StoreError>>()?;
        let mut statement =
            QueryBuilder::new("INSERT INTO brackets (scenario, planner_version, body, reference_plan) ");
        statement.push_values(&rows, |mut values, (scenario, bracket, packed)| {
            values.push_bind(*scenario).push_bind(i64::from(bracket.planner_version)).push_bind(&packed.body);
            values.push_bind(&packed.reference_plan);
        });
        let statement = statement.push(" ON CONFLICT (scenario, planner_version) DO NOTHING").build();
        statement.execute(&mut *conn).await?;
    }
    Ok(())
}

/// Reads the bracket of a scenario by the newest planner.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails, and [`StoreError::Corrupt`] if the bracket cannot be decoded.
pub async fn newest(conn: &mut SqliteConnection, scenario: &[u8]) -> Result<Option<Bracket>, StoreError> {
    Ok(newest_of(conn, &[scenario]).await?.remove(scenario))
}

/// Reads the brackets of scenarios by the newest planner, by scenario id, in one statement.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails, and [`StoreError::Corrupt`] if a bracket cannot be decoded.
pub async fn newest_of<T: AsRef<[u8]>>(
    conn: &mut SqliteConnection,
    scenarios: &[T],
) -> Result<HashMap<Vec<u8>, Bracket>, StoreError> {
    let scenarios = hex_list(scenarios)?;
    let rows = query_as!(
        BracketRow,
        "SELECT scenario, planner_version, body, reference_plan FROM brackets
         WHERE scenario IN (SELECT unhex(value) FROM json_each(?)) ORDER BY scenario, planner_version",
        scenarios
    )
    .fetch_all(conn)
    .await?;
    // Rows are in order of the planner: the last of a scenario, the newest, stays.
    rows.into_iter().map(|row| Ok((row.scenario.clone(), row.decode()?))).collect()
}

/// Reads the bracket of a scenario by one version of the planner.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails, and [`StoreError::Corrupt`] if the bracket cannot be decoded.
pub async fn by_planner(
    conn: &mut SqliteConnection,
    scenario: &[u8],
    planner_version: i64,
) -> Result<Option<Bracket>, StoreError> {
    let row = query_as!(
        BracketRow,
        "SELECT scenario, planner_version, body, reference_plan FROM brackets WHERE scenario = ? AND planner_version = ?",
        scenario,
        planner_version
    );
    row.fetch_optional(conn).await?.map(BracketRow::decode).transpose()
}

/// Row of the `brackets` table.
struct BracketRow {
    scenario: Vec<u8>,
    planner_version: i64,
    body: Vec<u8>,
    reference_plan: Vec<u8>,
}

impl BracketRow {
    fn decode(self) -> Result<Bracket, StoreError> {
        let Self { planner_version, body, reference_plan, .. } = self;
        unpack_bracket(planner_version, &PackedBracket { body, reference_plan })
    }
}

/// Bracket as it is stored.
pub(crate) struct PackedBracket {
    /// Content of the `body` column.
    pub(crate) body: Vec<u8>,
    /// Content of the `reference_plan` column.
    pub(crate) reference_plan: Vec<u8>,
}

/// Packs a bracket into the columns of a row.
pub(crate) fn pack_bracket(bracket: &Bracket) -> Result<PackedBracket, StoreError> {
    let json = to_json(&BracketBody {
        floor: bracket.floor,
        panel: bracket.panel.iter().map(|outcome| (*outcome).into()).collect(),
        reference: bracket.reference.into(),
    })?;
    Ok(PackedBracket { body: pack(json.into_bytes()), reference_plan: pack(bracket.reference_plan.encode()) })
}

/// Unpacks the columns of a row.
pub(crate) fn unpack_bracket(planner_version: i64, packed: &PackedBracket) -> Result<Bracket, StoreError> {
    let body: BracketBody = serde_json::from_slice(&unpack("a bracket", &packed.body)?)
        .map_err(|error| StoreError::corrupt("a bracket", error))?;
    Ok(Bracket {
        planner_version: super::to_u32(planner_version),
        panel: body.panel.into_iter().map(Into::into).collect(),
        floor: body.floor,
        reference: body.reference.into(),
        reference_plan: ActionLog::decode(&unpack("a reference plan", &packed.reference_plan)?)?,
    })
}
