//! `sparring token`: creates, lists and revokes access tokens.

use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, bail, ensure};
use clap::{Subcommand, ValueEnum};
use jiff::{SignedDuration, Span};
use serde::Serialize;
use sqlx::SqliteConnection;
use store::audit_log::{self, AuditRing, AuditRow};
use store::principals;
use store::role::Role;
use store::tokens::{self, NewToken, TokenRow};
use store::{DatabaseLock, OpenError, transactions};

use super::db::{DatabaseArgs, open_readers};
use clock::{Clock, Millis, rfc3339};
use commands::output::{self, Column, JsonFlag, OutputTarget, Report, TextTable};
use orchestrator::tokens::Token;

/// Create, list and revoke the access tokens of a server.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
A token is shown once, when it is created; the database stores only its hash. Clients send it as `Authorization: Bearer \
sparring_…`. A viewer can read. A trainer can also create runs, lease scenarios, report results and open sessions. An admin can \
also change, pause, archive and resume runs, set their retention, request designs and read the audit log. As soon as a token exists, the server rejects \
requests without one, also from its own machine. A running server learns of new and revoked tokens within 5 seconds, and then \
closes the connections of revoked and expired ones.

Runs and leases belong to the principal of the token that created them. Only this principal and admins can use such a lease or change \
such a run; `sparring runs members` adds other principals to a run. To replace a token, create another one with the same principal and \
revoke the old one: the new token keeps the access.

Create the first token before the server is reachable, as the user that \
runs the server: the command creates a missing database, and that user must own it.

Examples:
  sparring token create ppo-cluster --role trainer --db training.sqlite3
  sparring token create ppo-cluster-2 --principal ppo-cluster --role trainer
  sparring token create grafana --role viewer --expires never
  sudo -u sparring sparring token create me --role admin \\
      --db /var/lib/sparring/sparring.sqlite3
  sparring token create ppo-cluster --role trainer --stdin \\
      --db west.sqlite3 < token
  sparring token list
  sparring token revoke 3")]
pub struct Args {
    #[command(flatten)]
    database: DatabaseArgs,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Create a token and print it; it cannot be shown again
    Create {
        /// Name of the token, 1 to 100 characters
        name: String,
        /// Principal that the token acts for, which owns its runs and leases [default: the name of the token]
        #[arg(long, value_name = "NAME")]
        principal: Option<String>,
        /// Role of the token, which sets its permissions
        #[arg(long, value_enum)]
        role: RoleArg,
        /// Lifetime of the token, such as `90d`, `12h` or `2 weeks`, or `never`
        #[arg(long, default_value = "90d", value_name = "TIME", value_parser = parse_lifetime, allow_hyphen_values = true)]
        expires: TokenLifetime,
        /// Store the token on standard input, which the server of another shard created, instead of a new one
        #[arg(long)]
        stdin: bool,
    },
    /// List tokens with name, principal, role, state, expiry and last use
    List(JsonFlag),
    /// Revoke a token by its number
    Revoke {
        /// Number of the token, which is also part of the token itself
        id: i64,
    },
}

/// Role on the command line.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum RoleArg {
    /// May read runs, mastery, episodes, events and metrics
    Viewer,
    /// May also create runs, lease scenarios, report results and open sessions
    Trainer,
    /// May also change and pause runs, set their retention, request designs and read the audit log
    Admin,
}

impl From<RoleArg> for Role {
    fn from(role: RoleArg) -> Self {
        match role {
            RoleArg::Viewer => Self::Viewer,
            RoleArg::Trainer => Self::Trainer,
            RoleArg::Admin => Self::Admin,
        }
    }
}

/// Lifetime of a token.
#[derive(Debug, Clone, Copy)]
pub(crate) enum TokenLifetime {
    For(SignedDuration),
    Ever,
}

