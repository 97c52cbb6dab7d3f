//! A database of ten GiB: start of the server, lists, a backup while trainers report, and vacuum.

use std::io::Write;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

use serde_json::json;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{AssertSqlSafe, ConnectOptions, Connection, SqliteConnection};
use system_tests::{ApiClient, ServerProcess, sparring_binary};

use super::{GOAL_START_MS, goal_row, median_ms, start_server};
use crate::sockets::process;
use crate::{Row, results};

/// Leases that are reported; their rows are then doubled until the file is large enough.
const REPORTED_LEASES: usize = 24;
/// Tables whose rows are doubled, parents first.
const TABLES: [&str; 4] = ["leases", "groups", "episodes", "action_logs"];
/// Goal of a list request, in milliseconds.
const GOAL_LIST_MS: f64 = 50.0;
/// Reports that are measured without and beside the backup.
const MEASURED_REPORTS: usize = 200;

pub(crate) fn measure(gib: u32) -> anyhow::Result<Vec<Row>> {
    tokio::runtime::Runtime::new()?.block_on(run(u64::from(gib) << 30))
}

async fn run(bytes: u64) -> anyhow::Result<Vec<Row>> {
    let folder = tempfile::tempdir()?;
    let (file, copy) = (folder.path().join("bench.sqlite3"), folder.path().join("copy.sqlite3"));
    fill(&file, bytes).await?;
    let size = std::fs::metadata(&file)?.len() as f64 / f64::from(1 << 30);
    let (server, start_ms) = start_server(&file).await;
    let api = server.api();
    let mut rows = vec![goal_row(
        format!("start with a database of {size:.1} GiB, until ready"),
        start_ms,
        GOAL_START_MS,
    )];
    let lists = ["episodes?limit=100", "leases?limit=100", "overview", "mastery", "level_moves"];
    for list in lists {
        let ms = median_ms(&api, &format!("/v1/runs/bench/{list}")).await?;
        rows.push(goal_row(format!("GET /v1/runs/bench/{list}"), ms, GOAL_LIST_MS));
    }
    let alone = report_times(&api).await?;
    let backup_s = spawn_command(&["backup", &copy.to_string_lossy()], &file);
    let beside = report_times(&api).await?;
    let backup_s = backup_s.await??;
    let mib = process::resident_bytes(server.pid())? as f64 / f64::from(1 << 20);
    anyhow::ensure!(server.terminate() == Some(0), "the server failed");
    for row in &rows {
        writeln!(std::io::stderr(), "{}: {}", row.label, row.measured)?;
    }
    writeln!(
        std::io::stderr(),
        "backup {backup_s:.0} s; p99 of results {beside:.1} ms, {alone:.1} ms alone; {mib:.0} MiB"
    )?;
    rows.push(Row::plain("backup while trainers report", format!("{backup_s:.0} s")));
    rows.push(Row::plain("p99 of results beside the backup", format!("{beside:.1} ms, {alone:.1} alone")));
    rows.push(Row::plain("memory of the server", format!("{mib:.0} MiB")));
    for command in ["check", "vacuum"] {
        let seconds = spawn_command(&[command], &file).await??;
        writeln!(std::io::stderr(), "db {command}: {seconds:.0} s")?;
        rows.push(Row::plain(format!("db {command}"), format!("{seconds:.0} s")));
    }
    Ok(rows)
}

/// Runs `sparring db` with some arguments; returns its duration in seconds. `check` reports that the copied rows are in no counter
/// of the run, with exit status 1.
fn spawn_command(args: &[&str], db: &Path) -> tokio::task::JoinHandle<anyhow::Result<f64>> {
    let mut command = Command::new(sparring_binary());
    command.arg("db").arg("--db").arg(db).args(args).stdout(std::process::Stdio::null());
    let name = args.join(" ");
    tokio::task::spawn_blocking(move || {
        let start = Instant::now();
        let status = command.status()?;
        let is_expected = status.success() || (name == "check" && status.code() == Some(1));
        anyhow::ensure!(is_expected, "db {name}: {status}");
        Ok(start.elapsed().as_secs_f64())
    })
}

/// Leases and reports; returns the 99th percentile of the reports, milliseconds.
async fn report_times(api: &ApiClient) -> anyhow::Result<f64> {
    let mut times = Vec::new();
    while times.len() < MEASURED_REPORTS {
        for body in results::lease_and_build_batches(api, "bench").await? {
            let start = Instant::now();
            results::send_batch(api, "bench", body).await?;
            times.push(start.elapsed().as_secs_f64() * 1e3);
        }
    }
    times.sort_by(f64::total_cmp);
    Ok(times[times.len() * 99 / 100])
}

/// Reports results to a new database, and doubles their rows until the file has `bytes`.
async fn fill(file: &Path, bytes: u64) -> anyhow::Result<()> {
    let server = ServerProcess::start(file);
    let api = server.api();
    let settings = json!({"id": "bench", "seed": 1, "group_size": 8, "placement": false, "tasks": ["kessler/survival"],
                          "design": {"designer": "off"}, "retention": {"episodes": "all"}});
    let created = api.post("/v1/runs", settings).await;
    anyhow::ensure!(created.status == 201, "no run: {}", created.body);
    for _ in 0..REPORTED_LEASES {
        for body in results::lease_and_build_batches(&api, "bench").await? {
            results::send_batch(&api, "bench", body).await?;
        }
    }
    anyhow::ensure!(server.terminate() == Some(0), "the server failed");
    let mut conn = SqliteConnectOptions::new().filename(file).foreign_keys(false).connect().await?;
    while std::fs::metadata(file)?.len() < bytes {
        let start = Instant::now();
        let offset: i64 = sqlx::query_scalar("SELECT max(id) FROM leases").fetch_one(&mut conn).await?;
        for table in TABLES {
            double_rows(&mut conn, table, offset).await?;
        }
        sqlx::query("PRAGMA wal_checkpoint(TRUNCATE)").execute(&mut conn).await?;
        let gib = std::fs::metadata(file)?.len() as f64 / f64::from(1 << 30);
        writeln!(std::io::stderr(), "{gib:.2} GiB, {:.0} s", start.elapsed().as_secs_f64())?;
    }
    Ok(conn.close().await?)
}

/// Inserts a copy of every row of a table, for a lease whose number is larger by `offset`.
async fn double_rows(conn: &mut SqliteConnection, table: &str, offset: i64) -> anyhow::Result<()> {
    let columns = sqlx::query_scalar::<_, String>("SELECT name FROM pragma_table_info(?)").bind(table);
    let columns: Vec<String> = columns.fetch_all(&mut *conn).await?;
    let lease = if table == "leases" { "id" } else { "lease" };
    let value = |column: &String| match column.as_str() {
        name if name == lease => format!("{name} + {offset}"),
        "id" => "NULL".to_owned(),
        name => name.to_owned(),
    };
    let values: Vec<String> = columns.iter().map(value).collect();
    let statement =
        format!("INSERT INTO {table} ({}) SELECT {} FROM {table}", columns.join(", "), values.join(", "));
    sqlx::query(AssertSqlSafe(statement)).execute(conn).await?;
    Ok(())
}
