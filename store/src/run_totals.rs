//! Totals of a run's results, by which lists of runs are sorted. Table `run_totals`.

use std::collections::BTreeMap;

use sqlx::{SqliteConnection, query};

use super::StoreError;
use super::history::HistoryBucket;
use crate::Millis;

/// Number of episodes after which the weight of an episode in the mean skill has halved.
const SKILL_HALF_LIFE: f64 = 1000.0;

/// Adds the results of a run's tasks at the moment `now`.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn add(
    conn: &mut SqliteConnection,
    run: &str,
    now: Millis,
    parts: &BTreeMap<String, HistoryBucket>,
) -> Result<(), StoreError> {
    if !parts.values().any(HistoryBucket::has_results) {
        return Ok(());
    }
    let episodes: i64 = parts.values().map(|part| part.episodes + part.claimed_episodes).sum();
    let skilled: i64 = parts.values().map(|part| part.episodes_with_skill).sum();
    let skill_sum: f64 = parts.values().map(|part| part.skill_sum).sum();
    let skill = (skilled > 0).then(|| skill_sum / skilled as f64);
    let (weight, decay) = (skilled as f64, (-(skilled as f64) / SKILL_HALF_LIFE).exp2());
    query!(
        "INSERT INTO run_totals AS t (run, episodes, first_results_at, last_results_at, skill, skill_weight)
         VALUES (?1, ?2, ?3, ?3, ?4, ?5)
         ON CONFLICT (run) DO UPDATE SET
             episodes = t.episodes + excluded.episodes, last_results_at = max(t.last_results_at, excluded.last_results_at),
             skill = iif(excluded.skill IS NULL, t.skill,
                         (coalesce(t.skill, 0.0) * t.skill_weight * ?6 + excluded.skill * excluded.skill_weight)
                             / (t.skill_weight * ?6 + excluded.skill_weight)),
             skill_weight = t.skill_weight * ?6 + excluded.skill_weight",
        run,
        episodes,
        now,
        skill,
        weight,
        decay
    )
    .execute(conn)
    .await?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::open_writer;

    async fn skill(conn: &mut SqliteConnection) -> Option<f64> {
        sqlx::query_scalar("SELECT skill FROM run_totals").fetch_one(conn).await.expect("a row")
    }

    fn part(episodes: i64, skill: Option<f64>) -> BTreeMap<String, HistoryBucket> {
        let bucket = HistoryBucket {
            episodes,
            episodes_with_skill: if skill.is_some() { episodes } else { 0 },
            skill_sum: skill.unwrap_or(0.0) * episodes as f64,
            ..HistoryBucket::default()
        };
        BTreeMap::from([("kessler/survival".to_owned(), bucket)])
    }

    #[tokio::test]
    async fn skill_forgets_old_episodes_and_skips_those_without() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut conn = open_writer(&folder.path().join("db")).await.expect("a database");
        let run = "INSERT INTO runs (id, name, seed, status, settings, created_at) VALUES ('r', 'r', 1, 'active', '{}', 0)";
        sqlx::query(run).execute(&mut conn).await.expect("a run");
        add(&mut conn, "r", 5, &part(0, None)).await.expect("nothing is stored");
        add(&mut conn, "r", 10, &part(3, None)).await.expect("a row");
        assert_eq!(skill(&mut conn).await, None);
        add(&mut conn, "r", 20, &part(1000, Some(0.0))).await.expect("a row");
        assert_eq!(skill(&mut conn).await, Some(0.0));
        add(&mut conn, "r", 15, &part(1000, Some(0.6))).await.expect("a row");
        let mean = skill(&mut conn).await.expect("a skill");
        assert!((mean - 0.4).abs() < 1e-12, "the older half has half the weight: {mean}");
        let row: (i64, i64, i64) =
            sqlx::query_as("SELECT episodes, first_results_at, last_results_at FROM run_totals")
                .fetch_one(&mut conn)
                .await
                .expect("a row");
        assert_eq!(row, (2003, 10, 20), "the clock may be set back");
    }
}