pub(crate) fn parse_lifetime(text: &str) -> Result<TokenLifetime, String> {
    if text == "never" {
        return Ok(TokenLifetime::Ever);
    }
    let wanted = || format!("{text:?} is not a lifetime: use a form such as 90d, 12h or 2 weeks, or never");
    let span: Span = text.parse().map_err(|_| wanted())?;
    // A day is 24 hours, regardless of changes of the local clock.
    let time = span.to_duration(jiff::SpanRelativeTo::days_are_24_hours()).map_err(|_| wanted())?;
    if time <= SignedDuration::ZERO { Err(wanted()) } else { Ok(TokenLifetime::For(time)) }
}

/// Largest length of a token's name, in characters.
const MAX_NAME_CHARS: usize = 100;

/// Runs the subcommand.
///
/// # Errors
/// Returns an error if the database cannot be used, the name is invalid, or the token does not exist.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let now = Clock::system().now();
        let db = &args.database.db;
        match &args.command {
            Command::Create { name, principal, role, expires, stdin } => {
                check_name("token", name)?;
                let principal = principal.as_ref().unwrap_or(name);
                check_name("principal", principal)?;
                if !db.exists() {
                    tracing::info!(db = %db.display(), "The database does not exist yet; it is created.");
                }
                let known = if *stdin { Some(read_token()?) } else { None };
                let token =
                    TokenRequest { name, principal, role: Role::from(*role), expires: *expires, known };
                create(&mut open(db).await?, token, now).await
            }
            Command::List(flag) => list(&mut *open_readers(db).await?.acquire().await?, now, flag.json).await,
            Command::Revoke { id } => {
                open_readers(db).await?.close().await; // revoking must not create a missing database
                revoke(&mut open(db).await?, *id, now).await
            }
        }
    })
}

/// Opens a write connection, next to a running server if there is one. The server's database has this program's schema.
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

/// Checks the name of a token or a principal.
fn check_name(item: &str, name: &str) -> anyhow::Result<()> {
    ensure!(
        (1..=MAX_NAME_CHARS).contains(&name.chars().count()),
        "a {item}'s name must have 1 to {MAX_NAME_CHARS} characters"
    );
    ensure!(
        !name.chars().any(char::is_control),
        "a {item}'s name must not contain tabs, line ends or other control characters"
    );
    Ok(())
}

/// A token to be created.
struct TokenRequest<'a> {
    name: &'a str,
    principal: &'a str,
    role: Role,
    expires: TokenLifetime,
    /// Token of another database; none for a new one.
    known: Option<Token>,
}

/// Reads a token from standard input.
///
/// # Errors
/// Returns an error if the text is not a token.
fn read_token() -> anyhow::Result<Token> {
    let mut text = String::new();
    std::io::stdin().read_line(&mut text).context("standard input")?;
    Token::parse(text.trim()).context(
        "standard input has no token: send the line that `sparring token create` printed for another shard",
    )
}

async fn create(
    conn: &mut SqliteConnection,
    TokenRequest { name, principal, role, expires, known }: TokenRequest<'_>,
    now: Millis,
) -> anyhow::Result<ExitCode> {
    let expires_at = match expires {
        TokenLifetime::Ever => None,
        TokenLifetime::For(time) => {
            Some(now.saturating_add(i64::try_from(time.as_millis()).unwrap_or(i64::MAX)))
        }
    };
    let mut moment = transactions::begin_write(conn).await?;
    let owner = principals::get_or_insert(&mut moment, principal).await?;
    let new = NewToken { name, principal: owner, role, expires_at };
    let token = match &known {
        Some(token) => store_known(&mut moment, token, &new, now).await.map(|()| token.clone())?,
        None => {
            let token = Token::new(tokens::insert(&mut moment, &new, now).await?);
            tokens::set_hash(&mut moment, token.id, token.hash().as_bytes()).await?;
            token
        }
    };
    let id = token.id;
    audit_log::append(&mut moment, AuditRing::Changes, &command_line_audit_row("create", id, now)).await?;
    // The token is printed before the commit: once a token exists, the server rejects clients without one.
    if known.is_none() {
        output::print(token.expose())?;
    }
    moment.commit().await.context("the printed token is invalid, because it could not be stored")?;
    let until = expires_at.map_or_else(|| "without expiry".to_owned(), |at| format!("until {}", rfc3339(at)));
    tracing::info!(
        "Token {id}, {name:?}, of the principal {principal:?}, has the role {role}, {until}. It cannot be shown again; `sparring token revoke {id}` revokes it."
    );
    Ok(ExitCode::SUCCESS)
}

