//! Benchmarks that anyone can run: each prints what was measured in this run, the goal, and their ratio (above 1 is
//! better than the goal).

mod bare;
mod bracket;
mod columns;
mod critique;
mod curriculum;
mod designer;
mod engine;
mod growth;
mod levels;
mod load;
mod results;
mod soak;
mod sockets;
mod stepping;
mod steps;
mod stolen;
mod survival;

use std::io::Write;

use clap::Parser;

/// Measures Sparring against its goals. Run it on an idle machine, in release: `make bench`.
#[derive(Debug, Parser)]
struct Args {
    /// What to measure; all of speed if none is named. `soak` loads the server for ten minutes
    /// and watches its memory; `growth` reports ten million episodes and watches the
    /// database; `survival` kills
    /// servers under trainers and compares what those were told with what there is; `load` has sixty-four trainers for some minutes; `levels` prints what policies win, level by level; `learner`
    /// trains the demo's learner with and without the designer, for twenty minutes.
    #[arg(value_parser = ["engine", "bracket", "critique", "curriculum", "steps", "results", "columns", "sockets", "stepping", "growth", "survival", "load", "soak", "designer", "learner", "levels"])]
    what: Vec<String>,
    /// How long `soak`, `survival` and `load` last
    #[arg(long, default_value_t = 10)]
    minutes: u32,
    /// How many episodes `growth` reports
    #[arg(long, default_value_t = 10_000_000)]
    episodes: u64,
    /// Episodes of each of its scenarios
    #[arg(long, default_value_t = 1)]
    group_size: u32,
    #[command(flatten)]
    peer: sockets::Peer,
    /// Flies the layouts of a file again, and says how many are not what they claim: the process that `designer` starts.
    #[arg(long, hide = true)]
    again: Option<std::path::PathBuf>,
}

/// One line of the table.
#[derive(Debug)]
pub(crate) struct Row {
    pub(crate) what: String,
    pub(crate) measured: String,
    pub(crate) goal: String,
    pub(crate) ratio: Option<f64>,
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let mut out = std::io::stdout().lock();
    if let Some(file) = &args.again {
        return Ok(writeln!(out, "{}", designer::check_again(file)?)?);
    }
    let mut show = |rows: Vec<Row>| -> std::io::Result<()> {
        for row in rows {
            let ratio = row.ratio.map_or_else(String::new, |r| format!("{r:.2}×"));
            writeln!(out, "{:<80} {:>26}  {:<24} {ratio:>8}", row.what, row.measured, row.goal)?;
        }
        out.flush()
    };
    show(vec![Row { what: "what".into(), measured: "measured".into(), goal: "goal".into(), ratio: None }])?;
    type Measure<'a> = &'a dyn Fn() -> anyhow::Result<Vec<Row>>;
    let all: [(&str, Measure<'_>); 10] = [
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
    ];
    // These take minutes, and are measured only where they are named.
    let long: [(&str, Measure<'_>); 6] = [
        ("load", &|| load::measure(args.minutes)),
        ("survival", &|| survival::measure(args.minutes)),
        ("growth", &|| growth::measure(args.episodes, args.group_size)),
        ("soak", &|| soak::measure(args.minutes)),
        ("learner", &designer::learner::measure),
        ("levels", &levels::measure),
    ];
    let named = |name: &str| args.what.iter().any(|what| what == name);
    let all = all.into_iter().filter(|(name, _)| args.what.is_empty() || named(name));
    for (_, measure) in all.chain(long.into_iter().filter(|(name, _)| named(name))) {
        let before = stolen::Ticks::now();
        show(measure()?)?;
        show(stolen::Ticks::since(before))?;
    }
    Ok(())
}
