//! Service that this process starts for a database without a server.

use std::path::PathBuf;

use commands::api::{OwnService, StartedService};
use futures_util::FutureExt;
use futures_util::future::LocalBoxFuture;
use orchestrator::service::{Config, Service};

/// Service of this process, for the crate `commands`.
struct LocalService(Service);

impl OwnService for LocalService {
    fn finish_deletions(&self) -> LocalBoxFuture<'_, anyhow::Result<()>> {
        async { Ok(self.0.finish_deletions().await?) }.boxed_local()
    }

    fn stop(self: Box<Self>) -> LocalBoxFuture<'static, ()> {
        self.0.stop().boxed_local()
    }
}

/// Starts a service for a database of this program's schema.
///
/// # Errors
/// Returns an error if the database has another schema, or cannot be used.
pub(crate) fn start(db: PathBuf) -> LocalBoxFuture<'static, anyhow::Result<StartedService>> {
    async move {
        // Reading an older database must not upgrade it.
        super::db::open_readers(&db).await?.close().await;
        let config = Config::for_this_process(db);
        let token = config.process_token.as_ref().map(|token| token.expose().into());
        let service = Service::start(config).await?;
        Ok(StartedService { url: service.url(), token, service: Box::new(LocalService(service)) })
    }
    .boxed_local()
}
