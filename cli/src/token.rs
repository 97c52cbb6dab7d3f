//! `sparring token`: who may come in.

use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, bail, ensure};
use clap::Subcommand;
use jiff::{SignedDuration, Span};
use sqlx::SqliteConnection;

use super::db::{Database, readers};
use super::output;
use orchestrator::clock::{Clock, Millis, rfc3339};
use orchestrator::store::audit_log::{self, AuditRing, AuditRow};
use orchestrator::store::tokens::{self, NewToken};
use orchestrator::store::{self, DatabaseLock, OpenError};
use orchestrator::tokens::{Role, Token};

/// Make, list and revoke the tokens that a server lets in.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
A token is shown once, when it is made; of it only a hash is kept. Whoever comes sends it: `Authorization: Bearer sparring_…`. A \
viewer reads; a trainer also creates runs, leases, reports and flies; an admin also pauses runs, sets what they keep, asks \
designers and reads the audit log. As soon as there is a token a server lets nobody in without one, on this machine neither. A \
running server knows of new and revoked tokens within 5 seconds, and then closes what a revoked or expired one has open. \
Make the first one before the server is reachable, as the user it runs as: the database is made where there is none, and must be theirs.

Examples:
  sparring token create ppo-cluster --role trainer --db training.sqlite3
  sparring token create grafana --role viewer --expires never
  sudo -u sparring sparring token create me --role admin --db /var/lib/sparring/sparring.sqlite3
  sparring token list
  sparring token revoke 3")]
pub struct Args {
    #[command(flatten)]
    of: Database,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Make a token: it is printed, and kept nowhere
    Create {
        /// A name for people
        name: String,
        /// What it may do
        #[arg(long, value_enum)]
        role: Role,
        /// How long it is good for, as `90d`, `12h` or `2 weeks`; or `never`
        #[arg(long, default_value = "90d", value_name = "TIME", value_parser = lasting, allow_hyphen_values = true)]
        expires: Lasting,
    },
    /// List tokens: names, roles, until when, and when each was used last
    List,
    /// Revoke a token, by its number
    Revoke {
        /// Its number: it stands in the token, too
        id: i64,
    },
}

/// How long something is good for.
#[derive(Debug, Clone, Copy)]
enum Lasting {
    For(SignedDuration),
    Ever,
}

fn lasting(text: &str) -> Result<Lasting, String> {
    if text == "never" {
        return Ok(Lasting::Ever);
    }
    let wanted = || format!("{text:?} is no time: say it as 90d, 12h or 2 weeks, or never");
    let span: Span = text.parse().map_err(|_| wanted())?;
    // Days are of 24 hours, whatever clocks do meanwhile.
    let time = span.to_duration(jiff::SpanRelativeTo::days_are_24_hours()).map_err(|_| wanted())?;
    if time <= SignedDuration::ZERO { Err(wanted()) } else { Ok(Lasting::For(time)) }
}

/// Longest name of a token, in characters.
const MAX_NAME: usize = 100;

/// Does it.
///
/// # Errors
/// A database that cannot be used, a token that is not there.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let now = Clock::system().now();
        let db = &args.of.db;
        match &args.command {
            Command::Create { name, role, expires } => {
                fits(name)?;
                if !db.exists() {
                    tracing::info!(db = %db.display(), "There is no such database yet: it is made.");
                }
                create(&mut open(db).await?, (name, *role), now, *expires).await
            }
            Command::List => list(&mut *readers(db).await?.acquire().await?, now).await,
            Command::Revoke { id } => {
                readers(db).await?.close().await; // what is not there is not made to revoke a token of it
                revoke(&mut open(db).await?, *id, now).await
            }
        }
    })
}

/// A connection that writes, beside a running server if there is one: its database has this program's schema, or it would not
/// run.
async fn open(db: &Path) -> Result<SqliteConnection, OpenError> {
    match DatabaseLock::acquire(db) {
        Ok(_lock) => store::open_writer(db).await,
        Err(OpenError::Locked(_)) => {
            store::open_current_readers(db).await?.close().await;
            store::open_maintenance(db).await
        }
        Err(error) => Err(error),
    }
}

