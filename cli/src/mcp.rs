//! `sparring mcp`: the server of the episode. The protocol is in the crate `commands`.

use std::process::ExitCode;

use commands::api::ApiClient;
pub(crate) use commands::mcp::Args;
use orchestrator::service::{Config, Service};

/// Serves the tools of an episode on stdin and stdout.
///
/// # Errors
/// Returns an error if `--run` is given without `--url`, if the server cannot be started or reached, or if it rejects the episode.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    args.check()?;
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    runtime.block_on(async {
        match &args.url {
            Some(url) => commands::mcp::serve(args, &ApiClient::new(url, &args.ca)?).await,
            None => serve_here(args).await,
        }
    })?;
    Ok(ExitCode::SUCCESS)
}

/// Starts a server with a temporary database for the episode.
async fn serve_here(args: &Args) -> anyhow::Result<()> {
    let folder = tempfile::tempdir()?;
    let service = Service::start(Config::local(folder.path().join("mcp.sqlite3"))).await?;
    let served = match ApiClient::new(&service.url(), &args.ca) {
        Ok(api) => commands::mcp::serve(args, &api).await,
        Err(error) => Err(error),
    };
    service.stop().await;
    served
}
