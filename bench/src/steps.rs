//! Environment steps a second, one thread.

use crate::Row;

const SECONDS: f64 = 5.0;
/// What the public Python environment must be beaten by.
const GOAL: f64 = 50.0;

pub(crate) fn measure() -> anyhow::Result<Vec<Row>> {
    let measured = orchestrator::cli::bench::measure(SECONDS)?;
    let times = measured.times_python_env;
    Ok(vec![Row {
        what: "environment steps, one thread, 50 debris, observed, with resets".into(),
        measured: format!("{:.0} steps/s", measured.single_thread_env_steps_per_s),
        goal: format!("≥ {GOAL} × Python's 8000/s"),
        ratio: Some(times / GOAL),
    }])
}
