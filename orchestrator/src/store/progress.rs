//! Success over time, from the groups that were evidence: those that are kept whole, and stretches of those that were folded.

use std::collections::BTreeMap;

use sqlx::{SqliteConnection, query};

use super::StoreError;
use crate::clock::Millis;

/// A stretch of a task's evidence.
#[derive(Debug, Clone, PartialEq)]
pub struct Stretch {
    /// When its last group closed.
    pub at: Millis,
    /// The lowest level in it.
    pub low: Option<i64>,
    /// The highest.
    pub high: Option<i64>,
    /// Contested scenarios in it.
    pub n: i64,
    /// Sum of their success shares.
    pub sum: f64,
}

impl Stretch {
    /// Takes what came after it, too.
    pub fn join(&mut self, other: &Self) {
        let least = |a: Option<i64>, b: Option<i64>| a.into_iter().chain(b).min();
        *self = Self {
            at: self.at.max(other.at),
            low: least(self.low, other.low),
            high: self.high.max(other.high),
            n: self.n + other.n,
            sum: self.sum + other.sum,
        };
    }
}

/// Each task's contested evidence in order of time, in at most `parts` of about equal size.
///
/// # Errors
/// The database's.
pub async fn of_run(
    conn: &mut SqliteConnection,
    run: &str,
    parts: usize,
) -> Result<Vec<(String, Stretch)>, StoreError> {
    let mut stretches = BTreeMap::<String, Vec<Stretch>>::new();
    for (task, stretch) in folded(conn, run).await?.into_iter().chain(whole(conn, run, parts).await?) {
        stretches.entry(task).or_default().push(stretch);
    }
    let thinned = stretches.into_iter().flat_map(|(task, stretches)| {
        thin(stretches, parts).into_iter().map(move |stretch| (task.clone(), stretch))
    });
    Ok(thinned.collect())
}

/// Joins neighbours until there are no more than so many.
fn thin(stretches: Vec<Stretch>, most: usize) -> Vec<Stretch> {
    if stretches.len() <= most {
        return stretches;
    }
    let all: i64 = stretches.iter().map(|stretch| stretch.n).sum();
    let enough = all as f64 / most as f64;
    let mut thinned = Vec::<Stretch>::with_capacity(most);
    for stretch in stretches {
        match thinned.last_mut().filter(|last| (last.n as f64) < enough) {
            Some(last) => last.join(&stretch),
            None => thinned.push(stretch),
        }
    }
    thinned
}

/// Of what is kept whole.
async fn whole(
    conn: &mut SqliteConnection,
    run: &str,
    parts: usize,
) -> Result<Vec<(String, Stretch)>, StoreError> {
    let parts = parts as i64;
    let rows = query!(
        r#"SELECT task AS "task!", max(closed_at) AS "at!: i64", min(level) AS "low: i64", max(level) AS "high: i64",
                  count(*) AS "n!: i64", sum(1.0 * successes / finished) AS "sum!: f64"
           FROM (
               SELECT g.task, g.level, g.closed_at, g.successes, g.finished,
                      ntile(?2) OVER (PARTITION BY g.task ORDER BY g.closed_at, g.lease, g.number) AS part
               FROM leases l JOIN groups g ON g.lease = l.id
               WHERE l.run = ?1 AND l.folded = 0 AND g.contested = 1 AND g.evidence = 1 AND g.finished > 0
                     AND g.state IN ('complete', 'partial')
                     AND (g.proposal IS NOT NULL OR g.layout IS NOT NULL)
           )
           GROUP BY task, part ORDER BY task, part"#,
        run,
        parts
    )
    .fetch_all(conn)
    .await?;
    let stretches = rows
        .into_iter()
        .map(|r| (r.task, Stretch { at: r.at, low: r.low, high: r.high, n: r.n, sum: r.sum }));
    Ok(stretches.collect())
}

/// Of what was folded.
async fn folded(conn: &mut SqliteConnection, run: &str) -> Result<Vec<(String, Stretch)>, StoreError> {
    let rows = query!(
        r#"SELECT task, at, low, high, n, success AS "sum: f64" FROM folded_progress
           WHERE run = ? ORDER BY task, nth"#,
        run
    )
    .fetch_all(conn)
    .await?;
    let stretches = rows
        .into_iter()
        .map(|r| (r.task, Stretch { at: r.at, low: r.low, high: r.high, n: r.n, sum: r.sum }));
    Ok(stretches.collect())
}

/// A stretch is added to while it is shorter than all of them by this, so that a long run has a thousand of them.
const FRACTION: i64 = 128;
/// And while it is shorter than this.
const SHORTEST: i64 = 8;

/// Adds what is folded now of a task.
///
/// # Errors
/// The database's.
pub async fn add_folded(
    conn: &mut SqliteConnection,
    run: &str,
    task: &str,
    stretch: &Stretch,
) -> Result<(), StoreError> {
    let last = query!(
        r#"SELECT nth, at, low, high, n, success AS "sum: f64",
                  (SELECT sum(n) FROM folded_progress WHERE run = ?1 AND task = ?2) AS "all!: i64"
           FROM folded_progress WHERE run = ?1 AND task = ?2 ORDER BY nth DESC LIMIT 1"#,
        run,
        task
    )
    .fetch_optional(&mut *conn)
    .await?;
    let (nth, stretch) = match last {
        None => (0, stretch.clone()),
        Some(last) if last.n >= SHORTEST.max(last.all / FRACTION) => (last.nth + 1, stretch.clone()),
        Some(last) => {
            let mut joined =
                Stretch { at: last.at, low: last.low, high: last.high, n: last.n, sum: last.sum };
            joined.join(stretch);
            (last.nth, joined)
        }
    };
    query!(
        "INSERT INTO folded_progress (run, task, nth, at, low, high, n, success) VALUES (?, ?, ?, ?, ?, ?, ?, ?)
         ON CONFLICT (run, task, nth) DO UPDATE SET at = excluded.at, low = excluded.low, high = excluded.high,
             n = excluded.n, success = excluded.success",
        run,
        task,
        nth,
        stretch.at,
        stretch.low,
        stretch.high,
        stretch.n,
        stretch.sum
    )
    .execute(conn)
    .await?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thinning_keeps_what_there_is_in_order() {
        let stretch = |at: i64| Stretch { at, low: Some(at), high: Some(at), n: 1 + at % 7, sum: 0.5 };
        for count in [0, 1, 100, 101, 1000] {
            let all: Vec<_> = (0..count).map(stretch).collect();
            let thinned = thin(all.clone(), 100);
            assert!(thinned.len() <= 100, "{}", thinned.len());
            assert_eq!(thinned.iter().map(|s| s.n).sum::<i64>(), all.iter().map(|s| s.n).sum::<i64>());
            assert!(thinned.is_sorted_by_key(|s| s.at));
            assert_eq!(thinned.last().map(|s| s.at), all.last().map(|s| s.at));
        }
    }
}
