//! Benchmarks: each prints the measured value, the goal and their ratio (above 1 is better than the goal).
//!
//! Each module measures one area and returns the rows of its table. Short benchmarks run by default; those that take
//! minutes run only if they are named. `sockets` has clients and process measurements that several modules use.

mod baseline_kernel;
mod bracket;
mod columns;
mod comparison;
mod crash;
mod critique;
mod curriculum;
mod designer;
mod engine;
mod feed;
mod growth;
mod job_cost;
mod levels;
mod load;
mod report_episodes;
mod results;
mod scale;
mod soak;
mod sockets;
mod steal_time;
mod stepping;
mod steps;
mod tasking;
mod worker_swarm;
mod workers;

use std::io::Write;
use std::path::PathBuf;

use clap::Parser;
use system_tests::crash::CrashWorld;

/// Measures Sparring against its goals. Run it on an idle machine: `make bench`.
#[derive(Debug, Parser)]
struct Args {
    /// Benchmarks to run; default: all that measure speed.
    ///
    /// `soak` loads the server and watches its memory. `growth` reports ten million episodes and watches the database.
    /// `crash` kills servers under trainers of kessler and compares acknowledgements with the database, `crash-tasking` under
    /// those of tasking, and `crash-workers` also kills workers and NATS (after `scripts/nats`). `load` runs 64 trainers.
    /// `runs` fills a database with runs, `slow-clients` opens connections of one byte a second beside trainers, and
    /// `large-database` measures start, lists, backup and vacuum with a database of ten GiB. `charts` measures the requests of the
    /// dashboard's charts, warm and cold, with ten million episodes in a thousand runs.
    /// `workers` compares the server's CPU time for an audited result with a worker on NATS and without one, and
    /// calculates results a second for up to 1 000 workers; `worker-swarm` simulates 1 000 idle and 200 busy ones (after
    /// `scripts/nats`). `feed` empties a trajectory feed over HTTP and over JetStream, with one trainer and with four that share it
    /// (after `scripts/nats`).
    /// `levels` prints the success of policies at every level. `learner` trains the demo's learner with and without the
    /// designer, for twenty minutes.
    #[arg(value_parser = ["engine", "bracket", "critique", "curriculum", "steps", "results", "columns", "sockets", "stepping", "growth", "crash", "crash-tasking", "crash-workers", "load", "soak", "runs", "slow-clients", "large-database", "charts", "designer", "learner", "levels", "tasking", "workers", "worker-swarm", "feed"])]
    benchmarks: Vec<String>,
    /// Duration of `soak`, `crash`, `crash-tasking`, `crash-workers` and `load`, in minutes
    #[arg(long, default_value_t = 10)]
    minutes: u32,
    /// Prefix of the names of the tasks that `levels` measures; default: all tasks
    #[arg(long, default_value = "")]
    task: String,
    /// First seed of the scenarios of `levels`
    #[arg(long, default_value_t = levels::FIRST_SEED)]
    first_seed: u64,
    /// Number of episodes that `growth` reports, or that the database of `charts` has
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
    /// File to which the figures are appended, as JSON, for a later comparison
    #[arg(long, value_name = "FILE")]
    save: Option<PathBuf>,
    /// File of figures that an earlier run saved: prints the ratio of each figure to it, above 1 is better. Saved turns are compared
    /// in pairs, the first with the first, so that runs in alternation show their spread
    #[arg(long, value_name = "FILE", conflicts_with = "against")]
    compare: Option<PathBuf>,
    /// Another build of this program, which takes turns with this one: prints the ratio of each figure to the other's, with its
    /// spread over the turns
    #[arg(long, value_name = "PROGRAM")]
    against: Option<PathBuf>,
    /// Number of turns; each measures all benchmarks once
    #[arg(long, default_value_t = 1)]
    turns: u32,
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
    replay_check: Option<PathBuf>,
}

/// Row of the printed table.
#[derive(Debug)]
pub(crate) struct Row {
    pub(crate) label: String,
    pub(crate) measured: String,
    pub(crate) goal: String,
    pub(crate) ratio: Option<f64>,
}