/// Stores a token of another database.
///
/// # Errors
/// Returns an error if the database has a token with its number.
async fn store_known(
    conn: &mut SqliteConnection,
    token: &Token,
    new: &NewToken<'_>,
    now: Millis,
) -> anyhow::Result<()> {
    let is_stored = tokens::insert_known(conn, token.id, new, token.hash().as_bytes(), now).await?;
    ensure!(
        is_stored,
        "the database has a token {} already: create tokens on one server only, and store them on the others with --stdin",
        token.id
    );
    Ok(())
}

/// Creates the audit record of a change at the command line. File permissions are the only access control there.
fn command_line_audit_row(what: &str, id: i64, at: Millis) -> AuditRow {
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

async fn list(conn: &mut SqliteConnection, now: Millis, json: bool) -> anyhow::Result<ExitCode> {
    let tokens = tokens::all(conn).await?;
    if json {
        return output::print_json(
            &tokens.iter().map(|token| TokenLine::new(token, now)).collect::<Vec<_>>(),
        )
        .map(|()| ExitCode::SUCCESS);
    }
    let is_empty = tokens.is_empty();
    let mut table = TextTable::new([
        Column::number("token"),
        Column::text("name"),
        Column::text("principal"),
        Column::text("role"),
        Column::text("state"),
        Column::text("created").optional(2),
        Column::text("expires"),
        Column::text("last used").optional(1),
    ]);
    let at = |at: Option<Millis>, never: &str| at.map_or_else(|| never.to_owned(), rfc3339);
    for token in tokens {
        let state = token.state(now).as_str().to_owned();
        table.add_row([
            token.id.to_string(),
            token.name,
            token.principal_name,
            token.role.to_string(),
            state,
            rfc3339(token.created_at),
            at(token.expires_at, "never"),
            at(token.used_at, "never"),
        ]);
    }
    let mut report = Report::default();
    if is_empty {
        report.paragraph("There are no tokens: the server accepts only clients on its own machine.");
    }
    // Programs read the header of an empty table.
    if !is_empty || OutputTarget::stdout() == OutputTarget::Piped {
        report.table(table);
    }
    output::print_report(&report)?;
    Ok(ExitCode::SUCCESS)
}

/// Token in the JSON list.
#[derive(Debug, Serialize)]
struct TokenLine<'a> {
    token: i64,
    name: &'a str,
    principal: &'a str,
    role: &'static str,
    state: &'static str,
    created_at: String,
    expires_at: Option<String>,
    used_at: Option<String>,
}

impl<'a> TokenLine<'a> {
    fn new(token: &'a TokenRow, now: Millis) -> Self {
        Self {
            token: token.id,
            name: &token.name,
            principal: &token.principal_name,
            role: token.role.as_str(),
            state: token.state(now).as_str(),
            created_at: rfc3339(token.created_at),
            expires_at: token.expires_at.map(rfc3339),
            used_at: token.used_at.map(rfc3339),
        }
    }
}

async fn revoke(conn: &mut SqliteConnection, id: i64, now: Millis) -> anyhow::Result<ExitCode> {
    let mut moment = transactions::begin_write(conn).await?;
    if !tokens::revoke(&mut moment, id, now).await? {
        let there = tokens::get(&mut moment, id).await?.is_some();
        let why = if there { "was already revoked" } else { "does not exist" };
        bail!("token {id} {why}; `sparring token list` lists all tokens");
    }
    audit_log::append(&mut moment, AuditRing::Changes, &command_line_audit_row("revoke", id, now)).await?;
    moment.commit().await?;
    output::print(&format!("Token {id} is revoked; a running server rejects it within 5 seconds."))?;
    Ok(ExitCode::SUCCESS)
}
