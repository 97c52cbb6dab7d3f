//! `sparring runs`: lists, shows, creates, changes and deletes runs, over HTTP or in a database without a server.

mod change;
pub(crate) mod create;
mod delete;
mod list;
mod members;
mod note;
mod show;
mod tag;

use std::process::ExitCode;

pub(crate) use self::list::status_name;
pub(crate) use self::show::RunDetails;
use clap::Subcommand;

use crate::api::{Connection, ServerArgs, StartService};

/// List, show, create, tag, annotate, share, pause, resume, archive or delete runs.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
RUN is the id of a run, the beginning of one id only, or the name of one run only. Where only one run is not archived, RUN can be \
left out.

Without --url the command works with the server of --db on this machine, or with the database itself if no server runs.

Examples:
  sparring runs list
  sparring runs create --name baseline --task survival --group-size 8
  sparring runs show baseline
  sparring runs tag baseline lr:3e-4 paper --remove draft
  sparring runs note baseline 'first run with the new encoder'
  sparring runs list --tag paper --sort skill
  sparring runs members baseline notebook
  sparring runs pause run-1a
  sparring runs delete run-1a --archive
  sparring runs list --url http://trainer.example.com:8700 --json")]
pub struct Args {
    #[command(flatten)]
    server: ServerArgs,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    List(list::Args),
    Show(show::Args),
    Create(create::Args),
    Tag(tag::Args),
    Note(note::Args),
    Members(members::Args),
    Pause(change::PauseArgs),
    Resume(change::ResumeArgs),
    Archive(change::ArchiveArgs),
    Delete(delete::Args),
}

/// Runs the subcommand.
///
/// # Errors
/// Returns an error if the server cannot be reached or rejects the request, or the database cannot be used.
pub fn run(args: &Args, start: StartService) -> anyhow::Result<ExitCode> {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    runtime.block_on(async {
        let connection = Connection::open(&args.server, start).await?;
        let api = &connection.api;
        let done = match &args.command {
            Command::List(args) => list::run(api, args).await,
            Command::Show(args) => show::run(api, args).await,
            Command::Create(args) => create::run(api, args).await,
            Command::Tag(args) => tag::run(api, args).await,
            Command::Note(args) => note::run(api, args).await,
            Command::Members(args) => members::run(api, args).await,
            Command::Pause(args) => change::pause(api, args).await,
            Command::Resume(args) => change::resume(api, args).await,
            Command::Archive(args) => change::archive(api, args).await,
            Command::Delete(args) => delete::run(&connection, args).await,
        };
        connection.close().await;
        done.map(|()| ExitCode::SUCCESS)
    })
}
