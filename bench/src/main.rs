//! Benchmarks: each prints the measured value, the goal and their ratio (above 1 is better than the goal).
//!
//! Each module measures one area and returns the rows of its table. Short benchmarks run by default; those that take
//! minutes run only if they are named. `sockets` has clients and process measurements that several modules use.

mod baseline_kernel;
mod bracket;
mod columns;
mod crash;
mod critique;
mod curriculum;
mod designer;
mod engine;
mod growth;
mod levels;
mod load;
mod results;
mod scale;
mod soak;
mod sockets;
mod steal_time;
mod stepping;
mod steps;
mod tasking;
mod workers;

use std::io::Write;

use clap::Parser;
use system_tests::crash::CrashWorld;

/// Measures Sparring against its goals. Run it on an idle machine: `make bench`.
#[derive(Debug, Parser)]
struct Args {
    /// Benchmarks to run; default: all that measure speed.
    ///
    /// `soak` loads the server and watches its memory. `growth` reports ten million episodes and watches the database.
    /// `crash` kills servers under trainers of kessler and compares acknowledgements with the database, `crash-tasking` under
    /// those of tasking. `load` runs 64 trainers.
    /// `runs` fills a database with runs, `slow-clients` opens connections of one byte a second beside trainers, and
    /// `large-database` measures start, lists, backup and vacuum with a database of ten GiB.
    /// `workers` compares the server's CPU time for an audited result with a worker on NATS and without one (after `scripts/nats`).
    /// `levels` prints the success of policies at every level. `learner` trains the demo's learner with and without the
    /// designer, for twenty minutes.
    #[arg(value_parser = ["engine", "bracket", "critique", "curriculum", "steps", "results", "columns", "sockets", "stepping", "growth", "crash", "crash-tasking", "load", "soak", "runs", "slow-clients", "large-database", "designer", "learner", "levels", "tasking", "workers"])]
    benchmarks: Vec<String>,
    /// Duration of `soak`, `crash`, `crash-tasking` and `load`, in minutes
    #[arg(long, default_value_t = 10)]
    minutes: u32,
    /// Prefix of the names of the tasks that `levels` measures; default: all tasks
    #[arg(long, default_value = "")]
    task: String,
    /// First seed of the scenarios of `levels`
    #[arg(long, default_value_t = levels::FIRST_SEED)]
    first_seed: u64,
    /// Number of episodes that `growth` reports
    #[arg(long, default_value_t = 10_000_000)]
    episodes: u64,
    /// Episodes of each scenario of `growth`
    #[arg(long, default_value_t = 1)]
    group_size: u32,
    /// Number of runs of `runs`
    #[arg(long, default_value_t = 10_000)]
    runs: u32,
    /// Number of connections of `slow-clients`
    #[arg(long, default_value_t = 2000)]
    connections: usize,
    /// Size of the database of `large-database`, in GiB
    #[arg(long, default_value_t = 10)]
    gib: u32,
    #[command(flatten)]
    peer: sockets::Peer,
    /// Measures an environment of tasking for one turn and prints the result as JSON; `bsk_peers.py` starts this process
    #[arg(long, hide = true)]
    tasking_turn: Option<String>,
    /// Number of environments of the turn
    #[arg(long, hide = true, default_value_t = 64)]
    turn_envs: usize,
    /// Duration of the turn in seconds
    #[arg(long, hide = true, default_value_t = 3.0)]
    turn_seconds: f64,
    /// Replays the layouts of a file and prints how many differ from their claims; `designer` starts this process
    #[arg(long, hide = true)]
    replay_check: Option<std::path::PathBuf>,
}

/// Row of the printed table.
#[derive(Debug)]
pub(crate) struct Row {
    pub(crate) label: String,
    pub(crate) measured: String,
    pub(crate) goal: String,
    pub(crate) ratio: Option<f64>,
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let mut out = std::io::stdout().lock();
    if let Some(file) = &args.replay_check {
        return Ok(writeln!(out, "{}", designer::check_layouts(file)?)?);
    }
    if let Some(environment) = &args.tasking_turn {
        return Ok(writeln!(
            out,
            "{}",
            tasking::measure_turn(environment, args.turn_envs, args.turn_seconds)?
        )?);
    }
    let mut show = |rows: Vec<Row>| -> std::io::Result<()> {
        for row in rows {
            let ratio = row.ratio.map_or_else(String::new, |r| format!("{r:.2}×"));
            writeln!(out, "{:<80} {:>26}  {:<24} {ratio:>8}", row.label, row.measured, row.goal)?;
        }
        out.flush()
    };
    show(vec![Row {
        label: "benchmark".into(),
        measured: "measured".into(),
        goal: "goal".into(),
        ratio: None,
    }])?;
    type Measure<'a> = &'a dyn Fn() -> anyhow::Result<Vec<Row>>;
    let all: [(&str, Measure<'_>); 11] = [
        ("engine", &engine::measure),
        ("bracket", &bracket::measure),
        ("critique", &critique::measure),
        ("curriculum", &curriculum::measure),
        ("steps", &steps::measure),
        ("results", &results::measure),
        ("columns", &columns::measure),
        ("sockets", &|| sockets::measure(&args.peer)),
        ("stepping", &stepping::measure),
        ("designer", &designer::measure),
        ("tasking", &tasking::measure),
    ];
    // These take minutes and run only if they are named.
    let long: [(&str, Measure<'_>); 11] = [
        ("runs", &|| scale::many_runs::measure(args.runs)),
        ("slow-clients", &|| scale::slow_clients::measure(args.connections)),
        ("large-database", &|| scale::large_database::measure(args.gib)),
        ("load", &|| load::measure(args.minutes)),
        ("crash", &|| crash::measure(args.minutes, CrashWorld::Kessler)),
        ("crash-tasking", &|| crash::measure(args.minutes, CrashWorld::Tasking)),
        ("growth", &|| growth::measure(args.episodes, args.group_size)),
        ("soak", &|| soak::measure(args.minutes)),
        ("learner", &designer::learner::measure),
        ("workers", &workers::measure),
        ("levels", &|| levels::measure(&args.task, args.first_seed)),
    ];
    let is_named = |name: &str| args.benchmarks.iter().any(|benchmark| benchmark == name);
    let all = all.into_iter().filter(|(name, _)| args.benchmarks.is_empty() || is_named(name));
    for (_, measure) in all.chain(long.into_iter().filter(|(name, _)| is_named(name))) {
        let before = steal_time::Ticks::now();
        show(measure()?)?;
        show(steal_time::Ticks::rows_since(before))?;
    }
    Ok(())
}
