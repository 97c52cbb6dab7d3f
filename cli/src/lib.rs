//! The command line: one file (or folder) per subcommand, each with `Args` and `run`.
//!
//! Results go to stdout, everything else (logs, progress, the one sentence about what went wrong) to stderr. Exit codes:
//! 0 all is well, 1 a check failed, 2 bad input or anything else that went wrong.

pub mod agreement;
pub mod bench;
pub mod critique;
pub mod db;
pub mod demo;
pub mod design;
pub mod eval;
pub mod judge;
pub mod llm_args;
mod logs;
pub mod options;
mod output;
pub mod play;
pub mod policy;
pub mod replay;
pub mod report;
pub mod serve;
pub mod simulate;
pub mod suite;
#[cfg(test)]
mod tests;
pub mod token;
mod worlds;

use std::io::Write;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

use self::logs::Logs;

/// What went wrong was the input or the machine, not a check.
const FAULT: u8 = 2;

/// Trains agents that fly satellites: the better the agent gets, the harder its sparring partner fights back.
///
/// `sparring` remembers what an agent has mastered, picks what it should face next, and judges what it did by replaying
/// its actions. Every subcommand explains itself: `sparring eval --help`.
#[derive(Debug, Parser)]
#[command(name = "sparring", version, after_help = AFTER_HELP)]
pub struct Cli {
    #[command(flatten)]
    logs: Logs,
    #[command(subcommand)]
    command: Command,
}

const AFTER_HELP: &str = "\
Exit codes: 0 all is well; 1 a check failed (a replay beyond its tolerance, a suite that differs, an episode \
that could not be flown to its end); 2 bad input, or \
anything else that went wrong, in one sentence on stderr.";

/// What to do. Of a variant without a doc comment `--help` shows that of its `Args`.
#[derive(Debug, Subcommand)]
enum Command {
    Serve(serve::Args),
    Demo(demo::Args),
    Design(design::Args),
    Eval(eval::Args),
    Play(play::Args),
    Suite(suite::Args),
    SimulateCurriculum(simulate::Args),
    Replay(replay::Args),
    Critique(critique::Args),
    JudgeAgreement(agreement::Args),
    Report(report::Args),
    Db(db::Args),
    Token(token::Args),
    Bench(bench::Args),
}

impl Command {
    /// What is logged unless something else is asked for: the demo has a screen of its own, play says itself how episodes go.
    const fn usual_logs(&self) -> &'static str {
        match self {
            Self::Demo(_) => "warn",
            Self::Play(_) => "error",
            _ => "info",
        }
    }

    fn run(&self) -> anyhow::Result<ExitCode> {
        match self {
            Self::Serve(args) => serve::run(args),
            Self::Demo(args) => demo::run(args),
            Self::Design(args) => design::run(args),
            Self::Eval(args) => eval::run(args),
            Self::Play(args) => play::run(args),
            Self::Suite(args) => suite::run(args),
            Self::SimulateCurriculum(args) => simulate::run(args),
            Self::Replay(args) => replay::run(args),
            Self::Critique(args) => critique::run(args),
            Self::JudgeAgreement(args) => agreement::run(args),
            Self::Report(args) => report::run(args),
            Self::Db(args) => db::run(args),
            Self::Token(args) => token::run(args),
            Self::Bench(args) => bench::run(args),
        }
    }
}

/// Reads the command line, does what it says, and answers with an exit code.
#[must_use]
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    let logged = cli.logs.start(cli.command.usual_logs());
    match logged.and_then(|_started| cli.command.run()) {
        Ok(code) => code,
        Err(error) => {
            // Where stderr is gone too, the exit code is all that is left to say it with.
            let _ = writeln!(std::io::stderr().lock(), "sparring: {error:#}");
            ExitCode::from(FAULT)
        }
    }
}
