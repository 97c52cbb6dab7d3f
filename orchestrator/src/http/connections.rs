//! Connections: accepted, bounded in number and in how long a request's head may take, and ended in good order.

use std::net::SocketAddr;
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

use super::places::{Held, Place, Places};

/// Connections at once, WebSockets among them; more wait to be accepted.
const MOST: usize = 16_384;
/// Of these, those of one address; more are closed.
const MOST_EACH: usize = MOST / 4 * 3;
/// How long the head of a request may take, and how long a connection may be silent between two.
const HEAD: Duration = Duration::from_secs(75);
/// Bytes that are read ahead of a connection at most.
const AHEAD: usize = 64 * 1024;
/// How long nobody is accepted where the system gives no more sockets.
const BREATH: Duration = Duration::from_millis(500);

/// Where a request came from.
#[derive(Debug, Clone, Copy)]
pub(super) struct Peer(pub(super) SocketAddr);

/// Answers until told to stop, then until what was asked is answered.
pub async fn serve(listener: TcpListener, routes: Router, mut stopped: watch::Receiver<bool>) {
    let places = Places::new(MOST, MOST_EACH);
    // HTTP/1.1 alone, as proxies speak it to what is behind them: there is no way to end a connection of HTTP/2 that is silent, and
    // none to end one that has not said yet which it is.
    let mut builder = Builder::new();
    builder.timer(TokioTimer::new()).header_read_timeout(HEAD).max_buf_size(AHEAD);
    // They go with this: whoever waits no longer for them drops it.
    let mut open = JoinSet::new();
    loop {
        let (stream, peer, place) = tokio::select! {
            accepted = accept(&listener, &places) => accepted,
            Some(_) = open.join_next() => continue,
            // The sender going away means the same.
            _ = stopped.wait_for(|stop| *stop) => break,
        };
        // What is sent is sent whole: nothing is gained by waiting for more.
        drop(stream.set_nodelay(true));
        let service = TowerToHyperService::new(AddExtension::new(routes.clone(), Peer(peer)));
        let (held, builder, mut stopped) = (Held::new(stream, place), builder.clone(), stopped.clone());
        open.spawn(async move {
            if !held.speaks(HEAD, stopped.clone()).await {
                return;
            }
            let mut connection = pin!(builder.serve_connection(TokioIo::new(held), service).with_upgrades());
            let ended = tokio::select! {
                ended = connection.as_mut() => Some(ended),
                _ = stopped.wait_for(|stop| *stop) => None,
            };
            let ended = match ended {
                Some(ended) => ended,
                None => {
                    connection.as_mut().graceful_shutdown(); // what was asked is answered
                    connection.await
                }
            };
            if let Err(error) = ended {
                tracing::debug!(error = %error, peer = %peer, "A connection ended in the middle of something.");
            }
        });
    }
    drop(listener);
    while open.join_next().await.is_some() {}
}

/// The next connection, once there is a place for it.
async fn accept(listener: &TcpListener, places: &Places) -> (TcpStream, SocketAddr, Place) {
    loop {
        let Some(of_all) = places.free().await else { std::future::pending().await };
        match listener.accept().await {
            Ok((stream, peer)) => match places.take(of_all, peer.ip()) {
                Some(place) => return (stream, peer, place),
                None => {
                    tracing::debug!(peer = %peer, "It has as many connections as it may; one more is not taken.");
                }
            },
            Err(error) if is_of_one(&error) => {}
            Err(error) => {
                tracing::error!(error = %error, "No connection can be accepted; trying again in a moment.");
                tokio::time::sleep(BREATH).await;
            }
        }
    }
}

/// Whether it was that connection alone.
fn is_of_one(error: &std::io::Error) -> bool {
    use std::io::ErrorKind::{ConnectionAborted, ConnectionRefused, ConnectionReset};
    matches!(error.kind(), ConnectionRefused | ConnectionAborted | ConnectionReset)
}
