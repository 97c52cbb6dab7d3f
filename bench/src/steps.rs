//! Environment steps a second, one thread, world by world.

use crate::Row;

const SECONDS: f64 = 5.0;
/// What the public Python environment must be beaten by, where its speed is known.
const GOAL: f64 = 50.0;

pub(crate) fn measure() -> anyhow::Result<Vec<Row>> {
    let row = |world| {
        let measured = orchestrator::cli::bench::measure(world, &[], Default::default(), SECONDS)?;
        let per_s = measured.python_env_us_per_step.map(|us| 1e6 / us);
        Ok(Row {
            what: format!("steps, one thread, observed, with resets: {}", measured.what),
            measured: format!("{:.0} steps/s", measured.single_thread_env_steps_per_s),
            goal: per_s.map_or_else(String::new, |per_s| format!("≥ {GOAL} × Python's {per_s:.0}/s")),
            ratio: measured.times_python_env.map(|times| times / GOAL),
        })
    };
    env_core::worlds().map(row).collect()
}
