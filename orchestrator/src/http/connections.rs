//! Accepts connections, limits their number and the duration of request heads, and closes them gracefully.

use std::net::{IpAddr, SocketAddr};
use std::pin::pin;
use std::time::Duration;

use axum::Router;
use hyper::server::conn::http1::Builder;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;
use tokio::task::JoinSet;
use tower_http::add_extension::AddExtension;

use super::counted_stream::CountedStream;
use crate::limits::constants::{
    MAX_CONNECTIONS, MAX_CONNECTIONS_PER_ADDRESS, MAX_READ_AHEAD_BYTES, REQUEST_HEAD_TIMEOUT,
};
use crate::limits::{Quota, QuotaPermit};

/// Pause after the system refused to accept a connection, for example because it has no file descriptors left.
const ACCEPT_RETRY_DELAY: Duration = Duration::from_millis(500);

/// Address from which a request was sent.
#[derive(Debug, Clone, Copy)]
pub(super) struct PeerAddress(pub(super) SocketAddr);

/// Connection that was accepted, with its permit.
struct AcceptedConnection {
    stream: TcpStream,
    peer: SocketAddr,
    permit: QuotaPermit<IpAddr>,
}

/// Serves connections until `stopped` is true, and then until all running requests are answered.
pub async fn serve(listener: TcpListener, routes: Router, mut stopped: watch::Receiver<bool>) {
    let quota = Quota::new(MAX_CONNECTIONS, MAX_CONNECTIONS_PER_ADDRESS);
    // Only HTTP/1.1, as reverse proxies use it towards a backend. An HTTP/2 connection cannot be closed when it is silent,
    // nor while it negotiates the version.
    let mut builder = Builder::new();
    builder
        .timer(TokioTimer::new())
        .auto_date_header(false)
        .header_read_timeout(REQUEST_HEAD_TIMEOUT)
        .max_buf_size(MAX_READ_AHEAD_BYTES);
    // A caller that drops this future also aborts all connections.
    let mut open = JoinSet::new();
    loop {
        let accepted = tokio::select! {
            accepted = accept(&listener, &quota) => accepted,
            Some(_) = open.join_next() => continue,
            // A dropped sender also means that the service stops.
            _ = stopped.wait_for(|stop| *stop) => break,
        };
        open.spawn(serve_connection(accepted, builder.clone(), routes.clone(), stopped.clone()));
    }
    drop(listener);
    while open.join_next().await.is_some() {}
}

/// Serves one connection until it ends or the service stops.
async fn serve_connection(
    AcceptedConnection { stream, peer, permit }: AcceptedConnection,
    builder: Builder,
    routes: Router,
    mut stopped: watch::Receiver<bool>,
) {
    // Responses are written whole, so Nagle's algorithm would only delay them.
    drop(stream.set_nodelay(true));
    let service = TowerToHyperService::new(AddExtension::new(routes, PeerAddress(peer)));
    let stream = CountedStream::new(stream, permit);
    if !stream.wait_for_first_byte(REQUEST_HEAD_TIMEOUT, stopped.clone()).await {
        return;
    }
    let mut connection = pin!(builder.serve_connection(TokioIo::new(stream), service).with_upgrades());
    let result = tokio::select! {
        result = connection.as_mut() => Some(result),
        _ = stopped.wait_for(|stop| *stop) => None,
    };
    let result = match result {
        Some(result) => result,
        None => {
            connection.as_mut().graceful_shutdown(); // the running request is answered
            connection.await
        }
    };
    if let Err(error) = result {
        tracing::debug!(error = %error, peer = %peer, "A connection ended in the middle of a message.");
    }
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
