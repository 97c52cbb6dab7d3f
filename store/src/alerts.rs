//! Alerts and their delivery to a webhook. Table `alerts`.

use sqlx::{SqliteConnection, query, query_as, query_scalar};

use super::{Millis, StoreError, text_enum};

/// Ended alerts that are kept.
const MAX_ALERTS: i64 = 10_000;

text_enum! {
    /// Rule by which an alert begins.
    pub enum AlertRule: "an alert's rule" {
        /// A run that had results has had none for some time.
        NoResults = "no_results",
        /// A large share of a task's episodes is not reported.
        MissingShare = "missing_share",
        /// The disk of the database is nearly full.
        LowDisk = "low_disk",
        /// A task went down a level.
        LevelDown = "level_down",
        /// A policy is worse than the version before it.
        EvaluationWorse = "evaluation_worse",
        /// A worker on another machine takes no jobs any more.
        WorkerLost = "worker_lost",
    }
}

/// An alert that is to be stored.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NewAlert {
    /// Rule by which it begins.
    pub rule: AlertRule,
    /// Id of its run; none for the server as a whole.
    pub run: Option<String>,
    /// Part of the run that it is about, such as a task; empty for the whole of it.
    pub subject: String,
    /// Message as a sentence for people.
    pub message: String,
    /// True for an event, which ends when it begins.
    pub is_event: bool,
}

/// Row of the `alerts` table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AlertRow {
    /// Number of the alert.
    pub id: i64,
    /// Rule by which it began.
    pub rule: AlertRule,
    /// Id of its run; none for the server as a whole.
    pub run: Option<String>,
    /// Name of the run.
    pub run_name: Option<String>,
    /// Part of the run that it is about; empty for the whole of it.
    pub subject: String,
    /// Message as a sentence for people.
    pub message: String,
    /// Time of its beginning.
    pub began_at: Millis,
    /// When it ended; none while it lasts.
    pub ended_at: Option<Millis>,
    /// When the webhook took its beginning.
    pub sent_at: Option<Millis>,
    /// When the webhook took its end.
    pub end_sent_at: Option<Millis>,
    /// Number of failed attempts for the message that is due.
    pub attempts: i64,
    /// Time of the next attempt; none if no message is due.
    pub next_attempt_at: Option<Millis>,
    /// Error of the last failed attempt.
    pub send_error: Option<String>,
}

/// Selects [`AlertRow`]s of the server and of runs that exist: takes what follows `WHERE`, and the arguments of the statement.
macro_rules! query_alerts {
    ($rest:literal $(, $argument:expr)* $(,)?) => {
        query_as!(
            AlertRow,
            r#"SELECT a.id AS "id!: i64", a.rule AS "rule!: AlertRule", a.run, r.name AS "run_name?: String", a.subject AS "subject!: String",
                      a.message AS "message!: String", a.began_at AS "began_at!: i64", a.ended_at, a.sent_at, a.end_sent_at,
                      a.attempts AS "attempts!: i64", a.next_attempt_at, a.send_error
               FROM alerts a LEFT JOIN runs r ON r.id = a.run
               WHERE r.deleted_at IS NULL AND "# + $rest
            $(, $argument)*
        )
    };
}

