//! Accepts connections, limits their number and the duration of request heads, and closes them gracefully.

use std::net::{IpAddr, SocketAddr};
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use hyper::server::conn::http1::Builder;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;
use tokio::task::JoinSet;
use tower_http::add_extension::AddExtension;

use super::counted_stream::CountedStream;
use super::tls::{ServerTls, TlsHandshakes};
use crate::limits::constants::{
    HANDSHAKE_TIMEOUT, MAX_CONNECTIONS, MAX_CONNECTIONS_PER_ADDRESS, MAX_READ_AHEAD_BYTES,
    REQUEST_HEAD_TIMEOUT,
};
use crate::limits::{Quota, QuotaPermit};

/// Pause after the system refused to accept a connection, for example because it has no file descriptors left.
const ACCEPT_RETRY_DELAY: Duration = Duration::from_millis(500);

/// First byte of a TLS connection: a record of the type handshake.
const TLS_HANDSHAKE: u8 = 22;
/// Time in which a client that does not use TLS must close its connection.
const REJECTION_TIMEOUT: Duration = Duration::from_secs(1);
/// Response to a client that does not use TLS on a server with TLS.
const HTTPS_REQUIRED: &[u8] =
    b"HTTP/1.1 400 Bad Request\r\ncontent-type: text/plain\r\ncontent-length: 56\r\n\
    connection: close\r\n\r\nThis server uses TLS; send the request to an https URL.\n";

/// Address from which a request was sent.
#[derive(Debug, Clone, Copy)]
pub(super) struct PeerAddress(pub(super) SocketAddr);

/// Connection that was accepted, with its permit.
struct AcceptedConnection {
    stream: TcpStream,
    peer: SocketAddr,
    permit: QuotaPermit<IpAddr>,
}

/// Serves connections until `stopped` is true, and then until all running requests are answered. With `tls` all connections are
/// encrypted.
pub async fn serve(
    listener: TcpListener,
    routes: Router,
    tls: Option<Arc<ServerTls>>,
    mut stopped: watch::Receiver<bool>,
) {
    let quota = Quota::new(MAX_CONNECTIONS, MAX_CONNECTIONS_PER_ADDRESS);
    let server = ConnectionServer {
        builder: http1_builder(),
        routes,
        handshakes: tls.map(|tls| Arc::new(TlsHandshakes::new(tls))),
        stopped: stopped.clone(),
    };
    // A caller that drops this future also aborts all connections.
    let mut open = JoinSet::new();
    loop {
        let accepted = tokio::select! {
            accepted = accept(&listener, &quota) => accepted,
            Some(_) = open.join_next() => continue,
            // A dropped sender also means that the service stops.
            _ = stopped.wait_for(|stop| *stop) => break,
        };
        open.spawn(server.clone().serve_connection(accepted));
    }
    drop(listener);
    while open.join_next().await.is_some() {}
}

/// Returns the settings of HTTP/1.1, as reverse proxies use it towards a backend. An HTTP/2 connection cannot be closed when it is
/// silent, nor while it negotiates the version.
fn http1_builder() -> Builder {
    let mut builder = Builder::new();
    builder
        .timer(TokioTimer::new())
        .auto_date_header(false)
        .header_read_timeout(REQUEST_HEAD_TIMEOUT)
        .max_buf_size(MAX_READ_AHEAD_BYTES);
    builder
}

/// Parts that all connections of a server share.
#[derive(Clone)]
struct ConnectionServer {
    builder: Builder,
    routes: Router,
    handshakes: Option<Arc<TlsHandshakes>>,
    stopped: watch::Receiver<bool>,
}

impl ConnectionServer {
    /// Serves one connection until it ends or the service stops.
    async fn serve_connection(mut self, AcceptedConnection { stream, peer, permit }: AcceptedConnection) {
        // Responses are written whole, so Nagle's algorithm would only delay them.
        drop(stream.set_nodelay(true));
        let stream = CountedStream::new(stream, permit);
        let timeout = if self.handshakes.is_some() { HANDSHAKE_TIMEOUT } else { REQUEST_HEAD_TIMEOUT };
        let first = stream.wait_for_first_byte(timeout, self.stopped.clone()).await;
        let served = match (first, self.handshakes.clone()) {
            (None, _) => return,
            (Some(_), None) => self.serve_http(stream, peer).await,
            (Some(TLS_HANDSHAKE), Some(handshakes)) => {
                let opened = tokio::select! {
                    opened = handshakes.complete(stream, peer.ip()) => opened,
                    _ = self.stopped.wait_for(|stop| *stop) => return,
                };
                match opened {
                    Ok(stream) => self.serve_http(stream, peer).await,
                    Err(error) => Err(error),
                }
            }
            (Some(_), Some(_)) => reject_plain_http(stream).await.map_err(Into::into),
        };
        if let Err(error) = served {
            tracing::debug!(error = %error, peer = %peer, "A connection ended in the middle of a message.");
        }
    }

    /// Serves the requests of a connection.
    async fn serve_http<S>(mut self, stream: S, peer: SocketAddr) -> anyhow::Result<()>
    where
        S: AsyncRead + AsyncWrite + Unpin + Send + 'static,
    {
        let service = TowerToHyperService::new(AddExtension::new(self.routes, PeerAddress(peer)));
        let mut connection =
            pin!(self.builder.serve_connection(TokioIo::new(stream), service).with_upgrades());
        tokio::select! {
            result = connection.as_mut() => return Ok(result?),
            _ = self.stopped.wait_for(|stop| *stop) => {}
        }
        connection.as_mut().graceful_shutdown(); // the running request is answered
        Ok(connection.await?)
    }
}

/// Answers a client that does not use TLS on a server with TLS.
async fn reject_plain_http(mut stream: CountedStream) -> std::io::Result<()> {
    stream.write_all(HTTPS_REQUIRED).await?;
    stream.shutdown().await?;
    // Unread bytes of the request would reset the connection before the client has read the response.
    let mut unread = [0; 1024];
    let drain = async { while stream.read(&mut unread).await.is_ok_and(|length| length > 0) {} };
    drop(tokio::time::timeout(REJECTION_TIMEOUT, drain).await);
    Ok(())
}

/// Waits for a permit and accepts the next connection. Connections beyond the limit of their address are closed.
async fn accept(listener: &TcpListener, quota: &Quota<IpAddr>) -> AcceptedConnection {
    loop {
        let total = quota.wait_for_total().await;
        match listener.accept().await {
            Ok((stream, peer)) => match quota.assign(total, &peer.ip()) {
                Ok(permit) => return AcceptedConnection { stream, peer, permit },
                Err(_) => {
                    tracing::debug!(peer = %peer, "A connection was closed: its address has too many connections.");
                }
            },
            Err(error) if concerns_one_connection(&error) => {}
            Err(error) => {
                tracing::error!(error = %error, "Connections cannot be accepted; the server retries.");
                tokio::time::sleep(ACCEPT_RETRY_DELAY).await;
            }
        }
    }
}

/// Returns true if the error concerns only the connection that was accepted.
fn concerns_one_connection(error: &std::io::Error) -> bool {
    use std::io::ErrorKind::{ConnectionAborted, ConnectionRefused, ConnectionReset};
    matches!(error.kind(), ConnectionRefused | ConnectionAborted | ConnectionReset)
}
