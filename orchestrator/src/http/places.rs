//! Places for connections: each is held for as long as there is anything of its connection.

use std::collections::HashMap;
use std::io::{self, IoSlice};
use std::net::IpAddr;
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};

use crate::metrics;

/// Connections by address.
type Taken = Arc<Mutex<HashMap<IpAddr, usize>>>;

/// Places: so many in all, and of these so many for each address.
#[derive(Debug)]
pub(super) struct Places {
    all: Arc<Semaphore>,
    taken: Taken,
    each: usize,
}

/// One of them, free again when it is dropped.
#[derive(Debug)]
pub(super) struct Place {
    _of_all: OwnedSemaphorePermit,
    taken: Taken,
    address: IpAddr,
}

impl Places {
    /// All free.
    pub(super) fn new(most: usize, each: usize) -> Self {
        Self { all: Arc::new(Semaphore::new(most)), taken: Taken::default(), each }
    }

    /// Waits until one is free, for whoever comes next.
    pub(super) async fn free(&self) -> Option<OwnedSemaphorePermit> {
        Arc::clone(&self.all).acquire_owned().await.ok() // they are never closed
    }

    /// A place for this address; none where it has as many as it may.
    pub(super) fn take(&self, of_all: OwnedSemaphorePermit, address: IpAddr) -> Option<Place> {
        let mut taken = self.taken.lock().unwrap_or_else(PoisonError::into_inner);
        let count = taken.entry(address).or_default();
        if *count >= self.each {
            return None;
        }
        *count += 1;
        Some(Place { _of_all: of_all, taken: Arc::clone(&self.taken), address })
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut taken = self.taken.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(count) = taken.get_mut(&self.address) {
            *count -= 1;
            if *count == 0 {
                taken.remove(&self.address);
            }
        }
    }
}

/// A connection in its place: a WebSocket that it becomes is in it, too.
#[derive(Debug)]
pub(super) struct Held {
    stream: TcpStream,
    _place: Place,
    _connected: metrics::ConnectionGuard,
}

impl Held {
    /// Counts from here on.
    pub(super) fn new(stream: TcpStream, place: Place) -> Self {
        Self { stream, _place: place, _connected: metrics::ConnectionGuard::new() }
    }

    /// Waits for its first byte: false where none comes in this time, or before the service stops. From there on the library looks.
    pub(super) async fn speaks(&self, within: Duration, mut stopped: watch::Receiver<bool>) -> bool {
        let mut first = [0];
        tokio::select! {
            came = tokio::time::timeout(within, self.stream.peek(&mut first)) => matches!(came, Ok(Ok(1..))),
            _ = stopped.wait_for(|stop| *stop) => false,
        }
    }
}

impl AsyncRead for Held {
    fn poll_read(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buf: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(cx, buf)
    }
}

impl AsyncWrite for Held {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buf: &[u8]) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write(cx, buf)
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(cx)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        bufs: &[IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write_vectored(cx, bufs)
    }
}

#[cfg(test)]
mod tests {
    use tokio::io::AsyncWriteExt;
    use tokio::net::TcpListener;

    use super::*;

    #[tokio::test]
    async fn who_says_nothing_is_not_waited_for() {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let places = Places::new(2, 2);
        let (stop, stopped) = watch::channel(false);
        let connect = || async {
            let client =
                TcpStream::connect(listener.local_addr().expect("its address")).await.expect("it listens");
            let (stream, peer) = listener.accept().await.expect("a connection");
            let place = places.take(places.free().await.expect("one"), peer.ip()).expect("its place");
            (client, Held::new(stream, place))
        };
        let soon = Duration::from_millis(50);
        let (mut client, held) = connect().await;
        assert!(!held.speaks(soon, stopped.clone()).await);
        client.write_all(b"G").await.expect("it is taken");
        assert!(held.speaks(Duration::from_secs(60), stopped.clone()).await);
        drop(client);
        let (_silent, held) = connect().await;
        stop.send_replace(true);
        assert!(!held.speaks(Duration::from_secs(60), stopped).await, "the service stops");
    }

    #[tokio::test]
    async fn those_of_one_address_never_take_all() {
        let places = Places::new(4, 3);
        let (one, other) = (IpAddr::from([10, 0, 0, 1]), IpAddr::from([10, 0, 0, 2]));
        let mut held = Vec::new();
        for _ in 0..3 {
            held.push(places.take(places.free().await.expect("one"), one).expect("its place"));
        }
        assert!(places.take(places.free().await.expect("one"), one).is_none());
        assert!(places.take(places.free().await.expect("it was given back"), other).is_some());
        held.pop();
        assert!(places.take(places.free().await.expect("one"), one).is_some());
    }
}