/// Stores an alert, unless it lasts already, or is an event that is stored. A message to the webhook is due if `is_sent`.
///
/// # Errors
/// Returns [`StoreError::Database`] if a statement fails.
pub async fn begin(
    conn: &mut SqliteConnection,
    alert: &NewAlert,
    is_sent: bool,
    now: Millis,
) -> Result<(), StoreError> {
    let NewAlert { rule, run, subject, message, is_event } = alert;
    let (ended_at, next_attempt_at) = (is_event.then_some(now), is_sent.then_some(now));
    query!(
        "INSERT INTO alerts (rule, run, subject, message, began_at, ended_at, next_attempt_at)
         SELECT ?1, ?2, ?3, ?4, ?5, ?6, ?7 WHERE ?2 IS NULL OR EXISTS (SELECT 1 FROM runs WHERE id = ?2 AND deleted_at IS NULL)
         ON CONFLICT DO NOTHING",
        rule,
        run,
        subject,
        message,
        now,
        ended_at,
        next_attempt_at
    )
    .execute(&mut *conn)
    .await?;
    query!(
        "DELETE FROM alerts WHERE id <= (SELECT max(id) FROM alerts) - ? AND ended_at IS NOT NULL",
        MAX_ALERTS
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Ends an alert. If the webhook knows its beginning, a message about the end is due.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn end(conn: &mut SqliteConnection, id: i64, now: Millis) -> Result<(), StoreError> {
    // An end in the millisecond of the beginning would look like an event.
    query!(
        "UPDATE alerts SET ended_at = max(?2, began_at + 1),
             next_attempt_at = CASE WHEN sent_at IS NOT NULL THEN ?2 ELSE next_attempt_at END
         WHERE id = ?1 AND ended_at IS NULL",
        id,
        now
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Reads the alerts that last, oldest first.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn lasting(conn: &mut SqliteConnection) -> Result<Vec<AlertRow>, StoreError> {
    Ok(query_alerts!("a.ended_at IS NULL ORDER BY a.id").fetch_all(conn).await?)
}

/// Filter of a list of alerts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct AlertFilter<'a> {
    /// Id of the run; none for all runs and the server.
    pub run: Option<&'a str>,
    /// True for the alerts that last alone.
    pub lasts: bool,
}

/// Reads alerts with numbers below `before`, newest first.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn page(
    conn: &mut SqliteConnection,
    filter: AlertFilter<'_>,
    before: i64,
    limit: i64,
) -> Result<Vec<AlertRow>, StoreError> {
    let AlertFilter { run, lasts } = filter;
    Ok(match run {
        Some(run) => {
            query_alerts!(
                "a.run = ? AND a.id < ? AND (NOT ? OR a.ended_at IS NULL) ORDER BY a.id DESC LIMIT ?",
                run,
                before,
                lasts,
                limit
            )
            .fetch_all(conn)
            .await?
        }
        None => {
            query_alerts!(
                "a.id < ? AND (NOT ? OR a.ended_at IS NULL) ORDER BY a.id DESC LIMIT ?",
                before,
                lasts,
                limit
            )
            .fetch_all(conn)
            .await?
        }
    })
}

/// Counts the alerts that last.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn count_lasting(conn: &mut SqliteConnection) -> Result<i64, StoreError> {
    Ok(query_scalar!(
        r#"SELECT count(*) AS "n!: i64" FROM alerts a LEFT JOIN runs r ON r.id = a.run
           WHERE a.ended_at IS NULL AND r.deleted_at IS NULL"#
    )
    .fetch_one(conn)
    .await?)
}

/// Reads the alerts of which a message is due, the longest overdue first.
///
/// # Errors
/// Returns [`StoreError::Database`] if the query fails.
pub async fn due(conn: &mut SqliteConnection, now: Millis, limit: i64) -> Result<Vec<AlertRow>, StoreError> {
    Ok(query_alerts!("a.next_attempt_at <= ? ORDER BY a.next_attempt_at LIMIT ?", now, limit)
        .fetch_all(conn)
        .await?)
}

/// Records that the webhook took the message of an alert that was due: its beginning, or its end if it knows the beginning. An
/// end that came meanwhile is due next.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn record_sent(conn: &mut SqliteConnection, id: i64, now: Millis) -> Result<(), StoreError> {
    query!(
        "UPDATE alerts SET sent_at = coalesce(sent_at, ?2),
             end_sent_at = CASE WHEN sent_at IS NOT NULL THEN ?2 END,
             attempts = 0, send_error = NULL,
             next_attempt_at = CASE WHEN sent_at IS NULL AND ended_at > began_at THEN ?2 END
         WHERE id = ?1",
        id,
        now
    )
    .execute(conn)
    .await?;
    Ok(())
}

