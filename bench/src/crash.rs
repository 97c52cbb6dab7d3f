//! Crash test of minutes or hours: measures no speed, but fails if an acknowledged result is lost or counted twice. Ctrl-C ends it early,
//! with the counts until then.

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
        max_lifetime_ms: match (world, workers) {
            (CrashWorld::Tasking, _) => 60_000,
            (_, 0) => 20_000,
            // More than a hundred processes are killed in half an hour, also on a busy machine.
            _ => 12_000,
        },
        tls: true,
        faults: cfg!(target_os = "linux"),
        compacts: true,
        workers,
        trainer_pause_ms: 0,
        ends_on_signal: true,
        progress_interval_s: 60,
    };
    writeln!(std::io::stderr(), "seed {}", plan.seed)?;
    let report =
        tokio::runtime::Runtime::new()?.block_on(run_crash_test(&data.join("survivor.sqlite3"), plan))?;
    writeln!(std::io::stdout(), "{report}")?;
    let end = if report.is_interrupted { ", interrupted" } else { "" };
    Ok(vec![Row {
        label: format!(
            "{:.1} minutes{end}, {} processes killed: lost acknowledged results",
            report.elapsed_s as f64 / 60.0,
            report.kills + report.worker_kills + report.nats_kills
        ),
        measured: "0".into(),
        goal: "0".into(),
        ratio: None,
    }])
}
