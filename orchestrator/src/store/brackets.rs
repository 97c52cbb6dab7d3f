//! Brackets, keyed by scenario and planner version.

use env_core::{ActionLog, Bracket, Flown};
use serde::{Deserialize, Serialize};
use sqlx::{SqliteConnection, query};

use super::{StoreError, from_json, to_json};

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

/// Stores a bracket, once.
///
/// # Errors
/// The database's.
pub async fn insert(
    conn: &mut SqliteConnection,
    scenario: &[u8],
    bracket: &Bracket,
) -> Result<(), StoreError> {
    let body = to_json(&Body {
        floor: bracket.floor,
        panel: bracket.panel.iter().map(|f| (*f).into()).collect(),
        reference: bracket.reference.into(),
    })?;
    let witness = bracket.witness.encode();
    let planner = i64::from(bracket.planner);
    query!(
        "INSERT INTO brackets (scenario, planner, body, witness) VALUES (?, ?, ?, ?)
         ON CONFLICT (scenario, planner) DO NOTHING",
        scenario,
        planner,
        body,
        witness
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// The newest bracket of a scenario.
///
/// # Errors
/// The database's, or a bracket that cannot be read.
pub async fn newest(conn: &mut SqliteConnection, scenario: &[u8]) -> Result<Option<Bracket>, StoreError> {
    let row = query!(
        "SELECT planner, body, witness FROM brackets WHERE scenario = ? ORDER BY planner DESC LIMIT 1",
        scenario
    )
    .fetch_optional(conn)
    .await?;
    let Some(row) = row else { return Ok(None) };
    let body: Body = from_json("a bracket", &row.body)?;
    Ok(Some(Bracket {
        planner: super::small(row.planner),
        panel: body.panel.into_iter().map(Into::into).collect(),
        floor: body.floor,
        reference: body.reference.into(),
        witness: ActionLog::decode(&row.witness)?,
    }))
}
