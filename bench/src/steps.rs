//! Environment steps a second on one thread, for each benchmark of the worlds.

use env_core::World;

use crate::Row;

const SECONDS: f64 = 5.0;
/// Goal of the ratio to the public Python environment of the world, if its speed is known.
const GOAL: f64 = 50.0;

pub(crate) fn measure() -> anyhow::Result<Vec<Row>> {
    let row = |spec| {
        let measured = commands::bench::measure(spec, &[], Default::default(), SECONDS)?;
        let per_s = measured.python_env_us_per_step.map(|us| 1e6 / us);
        Ok(Row {
            label: format!("steps with observations and resets, one thread: {}", measured.description),
            measured: format!("{:.0} steps/s", measured.single_thread_env_steps_per_s),
            goal: per_s.map_or_else(String::new, |per_s| format!("≥ {GOAL} × Python's {per_s:.0}/s")),
            ratio: measured.times_python_env.map(|times| times / GOAL),
        })
    };
    env_core::worlds().flat_map(World::benchmarks).map(row).collect()
}
