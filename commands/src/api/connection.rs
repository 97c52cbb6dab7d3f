//! `--url` and `--db`: the server or the database that a subcommand means.

use std::path::PathBuf;

use anyhow::{Context, bail};
use futures_util::future::LocalBoxFuture;
use secrecy::SecretString;
use store::{DatabaseLock, OpenError};

use super::{ApiClient, CaArgs};

/// Starts a service in this process for a database that no server uses. The binary passes it on, because this crate does not
/// contain the service.
pub type StartService = fn(PathBuf) -> LocalBoxFuture<'static, anyhow::Result<StartedService>>;

/// Service that this process started.
pub struct StartedService {
    /// URL of the service.
    pub url: String,
    /// Token that admits requests of this process.
    pub token: Option<SecretString>,
    /// Handle that stops the service.
    pub service: Box<dyn OwnService>,
}

/// Methods of a service of this process that no request calls.
pub trait OwnService {
    /// Deletes the data of deleted runs.
    fn finish_deletions(&self) -> LocalBoxFuture<'_, anyhow::Result<()>>;
    /// Stops the service and closes its database.
    fn stop(self: Box<Self>) -> LocalBoxFuture<'static, ()>;
}

/// Arguments that name a server or a database.
#[derive(Debug, Clone, clap::Args)]
pub struct ServerArgs {
    /// URL of the server, such as http://127.0.0.1:8700 [default: the server of --db; SPARRING_TOKEN has the token]
    #[arg(long, global = true, value_name = "URL", env = "SPARRING_URL", help_heading = "Server")]
    url: Option<String>,
    #[command(flatten)]
    ca: CaArgs,
    /// Path of the database; the command works with its server, or with the file if no server runs
    #[arg(
        long,
        global = true,
        default_value = "sparring.sqlite3",
        value_name = "PATH",
        env = "SPARRING_DB",
        help_heading = "Server"
    )]
    db: PathBuf,
}

/// Client of a server, or of a service that this process started for a database without a server.
pub struct Connection {
    /// Client of the server or the service.
    pub api: ApiClient,
    own: Option<Box<dyn OwnService>>,
}

impl Connection {
    /// Connects to the server that the arguments name, or starts a service for a database without a server.
    ///
    /// # Errors
    /// Returns an error if the URL is invalid, or the database does not exist, cannot be used, or is locked by a program
    /// without a URL.
    pub async fn open(args: &ServerArgs, start: StartService) -> anyhow::Result<Self> {
        if let Some(url) = &args.url {
            return Ok(Self { api: ApiClient::new(url, &args.ca)?, own: None });
        }
        if !args.db.exists() {
            bail!(
                "there is no database {}: start a server with `sparring serve`, or set --url or --db",
                args.db.display()
            );
        }
        match DatabaseLock::acquire(&args.db) {
            Ok(lock) => drop(lock),
            Err(OpenError::Locked(_)) => return Self::to_server_of(args),
            Err(error) => return Err(error.into()),
        }
        let StartedService { url, token, service } = start(args.db.clone()).await?;
        Ok(Self { api: ApiClient::with_token(&url, &args.ca, token)?, own: Some(service) })
    }

    /// Connects to the server that holds the lock of a database.
    fn to_server_of(args: &ServerArgs) -> anyhow::Result<Self> {
        let db = &args.db;
        let url = DatabaseLock::published_url(db).with_context(|| {
            format!(
                "{} is in use by a program without a URL; set --url to the address of its server",
                db.display()
            )
        })?;
        Ok(Self { api: ApiClient::new(&reachable(&url), &args.ca)?, own: None })
    }

    /// Returns true if a server responds, and false for a service of this process.
    pub const fn is_server(&self) -> bool {
        self.own.is_none()
    }

    /// Deletes the data of deleted runs, if no server does.
    ///
    /// # Errors
    /// Returns an error if the database cannot be written.
    pub(crate) async fn finish_deletions(&self) -> anyhow::Result<()> {
        if let Some(service) = &self.own {
            service.finish_deletions().await?;
        }
        Ok(())
    }

    /// Stops the service of this process, if there is one.
    pub async fn close(self) {
        if let Some(service) = self.own {
            service.stop().await;
        }
    }
}

/// Replaces the address of a server that listens on all addresses by that of this machine.
fn reachable(url: &str) -> String {
    url.replace("//0.0.0.0:", "//127.0.0.1:").replace("//[::]:", "//[::1]:")
}
