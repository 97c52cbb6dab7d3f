//! TCP stream of an accepted connection, which holds the connection's permit.

use std::io::{self, IoSlice};
use std::net::IpAddr;
use std::pin::Pin;
use std::task::{Context, Poll};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;
use tokio::sync::watch;

use crate::limits::QuotaPermit;
use crate::metrics;

/// Stream that holds a connection permit until it is dropped, also after an upgrade to a WebSocket.
#[derive(Debug)]
pub(super) struct CountedStream {
    stream: TcpStream,
    _permit: QuotaPermit<IpAddr>,
    _gauge: metrics::ConnectionGuard,
}

impl CountedStream {
    /// Wraps the stream and counts it in the metrics.
    pub(super) fn new(stream: TcpStream, permit: QuotaPermit<IpAddr>) -> Self {
        Self { stream, _permit: permit, _gauge: metrics::ConnectionGuard::new() }
    }

    /// Waits for the first byte; later timeouts are those of the HTTP library.
    ///
    /// Returns false if no byte arrives within `timeout` or before the service stops.
    pub(super) async fn wait_for_first_byte(
        &self,
        timeout: Duration,
        mut stopped: watch::Receiver<bool>,
    ) -> bool {
        let mut first = [0];
        tokio::select! {
            peeked = tokio::time::timeout(timeout, self.stream.peek(&mut first)) => matches!(peeked, Ok(Ok(1..))),
            _ = stopped.wait_for(|stop| *stop) => false,
        }
    }
}

impl AsyncRead for CountedStream {
    fn poll_read(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buf: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(cx, buf)
    }
}

impl AsyncWrite for CountedStream {
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
    use crate::limits::Quota;

    #[tokio::test]
    async fn silent_connection_times_out() {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let quota = Quota::new(2, 2);
        let (stop, stopped) = watch::channel(false);
        let connect = || async {
            let address = listener.local_addr().expect("an address");
            let client = TcpStream::connect(address).await.expect("the listener accepts");
            let (stream, peer) = listener.accept().await.expect("a connection");
            (client, CountedStream::new(stream, quota.acquire(Some(&peer.ip())).expect("a permit")))
        };
        let short = Duration::from_millis(50);
        let (mut client, stream) = connect().await;
        assert!(!stream.wait_for_first_byte(short, stopped.clone()).await);
        client.write_all(b"G").await.expect("the byte is sent");
        assert!(stream.wait_for_first_byte(Duration::from_secs(60), stopped.clone()).await);
        drop((client, stream));
        let (_silent, stream) = connect().await;
        stop.send_replace(true);
        assert!(!stream.wait_for_first_byte(Duration::from_secs(60), stopped).await, "the service stops");
    }
}
