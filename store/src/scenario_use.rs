//! Use of a scenario by trainers: while a group of it is open or queued, its solution is not disclosed. Tables `groups`,
//! `seed_ranges` and `proposals`.

use sqlx::{SqliteConnection, query_scalar};

use super::StoreError;

/// Keys of a scenario: its id, and the recipe and seed by which leases of columns name it.
#[derive(Debug, Clone, Copy)]
pub struct ScenarioKeys<'a> {
    /// Id of the scenario.
    pub id: &'a [u8],
    /// Id of the recipe.
    pub recipe: &'a [u8],
    /// Seed of the scenario.
    pub seed: i64,
}

/// Use of a scenario by a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ScenarioUse {
    /// A lease of this run has an open group of the scenario.
    Leased(String),
    /// A waiting proposal of this run has or repeats the scenario.
    Queued(String),
}

/// Finds a run that uses a scenario: one with an open group of it, else one with a waiting proposal.
///
/// # Errors
/// Returns [`StoreError::Database`] if a query fails.
pub async fn find(
    conn: &mut SqliteConnection,
    scenario: ScenarioKeys<'_>,
) -> Result<Option<ScenarioUse>, StoreError> {
    if let Some(run) = run_with_open_group(conn, scenario.id).await? {
        return Ok(Some(ScenarioUse::Leased(run)));
    }
    if let Some(run) = run_with_seed_range(conn, scenario).await? {
        return Ok(Some(ScenarioUse::Leased(run)));
    }
    if let Some(run) = run_with_prepared_proposal(conn, scenario.id).await? {
        return Ok(Some(ScenarioUse::Queued(run)));
    }
    if let Some(run) = run_with_waiting_replay(conn, scenario.id).await? {
        return Ok(Some(ScenarioUse::Queued(run)));
    }
    Ok(run_with_equal_proposal(conn, scenario.id).await?.map(ScenarioUse::Queued))
}

/// Finds a run with an open group of a scenario.
async fn run_with_open_group(
    conn: &mut SqliteConnection,
    scenario: &[u8],
) -> Result<Option<String>, StoreError> {
    let run = query_scalar!(
        "SELECT l.run FROM groups g CROSS JOIN leases l ON l.id = g.lease
         WHERE g.scenario = ? AND g.state = 'open' LIMIT 1",
        scenario
    );
    Ok(run.fetch_optional(conn).await?)
}

/// Finds a run with an active lease of columns that has the scenario.
async fn run_with_seed_range(
    conn: &mut SqliteConnection,
    scenario: ScenarioKeys<'_>,
) -> Result<Option<String>, StoreError> {
    let run = query_scalar!(
        "SELECT l.run FROM seed_ranges s CROSS JOIN leases l ON l.id = s.lease
         WHERE s.recipe = ?1 AND s.first_seed <= ?2 AND ?2 < s.first_seed + s.groups AND l.status = 'active' LIMIT 1",
        scenario.recipe,
        scenario.seed
    );
    Ok(run.fetch_optional(conn).await?)
}

/// Finds a run with a waiting proposal for which the scenario is prepared.
async fn run_with_prepared_proposal(
    conn: &mut SqliteConnection,
    scenario: &[u8],
) -> Result<Option<String>, StoreError> {
    let run = query_scalar!(
        "SELECT r.id FROM proposals p CROSS JOIN runs r ON r.id = p.run
         WHERE p.scenario = ? AND p.state IN ('proposed', 'prepared') AND r.deleted_at IS NULL LIMIT 1",
        scenario
    );
    Ok(run.fetch_optional(conn).await?)
}

/// Finds a run with a proposal that repeats the scenario and is not prepared yet. Only such runs have earlier proposals with it.
async fn run_with_waiting_replay(
    conn: &mut SqliteConnection,
    scenario: &[u8],
) -> Result<Option<String>, StoreError> {
    let run = query_scalar!(
        "SELECT r.id FROM (SELECT DISTINCT run FROM proposals WHERE scenario = ?1) AS known
         CROSS JOIN runs r ON r.id = known.run
         CROSS JOIN proposals p INDEXED BY proposals_unprepared ON p.run = r.id
         WHERE p.state = 'proposed' AND p.body ->> '$.source.from' = 'replay' AND r.deleted_at IS NULL
               AND EXISTS (SELECT 1 FROM proposals origin
                           WHERE origin.run = p.run AND origin.seq = p.body ->> '$.source.of' AND origin.scenario = ?1)
         LIMIT 1",
        scenario
    );
    Ok(run.fetch_optional(conn).await?)
}