fn fits(name: &str) -> anyhow::Result<()> {
    ensure!((1..=MAX_NAME).contains(&name.chars().count()), "a token's name has 1 to {MAX_NAME} characters");
    ensure!(!name.chars().any(char::is_control), "a token's name is of one line: no tabs, no line ends");
    Ok(())
}

async fn create(
    conn: &mut SqliteConnection,
    (name, role): (&str, Role),
    now: Millis,
    expires: Lasting,
) -> anyhow::Result<ExitCode> {
    let expires_at = match expires {
        Lasting::Ever => None,
        Lasting::For(time) => Some(now.saturating_add(i64::try_from(time.as_millis()).unwrap_or(i64::MAX))),
    };
    let mut moment = sqlx::Connection::begin_with(conn, "BEGIN IMMEDIATE").await?;
    let id = tokens::insert(&mut moment, &NewToken { name, role, expires_at }, now).await?;
    let token = Token::new(id);
    tokens::set_hash(&mut moment, id, token.hash().as_bytes()).await?;
    audit_log::append(&mut moment, AuditRing::Changes, &by_hand("create", id, now)).await?;
    // One that nobody was shown would keep everybody out: as soon as there is one nobody is let in without.
    output::print(token.expose())?;
    moment.commit().await.context("the token that was shown is none: it could not be written down")?;
    let until = expires_at.map_or_else(|| "for ever".to_owned(), |at| format!("until {}", rfc3339(at)));
    tracing::info!(
        "Token {id}, {name:?}, has the role {role}, {until}. It is shown this once; revoke it by `sparring token revoke {id}`."
    );
    Ok(ExitCode::SUCCESS)
}

/// The audit log's line of what is done to a token at the command line: whoever may write the file may.
fn by_hand(what: &str, id: i64, at: Millis) -> AuditRow {
    AuditRow {
        id: 0,
        at,
        token: None,
        name: None,
        address: None,
        operation: format!("sparring token {what}"),
        path: format!("token {id}"),
        status: 200,
        request_id: String::new(),
    }
}

async fn list(conn: &mut SqliteConnection, now: Millis) -> anyhow::Result<ExitCode> {
    let tokens = tokens::all(conn).await?;
    if tokens.is_empty() {
        output::print("There are no tokens: the server lets in whoever is on its machine, and nobody else.")?;
        return Ok(ExitCode::SUCCESS);
    }
    let mut table = output::table(&["token", "name", "role", "state", "made", "expires", "last used"], 7);
    let at = |at: Option<Millis>, never: &str| at.map_or_else(|| never.to_owned(), rfc3339);
    for token in tokens {
        let state = token.state(now).as_str().to_owned();
        table.add_row([
            token.id.to_string(),
            token.name,
            token.role.to_string(),
            state,
            rfc3339(token.created_at),
            at(token.expires_at, "never"),
            at(token.used_at, "never"),
        ]);
    }
    output::print(&table.to_string())?;
    Ok(ExitCode::SUCCESS)
}

async fn revoke(conn: &mut SqliteConnection, id: i64, now: Millis) -> anyhow::Result<ExitCode> {
    let mut moment = sqlx::Connection::begin_with(conn, "BEGIN IMMEDIATE").await?;
    if !tokens::revoke(&mut moment, id, now).await? {
        let there = tokens::get(&mut moment, id).await?.is_some();
        let why = if there { "was revoked before" } else { "is not there" };
        bail!("token {id} {why}; `sparring token list` shows them");
    }
    audit_log::append(&mut moment, AuditRing::Changes, &by_hand("revoke", id, now)).await?;
    moment.commit().await?;
    output::print(&format!("Token {id} is revoked; a running server lets it in for 5 seconds at most."))?;
    Ok(ExitCode::SUCCESS)
}
