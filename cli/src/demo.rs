//! `sparring demo`: the server of the demo. The training is in the crate `commands`.

use std::process::ExitCode;

pub use commands::demo::Args;
use commands::demo::{self, DemoServer};
use orchestrator::service::{Config, Service};
use tempfile::TempDir;

use super::serve;

/// Trains and prints a summary.
///
/// # Errors
/// Returns an error if the service cannot be started or reached, or if it refuses a result.
pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    runtime.block_on(async {
        demo::check(args)?;
        let service = DemoService::start(args).await?;
        let ended = demo::run(args, &service.server).await;
        service.stop().await;
        ended
    })
}

/// Service that the demo trains against.
struct DemoService {
    server: DemoServer,
    /// The service, if the demo started it.
    own: Option<Service>,
    /// Folder of a temporary database, which is deleted with this value.
    _temporary: Option<TempDir>,
}

impl DemoService {
    /// Starts a service, unless `--url` names one.
    async fn start(args: &Args) -> anyhow::Result<Self> {
        if let Some(url) = &args.url {
            let server = DemoServer { url: url.clone(), is_own: false, kept: None };
            return Ok(Self { server, own: None, _temporary: None });
        }
        let temporary = args.temporary.then(tempfile::tempdir).transpose()?;
        let kept = (!args.temporary).then(|| args.db.clone());
        let db = match &temporary {
            Some(folder) => folder.path().join("demo.sqlite3"),
            None => args.db.clone(),
        };
        let config = Config::local(db);
        let designers = serve::designers(&args.llm, &config.clock)?;
        let service = Service::start(Config { designers, ..config }).await?;
        let server = DemoServer { url: service.url(), is_own: true, kept };
        Ok(Self { server, own: Some(service), _temporary: temporary })
    }

    async fn stop(self) {
        if let Some(service) = self.own {
            service.stop().await;
        }
    }
}