impl Row {
    /// Creates a row without a goal.
    pub(crate) fn plain(label: impl Into<String>, measured: String) -> Self {
        Self { label: label.into(), measured, goal: String::new(), ratio: None }
    }
}

/// Does the work of a process that another benchmark started; `None` if this is no such process.
fn answer_parent(args: &Args) -> anyhow::Result<Option<serde_json::Value>> {
    if let Some(file) = &args.replay_check {
        return designer::check_layouts(file).map(Some);
    }
    let turn = args.tasking_turn.as_ref();
    turn.map(|environment| tasking::measure_turn(environment, args.turn_envs, args.turn_seconds)).transpose()
}

/// Benchmark by its name.
type Measure<'a> = &'a dyn Fn() -> anyhow::Result<Vec<Row>>;

/// Prints rows of the table.
fn print_rows(rows: &[Row]) -> std::io::Result<()> {
    let mut out = std::io::stdout().lock();
    for row in rows {
        let ratio = row.ratio.map_or_else(String::new, |r| format!("{r:.2}×"));
        writeln!(out, "{:<80} {:>26}  {:<24} {ratio:>8}", row.label, row.measured, row.goal)?;
    }
    out.flush()
}

/// Prints the names of the columns.
fn print_header(measured: &str, goal: &str) -> std::io::Result<()> {
    let [label, measured, goal] = ["benchmark", measured, goal].map(str::to_owned);
    print_rows(&[Row { label, measured, goal, ratio: None }])
}

/// Runs the named benchmarks once, prints their rows, and returns them.
fn measure_turn(args: &Args) -> anyhow::Result<comparison::Turn> {
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
    let long: [(&str, Measure<'_>); 15] = [
        ("runs", &|| scale::many_runs::measure(args.runs)),
        ("slow-clients", &|| scale::slow_clients::measure(args.connections)),
        ("charts", &|| scale::charts::measure(args.episodes)),
        ("large-database", &|| scale::large_database::measure(args.gib)),
        ("load", &|| load::measure(args.minutes)),
        ("crash", &|| crash::measure(args.minutes, CrashWorld::Kessler, 0)),
        ("crash-tasking", &|| crash::measure(args.minutes, CrashWorld::Tasking, 0)),
        ("crash-workers", &|| crash::measure(args.minutes, CrashWorld::Kessler, 2)),
        ("growth", &|| growth::measure(args.episodes, args.group_size)),
        ("soak", &|| soak::measure(args.minutes)),
        ("learner", &designer::learner::measure),
        ("workers", &workers::measure),
        ("feed", &feed::measure),
        ("worker-swarm", &worker_swarm::measure),
        ("levels", &|| levels::measure(&args.task, args.first_seed)),
    ];
    let is_named = |name: &str| args.benchmarks.iter().any(|benchmark| benchmark == name);
    let all = all.into_iter().filter(|(name, _)| args.benchmarks.is_empty() || is_named(name));
    let mut turn = comparison::Turn::default();
    print_header("measured", "goal")?;
    for (name, measure) in all.chain(long.into_iter().filter(|(name, _)| is_named(name))) {
        let before = steal_time::Ticks::now();
        let rows = measure()?;
        print_rows(&rows)?;
        turn.add(name, &rows);
        print_rows(&steal_time::Ticks::rows_since(before))?;
    }
    Ok(turn)
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    if let Some(answer) = answer_parent(&args)? {
        return Ok(writeln!(std::io::stdout(), "{answer}")?);
    }
    let earlier = args.compare.as_deref().map(comparison::read).transpose()?;
    let (mut before, mut after) = (earlier.unwrap_or_default(), Vec::new());
    for _ in 0..args.turns.max(1) {
        if let Some(program) = &args.against {
            before.push(comparison::measure_other(program, &args.benchmarks)?);
        }
        let turn = measure_turn(&args)?;
        match &args.save {
            Some(file) => after = comparison::append(file, &turn)?,
            None => after.push(turn),
        }
    }
    if !before.is_empty() {
        print_header("spread", "ratio")?;
        print_rows(&comparison::compare(&before, &after))?;
    }
    Ok(())
}