/// Finds a run with an unprepared proposal that equals a proposal of the scenario in a run with the same seed. The server will
/// prepare the same scenario for it, because a scenario is a function of run seed, sequence number and proposal.
async fn run_with_equal_proposal(
    conn: &mut SqliteConnection,
    scenario: &[u8],
) -> Result<Option<String>, StoreError> {
    let run = query_scalar!(
        "SELECT r.id FROM proposals known CROSS JOIN runs origin ON origin.id = known.run
         CROSS JOIN runs r INDEXED BY runs_of_seed ON r.seed = origin.seed
         CROSS JOIN proposals p ON p.run = r.id AND p.seq = known.seq
         WHERE known.scenario = ? AND p.state = 'proposed' AND p.body = known.body AND r.deleted_at IS NULL LIMIT 1",
        scenario
    );
    Ok(run.fetch_optional(conn).await?)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of two runs with one seed: a closed group, a proposal that was leased, and a lease of columns that has ended.
    const UNUSED: &str = "
        INSERT INTO runs (id, name, seed, status, settings, created_at)
        VALUES ('a', 'a', 7, 'active', '{}', 0), ('b', 'b', 7, 'paused', '{}', 1);
        INSERT INTO recipes (id, body) VALUES (x'01', '{}');
        INSERT INTO scenarios (id, recipe, seed) VALUES (x'02', x'01', 105), (x'03', x'01', 106);
        INSERT INTO proposals (run, seq, state, body, scenario) VALUES ('a', 1, 'leased', '{\"task\": \"t\"}', x'02');
        INSERT INTO leases (id, id_suffix, run, purpose, status, groups, group_size, policy_version, ttl_ms, created_at, expires_at)
        VALUES (1, 'x', 'a', 'train', 'done', 1, 1, 0, 1, 0, 1), (2, 'y', 'b', 'train', 'done', 10, 1, 0, 1, 0, 1);
        INSERT INTO groups (lease, number, proposal, scenario, task, role, is_contested, state)
        VALUES (1, 0, 1, x'02', 't', 'frontier', 1, 'complete');
        INSERT INTO seed_ranges (lease, number, proposal, recipe, task, role, first_group, groups, first_seed)
        VALUES (2, 0, 1, x'01', 't', 'frontier', 0, 10, 100);";

    /// Returns the use of the scenario after a change of the rows.
    async fn use_after(change: &'static str) -> Option<ScenarioUse> {
        let folder = tempfile::tempdir().expect("a folder");
        let mut conn = crate::open_writer(&folder.path().join("db")).await.expect("a database");
        for statement in [UNUSED, change] {
            sqlx::raw_sql(statement).execute(&mut conn).await.expect("the rows are valid");
        }
        let keys = ScenarioKeys { id: &[2], recipe: &[1], seed: 105 };
        find(&mut conn, keys).await.expect("the scenario is searched")
    }

    #[tokio::test]
    async fn each_use_of_a_scenario_is_found() {
        let leased = |run: &str| Some(ScenarioUse::Leased(run.to_owned()));
        let queued = |run: &str| Some(ScenarioUse::Queued(run.to_owned()));
        for (change, expected) in [
            ("", None),
            ("UPDATE groups SET state = 'open'", leased("a")),
            ("UPDATE leases SET status = 'active' WHERE id = 2", leased("b")),
            ("UPDATE proposals SET state = 'prepared'", queued("a")),
            // The replay of another proposal is none of this scenario.
            (
                "INSERT INTO proposals (run, seq, state, body) VALUES ('a', 2, 'proposed', '{\"source\": {\"from\": \"replay\", \"of\": 1}}')",
                queued("a"),
            ),
            (
                "INSERT INTO proposals (run, seq, state, body) VALUES ('a', 2, 'proposed', '{\"source\": {\"from\": \"replay\", \"of\": 0}}')",
                None,
            ),
            (
                "INSERT INTO proposals (run, seq, state, body) VALUES ('a', 2, 'proposed', '{\"source\": {\"from\": \"edited\", \"of\": 1}}')",
                None,
            ),
            // A run with the same seed will prepare the same scenario for the same proposal.
            (
                "INSERT INTO proposals (run, seq, state, body) VALUES ('b', 1, 'proposed', '{\"task\": \"t\"}')",
                queued("b"),
            ),
            (
                "INSERT INTO proposals (run, seq, state, body) VALUES ('b', 1, 'proposed', '{\"task\": \"u\"}')",
                None,
            ),
            (
                "INSERT INTO proposals (run, seq, state, body) VALUES ('b', 1, 'dropped', '{\"task\": \"t\"}')",
                None,
            ),
            // Seeds beside the range, and runs that are being deleted, are not in use.
            (
                "UPDATE leases SET status = 'active' WHERE id = 2; UPDATE seed_ranges SET first_seed = 106",
                None,
            ),
            (
                "UPDATE leases SET status = 'active' WHERE id = 2; UPDATE seed_ranges SET first_seed = 95",
                None,
            ),
            ("UPDATE proposals SET state = 'prepared'; UPDATE runs SET deleted_at = 1", None),
        ] {
            assert_eq!(use_after(change).await, expected, "{change}");
        }
    }
}
