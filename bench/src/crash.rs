//! Crash test of minutes or hours: measures no speed, but fails if an acknowledged result is lost or counted twice.

use std::io::Write;
use std::time::Duration;

use system_tests::crash::{CrashPlan, CrashWorld, StopCondition, run_crash_test};

use crate::Row;

pub(crate) fn measure(minutes: u32, world: CrashWorld, workers: usize) -> anyhow::Result<Vec<Row>> {
    let folder = tempfile::tempdir()?;
    // The control file of the faults is beside the folder of the database.
    let data = folder.path().join("data");
    std::fs::create_dir(&data)?;
    let until = StopCondition::Time(Duration::from_secs(60 * u64::from(minutes)));
    let seed = u64::from(std::process::id());
    let plan = CrashPlan {
        world,
        until,
        seed,
        min_lifetime_ms: 50,
        // Critiques of tasking take a third of a second each, and designs need some.
        max_lifetime_ms: if world == CrashWorld::Tasking { 60_000 } else { 20_000 },
        tls: true,
        faults: cfg!(target_os = "linux"),
        compacts: true,
        workers,
        progress_interval_s: 60,
    };
    writeln!(std::io::stderr(), "seed {}", plan.seed)?;
    let report =
        tokio::runtime::Runtime::new()?.block_on(run_crash_test(&data.join("survivor.sqlite3"), plan))?;
    writeln!(std::io::stdout(), "{report}")?;
    Ok(vec![Row {
        label: format!(
            "{minutes} minutes, {} processes killed: lost acknowledged results",
            report.kills + report.worker_kills + report.nats_kills
        ),
        measured: "0".into(),
        goal: "0".into(),
        ratio: None,
    }])
}