/// Records a failed attempt. Without a time of the next one, the message is given up.
///
/// # Errors
/// Returns [`StoreError::Database`] if the statement fails.
pub async fn record_failure(
    conn: &mut SqliteConnection,
    id: i64,
    error: &str,
    next_attempt_at: Option<Millis>,
) -> Result<(), StoreError> {
    query!(
        "UPDATE alerts SET attempts = attempts + 1, send_error = ?2, next_attempt_at = ?3 WHERE id = ?1",
        id,
        error,
        next_attempt_at
    )
    .execute(conn)
    .await?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn alert(rule: AlertRule, subject: &str, is_event: bool) -> NewAlert {
        NewAlert { rule, run: None, subject: subject.to_owned(), message: "It is so.".to_owned(), is_event }
    }

    async fn open(folder: &std::path::Path) -> SqliteConnection {
        crate::open_writer(&folder.join("db")).await.unwrap()
    }

    #[tokio::test]
    async fn lasting_alert_is_stored_once_and_again_after_its_end() {
        let folder = tempfile::tempdir().unwrap();
        let mut conn = open(folder.path()).await;
        let disk = alert(AlertRule::LowDisk, "", false);
        for now in [1, 2] {
            begin(&mut conn, &disk, true, now).await.unwrap();
        }
        let [first] = &lasting(&mut conn).await.unwrap()[..] else { panic!("one alert") };
        assert_eq!((first.began_at, first.rule), (1, AlertRule::LowDisk));
        end(&mut conn, first.id, 1).await.unwrap();
        begin(&mut conn, &disk, true, 5).await.unwrap();
        let times: Vec<_> = page(&mut conn, AlertFilter::default(), i64::MAX, 10).await.unwrap();
        let times: Vec<_> = times.iter().map(|row| (row.began_at, row.ended_at)).collect();
        assert_eq!(times, [(5, None), (1, Some(2))]);
    }

    #[tokio::test]
    async fn event_is_stored_once_and_never_lasts() {
        let folder = tempfile::tempdir().unwrap();
        let mut conn = open(folder.path()).await;
        let sql = "INSERT INTO runs (id, name, seed, status, settings, created_at) VALUES ('r', 'r', 7, 'active', '{}', 0)";
        sqlx::query(sql).execute(&mut conn).await.unwrap();
        let event = NewAlert { run: Some("r".to_owned()), ..alert(AlertRule::LevelDown, "7:a", true) };
        let gone = NewAlert { run: Some("gone".to_owned()), ..event.clone() };
        for new in [&event, &event, &gone] {
            begin(&mut conn, new, false, 3).await.unwrap();
        }
        assert_eq!(
            page(&mut conn, AlertFilter { run: Some("r"), lasts: false }, i64::MAX, 10).await.unwrap().len(),
            1
        );
        assert!(lasting(&mut conn).await.unwrap().is_empty());
        assert!(due(&mut conn, 9, 10).await.unwrap().is_empty(), "no webhook is to be told");
    }

    #[tokio::test]
    async fn webhook_is_told_the_beginning_before_the_end() {
        let folder = tempfile::tempdir().unwrap();
        let mut conn = open(folder.path()).await;
        begin(&mut conn, &alert(AlertRule::LowDisk, "", false), true, 1).await.unwrap();
        let id = due(&mut conn, 1, 10).await.unwrap()[0].id;
        record_failure(&mut conn, id, "refused", Some(60)).await.unwrap();
        assert!(due(&mut conn, 59, 10).await.unwrap().is_empty());
        end(&mut conn, id, 30).await.unwrap();
        assert!(due(&mut conn, 59, 10).await.unwrap().is_empty(), "the beginning is still to be told");
        record_sent(&mut conn, id, 60).await.unwrap();
        let [row] = &due(&mut conn, 60, 10).await.unwrap()[..] else { panic!("the end is due") };
        assert_eq!((row.sent_at, row.end_sent_at, row.attempts), (Some(60), None, 0));
        record_sent(&mut conn, id, 61).await.unwrap();
        let [row] = &page(&mut conn, AlertFilter::default(), i64::MAX, 10).await.unwrap()[..] else {
            panic!("one alert")
        };
        assert_eq!((row.sent_at, row.end_sent_at, row.next_attempt_at), (Some(60), Some(61), None));
    }
}
