//! A database with one large run and many small ones. The server records the large run and one small run, whose rows are copied.

use std::io::Write;
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::Context;
use serde_json::json;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{AssertSqlSafe, ConnectOptions, Connection, SqliteConnection};
use system_tests::{ApiClient, ServerProcess};

use crate::report_episodes::report_episodes;

/// Id of the large run.
pub(super) const LARGE_RUN: &str = "large";
/// Id of the small run that is copied.
const SMALL_RUN: &str = "small";
/// Share of the episodes that the large run has: its denominator.
const LARGE_SHARE: u64 = 10;
/// Episodes of each scenario, as many as trainers of groups have.
const GROUP_SIZE: u32 = 32;
/// Steps with metrics of each run.
const METRIC_STEPS: u64 = 500;
/// Pause after a request that the server refused for its rate.
const RATE_PAUSE: Duration = Duration::from_secs(1);

/// Size of a filled database.
pub(super) struct Database {
    /// Number of episodes of all runs.
    pub(super) episodes: u64,
    /// Size of the file.
    pub(super) bytes: u64,
}

/// Id of a small run by its number.
pub(super) fn run_id(number: u32) -> String {
    if number == 0 { SMALL_RUN.to_owned() } else { format!("copy-{number}") }
}

/// Fills a database with about `episodes` episodes in `runs` small runs and a large one.
pub(super) async fn fill(file: &Path, episodes: u64, runs: u32) -> anyhow::Result<Database> {
    let start = Instant::now();
    let server = ServerProcess::start(file);
    let api = server.api();
    let large = train(&api, LARGE_RUN, episodes / LARGE_SHARE).await?;
    let small = train(&api, SMALL_RUN, (episodes - large) / u64::from(runs)).await?;
    anyhow::ensure!(server.terminate() == Some(0), "the server failed");
    let seconds = start.elapsed().as_secs_f64();
    writeln!(std::io::stderr(), "{large} and {small} episodes in two runs, {seconds:.0} s")?;
    let mut conn = SqliteConnectOptions::new().filename(file).foreign_keys(false).connect().await?;
    let copies = Copies::new(&mut conn).await?;
    for number in 1..runs {
        copies.add(&mut conn, number).await?;
        if number % 100 == 0 {
            let gib = std::fs::metadata(file)?.len() as f64 / f64::from(1 << 30);
            writeln!(
                std::io::stderr(),
                "{number} copies, {gib:.1} GiB, {:.0} s",
                start.elapsed().as_secs_f64()
            )?;
        }
    }
    sqlx::query("ANALYZE").execute(&mut conn).await?;
    sqlx::query("PRAGMA wal_checkpoint(TRUNCATE)").execute(&mut conn).await?;
    conn.close().await?;
    Ok(Database { episodes: large + small * u64::from(runs), bytes: std::fs::metadata(file)?.len() })
}

/// Creates a run, and reports its results and the metrics of a trainer.
async fn train(api: &ApiClient, run: &'static str, episodes: u64) -> anyhow::Result<u64> {
    let settings = json!({"strategy": "ladder", "id": run, "group_size": GROUP_SIZE, "tasks": ["kessler/survival"],
                          "design": {"designer": "off"}});
    let created = api.post("/v1/runs", settings).await;
    anyhow::ensure!(created.status == 201, "no run: {}", created.body);
    let done = report_episodes(api, run, episodes).await?;
    for step in 0..METRIC_STEPS {
        send_metrics(api, run, step).await?;
    }
    Ok(done)
}

/// Sends metrics of a trainer's step, again if the server limits the rate of such requests.
async fn send_metrics(api: &ApiClient, run: &str, step: u64) -> anyhow::Result<()> {
    let metrics = json!({"train/loss": 1.0 / (1 + step) as f64, "train/entropy": 0.5, "time/fps": step});
    loop {
        let body = json!({"step": step, "metrics": metrics});
        let sent = api.post(&format!("/v1/runs/{run}/metrics"), body).await;
        if sent.status != 429 {
            anyhow::ensure!(sent.status == 200, "no metrics: {}", sent.body);
            return Ok(());
        }
        tokio::time::sleep(RATE_PAUSE).await;
    }
}

/// Statements that copy the small run.
struct Copies {
    statements: Vec<String>,
}

/// Columns with numbers of other rows, which differ between copies.
const LEASE_COLUMNS: [&str; 3] = ["lease", "first_lease", "last_lease"];

impl Copies {
    /// Reads which tables have rows of runs. Bound values: 1 the number of the copy, 2 its id.
    async fn new(conn: &mut SqliteConnection) -> anyhow::Result<Self> {
        let tables =
            "SELECT m.name, group_concat(c.name) FROM sqlite_schema m JOIN pragma_table_info(m.name) c
                      WHERE m.type = 'table' GROUP BY m.name";
        let tables: Vec<(String, String)> = sqlx::query_as(tables).fetch_all(&mut *conn).await?;
        let leases: i64 = sqlx::query_scalar("SELECT max(id) FROM leases").fetch_one(&mut *conn).await?;
        let cells: i64 =
            sqlx::query_scalar("SELECT max(id) FROM failure_cells").fetch_one(&mut *conn).await?;
        let mut statements = Vec::new();
        for (table, columns) in tables {
            let columns: Vec<&str> = columns.split(',').collect();
            let from = match table.as_str() {
                "runs" => format!("id = '{SMALL_RUN}'"),
                _ if columns.contains(&"run") => format!("run = '{SMALL_RUN}'"),
                _ if columns.contains(&"lease") => {
                    format!("lease IN (SELECT id FROM leases WHERE run = '{SMALL_RUN}')")
                }
                _ => continue,
            };
            let value = |column: &&str| match (table.as_str(), *column) {
                ("runs", "id") | (_, "run") => "?2".to_owned(),
                ("leases", "id") => format!("id + ?1 * {leases}"),
                ("failure_cells", "id") => format!("id + ?1 * {cells}"),
                ("failure_examples", "cell") => format!("cell + ?1 * {cells}"),
                (_, lease) if LEASE_COLUMNS.contains(&lease) => format!("{lease} + ?1 * {leases}"),
                (_, "id") => "NULL".to_owned(),
                ("runs", "name") => "?2".to_owned(),
                ("runs", "created_at") => "created_at - ?1".to_owned(),
                (_, column) => column.to_owned(),
            };
            let values: Vec<String> = columns.iter().map(value).collect();
            let columns = columns.join(", ");
            statements.push(format!(
                "INSERT INTO {table} ({columns}) SELECT {} FROM {table} WHERE {from}",
                values.join(", ")
            ));
        }
        anyhow::ensure!(statements.len() > 30, "tables of runs are not found");
        Ok(Self { statements })
    }

    /// Adds a copy of the small run.
    async fn add(&self, conn: &mut SqliteConnection, number: u32) -> anyhow::Result<()> {
        let mut tx = conn.begin().await?;
        for statement in &self.statements {
            let copied = sqlx::query(AssertSqlSafe(statement.clone())).bind(number).bind(run_id(number));
            copied.execute(&mut *tx).await.with_context(|| statement.clone())?;
        }
        Ok(tx.commit().await?)
    }
}
