//! Service that this process starts for a database without a server.

use std::path::PathBuf;

use commands::api::OwnService;
use futures_util::FutureExt;
use futures_util::future::LocalBoxFuture;
use orchestrator::service::{Config, Service};

/// Starts a service for a database of this program's schema.
///
/// # Errors
/// Returns an error if the database has another schema, or cannot be used.
pub(crate) fn start(db: PathBuf) -> LocalBoxFuture<'static, anyhow::Result<OwnService>> {
    async move {
        // Reading an older database must not upgrade it.
        super::db::open_readers(&db).await?.close().await;
        let config = Config::for_this_process(db);
        let token = config.process_token.as_ref().map(|token| token.expose().into());
        let service = Service::start(config).await?;
        Ok(OwnService { url: service.url(), token, stop: service.stop().boxed_local() })
    }
    .boxed_local()
}
