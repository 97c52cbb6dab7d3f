//! `--tls-cert` and `--tls-key`: the certificate of the server, which SIGHUP reads again.

use std::convert::Infallible;
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::bail;
use orchestrator::http::{ServerTls, TlsFiles};

/// Arguments of the server's certificate.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "TLS")]
pub struct TlsArgs {
    /// PEM file with the certificate of the server and its intermediate certificates; the server then accepts https only. SIGHUP
    /// reads the files again
    #[arg(long, value_name = "FILE")]
    tls_cert: Option<PathBuf>,
    /// PEM file with the private key of --tls-cert
    #[arg(long, value_name = "FILE")]
    tls_key: Option<PathBuf>,
}

impl TlsArgs {
    /// Returns the files of the certificate; `None` without TLS.
    ///
    /// # Errors
    /// Returns an error if only one of the two flags is set.
    pub(super) fn files(&self) -> anyhow::Result<Option<TlsFiles>> {
        match (&self.tls_cert, &self.tls_key) {
            (Some(certificates), Some(key)) => {
                Ok(Some(TlsFiles { certificates: certificates.clone(), key: key.clone() }))
            }
            (None, None) => Ok(None),
            (Some(_), None) => bail!("--tls-cert needs a private key; set --tls-key"),
            (None, Some(_)) => bail!("--tls-key needs a certificate; set --tls-cert"),
        }
    }
}

/// SIGHUP, which reads the certificate again. Without TLS the signal keeps its default effect.
pub(super) struct ReloadSignal {
    tls: Option<Arc<ServerTls>>,
    #[cfg(unix)]
    hangup: Option<tokio::signal::unix::Signal>,
}

impl ReloadSignal {
    /// Installs the handler if the server has a certificate.
    ///
    /// # Errors
    /// Returns an error if the handler cannot be installed.
    pub(super) fn install(tls: Option<Arc<ServerTls>>) -> std::io::Result<Self> {
        #[cfg(unix)]
        let hangup = match tls {
            Some(_) => Some(tokio::signal::unix::signal(tokio::signal::unix::SignalKind::hangup())?),
            None => None,
        };
        Ok(Self {
            tls,
            #[cfg(unix)]
            hangup,
        })
    }

    /// Reads the certificate at every signal, for ever. An invalid certificate is logged, and the server keeps the old one.
    pub(super) async fn reload_forever(&mut self) -> Infallible {
        loop {
            self.received().await;
            match self.tls.as_ref().map(|tls| tls.reload()) {
                Some(Ok(())) => tracing::info!("The server read its certificate again."),
                Some(Err(error)) => {
                    tracing::error!(%error, "The new certificate is not used; the server keeps the old one.");
                }
                None => {}
            }
        }
    }

    async fn received(&mut self) {
        #[cfg(unix)]
        if let Some(hangup) = &mut self.hangup
            && hangup.recv().await.is_some()
        {
            return;
        }
        std::future::pending::<()>().await;
    }
}
