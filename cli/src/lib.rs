//! The command line of Sparring: one file or folder per subcommand, each with `Args` and `run`.
//!
//! Start reading at [`main`] and the subcommand of interest. This crate has the subcommands that use the service or its
//! database; the crate `commands` has the others, the arguments that several subcommands share, and the output. [`judge`]
//! holds arguments of the server. Decisions and storage live in the crates below (`orchestrator`, `curriculum`,
//! `designer`, `env-core`).
//!
//! Results go to stdout; logs, progress and error messages go to stderr. Exit codes: 0 success, 1 a failed check, 2 bad input
//! or another error.

pub mod alert_args;
pub mod bind_args;
pub mod completions;
pub mod config;
pub mod db;
pub mod demo;
#[doc(hidden)]
pub mod fuzzing;
pub mod judge;
pub mod man;
mod mcp;
mod own_service;
pub mod remote_workers_args;
pub mod report;
pub mod serve;
pub mod shard_args;
#[cfg(test)]
mod tests;
pub mod tls_args;
pub mod token;

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{ArgMatches, Parser, Subcommand};

use commands::logs::LogArgs;
use commands::output::{OutputTarget, error_text};
use commands::{
    agreement, bench, critique, design, eval, interrupt, play, replay, runs, simulate, status, suite, tail,
    worker, workers,
};

use self::config::ConfigFile;

/// Exit code of bad input or another error; a failed check has exit code 1.
const ERROR_EXIT_CODE: u8 = 2;

/// Train agents that control satellites with a curriculum that gets harder as the agent gets better.
///
/// `sparring` records which levels an agent has mastered, chooses the next scenarios, and scores results by replaying the
/// reported actions. Every subcommand has its own help: `sparring eval --help`.
#[derive(Debug, Parser)]
#[command(name = "sparring", version, after_help = AFTER_HELP)]
pub struct Cli {
    /// Path of the configuration file [default: ./sparring.toml, else sparring/sparring.toml in the configuration folder]
    #[arg(
        long,
        global = true,
        value_name = "FILE",
        env = "SPARRING_CONFIG",
        hide_env_values = true,
        help_heading = "Configuration"
    )]
    config: Option<PathBuf>,
    #[command(flatten)]
    logs: LogArgs,
    #[command(subcommand)]
    command: Command,
}

const AFTER_HELP: &str = "\
Exit codes: 0 success; 1 a check failed (a replay beyond its tolerance, a suite that differs, an episode that was not run to \
its end); 2 bad input or another error, with one sentence on stderr; 130 Ctrl-C.";

/// Subcommand to run. `--help` shows the doc comment of a variant's `Args`.
#[derive(Debug, Subcommand)]
enum Command {
    Serve(Box<serve::Args>),
    Worker(worker::Args),
    Workers(workers::Args),
    Demo(demo::Args),
    Runs(runs::Args),
    Status(status::Args),
    Tail(tail::Args),
    Design(design::Args),
    Eval(eval::Args),
    Play(play::Args),
    Mcp(mcp::Args),
    Suite(suite::Args),
    SimulateCurriculum(simulate::Args),
    Replay(replay::Args),
    Critique(critique::Args),
    JudgeAgreement(agreement::Args),
    Report(report::Args),
    Db(db::Args),
    Token(token::Args),
    Config(config::Args),
    Bench(bench::Args),
    Completions(completions::Args),
    Man(man::Args),
}

impl Cli {
    /// Settles which of two flags applies, by the sources of their values.
    fn apply_precedence(&mut self, matches: &ArgMatches) {
        match (&mut self.command, matches.subcommand()) {
            (Command::Serve(args), Some((_, matches))) => args.apply_precedence(matches),
            (Command::Critique(args), Some((_, matches))) => args.apply_precedence(matches),
            (Command::Mcp(args), Some((_, matches))) => args.apply_precedence(matches),
            _ => {}
        }
    }
}

impl Command {
    /// Returns the default log level. The demo and `play` print their own progress, so they log less, and agents show the logs of
    /// `mcp`.
    const fn default_log_level(&self) -> &'static str {
        match self {
            Self::Demo(_)
            | Self::Mcp(_)
            | Self::Runs(_)
            | Self::Status(_)
            | Self::Tail(_)
            | Self::Workers(_) => "warn",
            Self::Play(_) => "error",
            _ => "info",
        }
    }

    /// Returns true if the subcommand handles Ctrl-C itself, because it has something to finish.
    const fn handles_ctrl_c(&self) -> bool {
        matches!(
            self,
            Self::Serve(_) | Self::Worker(_) | Self::Demo(_) | Self::Play(_) | Self::Mcp(_) | Self::Db(_)
        )
    }

    fn run(&self, file: &ConfigFile) -> anyhow::Result<ExitCode> {
        if !self.handles_ctrl_c() {
            interrupt::exit_on_ctrl_c()?;
        }
        match self {
            Self::Serve(args) => serve::run(args),
            Self::Worker(args) => worker::run(args),
            Self::Workers(args) => workers::run(args, own_service::start),
            Self::Demo(args) => demo::run(args),
            Self::Runs(args) => runs::run(args, own_service::start),
            Self::Status(args) => status::run(args, own_service::start),
            Self::Tail(args) => tail::run(args, own_service::start),
            Self::Design(args) => design::run(args, own_service::start),
            Self::Eval(args) => eval::run(args),
            Self::Play(args) => play::run(args),
            Self::Mcp(args) => mcp::run(args),
            Self::Suite(args) => suite::run(args),
            Self::SimulateCurriculum(args) => simulate::run(args),
            Self::Replay(args) => replay::run(args),
            Self::Critique(args) => critique::run(args),
            Self::JudgeAgreement(args) => agreement::run(args),
            Self::Report(args) => report::run(args),
            Self::Db(args) => db::run(args),
            Self::Token(args) => token::run(args),
            Self::Config(args) => config::run(args, file),
            Self::Bench(args) => bench::run(args),
            Self::Completions(args) => completions::run(args),
            Self::Man(args) => man::run(args),
        }
    }
}

/// Parses the command line, runs the subcommand and returns its exit code.
#[must_use]
pub fn main() -> ExitCode {
    let ended = config::parse(std::env::args_os().collect()).and_then(|(cli, file)| {
        let _started = cli.logs.start(cli.command.default_log_level())?;
        cli.command.run(&file)
    });
    ended.unwrap_or_else(|error| {
        let text = OutputTarget::stderr()
            .wrap(&without_os_codes(&format!("sparring: {}", error_text(&error))), "  ");
        // If stderr is closed too, only the exit code reports the error.
        let _ = writeln!(std::io::stderr().lock(), "{text}");
        ExitCode::from(ERROR_EXIT_CODE)
    })
}

/// Removes the codes that the standard library adds to errors of the operating system, as in "(os error 2)".
fn without_os_codes(text: &str) -> String {
    let mut parts = text.split(" (os error ");
    let mut plain = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        plain += part.split_once(')').map_or(part, |(_, rest)| rest);
    }
    plain
}
