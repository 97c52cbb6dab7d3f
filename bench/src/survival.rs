//! Hours of kills, and the ledger of what trainers were told: not fast or slow, but right or wrong.

use std::io::Write;
use std::time::Duration;

use system_tests::survival::{Plan, Until, survive};

use crate::Row;

pub(crate) fn measure(minutes: u32) -> anyhow::Result<Vec<Row>> {
    let folder = tempfile::tempdir()?;
    let until = Until::Time(Duration::from_secs(60 * u64::from(minutes)));
    let seed = u64::from(std::process::id());
    let plan = Plan { until, seed, life_ms: (50, 20_000), folds: true, told_every_s: 60 };
    writeln!(std::io::stderr(), "seed {}", plan.seed)?;
    let ledger =
        tokio::runtime::Runtime::new()?.block_on(survive(&folder.path().join("survivor.sqlite3"), plan))?;
    writeln!(std::io::stdout(), "{ledger}")?;
    Ok(vec![Row {
        what: format!(
            "{minutes} minutes, {} servers killed: acknowledged results that are lost",
            ledger.kills
        ),
        measured: "0".into(),
        goal: "0".into(),
        ratio: None,
    }])
}
