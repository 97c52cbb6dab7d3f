//! TCP stream of an accepted connection, which holds the connection's permit and ends if its client does not read.

use std::io::{self, IoSlice};
use std::net::IpAddr;
use std::pin::Pin;
use std::task::{Context, Poll, ready};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;
use tokio::sync::watch;
use tokio::time::Sleep;

use crate::limits::QuotaPermit;
use crate::limits::constants::WRITE_TIMEOUT;
use crate::metrics;

/// Stream that holds a connection permit until it is dropped, also after an upgrade to a WebSocket.
///
/// A write fails if the client reads nothing for [`WRITE_TIMEOUT`], so that a client that does not read its responses, events or
/// messages does not keep their memory.
#[derive(Debug)]
pub(super) struct CountedStream {
    stream: TcpStream,
    write_timeout: Duration,
    /// End of the time for a write that waits for the client.
    write_deadline: Option<Pin<Box<Sleep>>>,
    _permit: QuotaPermit<IpAddr>,
    _gauge: metrics::ConnectionGuard,
}

impl CountedStream {
    /// Wraps the stream and counts it in the metrics.
    pub(super) fn new(stream: TcpStream, permit: QuotaPermit<IpAddr>) -> Self {
        Self {
            stream,
            write_timeout: WRITE_TIMEOUT,
            write_deadline: None,
            _permit: permit,
            _gauge: metrics::ConnectionGuard::new(),
        }
    }

    /// Fails a write that has waited for its time, and ends the time of a write that made progress.
    fn limit_wait(
        &mut self,
        cx: &mut Context<'_>,
        written: Poll<io::Result<usize>>,
    ) -> Poll<io::Result<usize>> {
        if written.is_ready() {
            self.write_deadline = None;
            return written;
        }
        let timeout = self.write_timeout;
        let deadline = self.write_deadline.get_or_insert_with(|| Box::pin(tokio::time::sleep(timeout)));
        ready!(deadline.as_mut().poll(cx));
        Poll::Ready(Err(io::Error::new(io::ErrorKind::TimedOut, "the client does not read")))
    }

    /// Waits for the first byte; later timeouts are those of the HTTP library.
    ///
    /// Returns the byte, which is not consumed; `None` if none arrives within `timeout` or before the service stops.
    pub(super) async fn wait_for_first_byte(
        &self,
        timeout: Duration,
        mut stopped: watch::Receiver<bool>,
    ) -> Option<u8> {
        let mut first = [0];
        tokio::select! {
            peeked = tokio::time::timeout(timeout, self.stream.peek(&mut first)) => {
                matches!(peeked, Ok(Ok(1..))).then_some(first[0])
            }
            _ = stopped.wait_for(|stop| *stop) => None,
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
        let written = Pin::new(&mut self.stream).poll_write(cx, buf);
        self.limit_wait(cx, written)
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
        let written = Pin::new(&mut self.stream).poll_write_vectored(cx, bufs);
        self.limit_wait(cx, written)
    }
}

#[cfg(test)]
mod tests {
    use tokio::io::{AsyncReadExt, AsyncWriteExt};
    use tokio::net::TcpListener;

    use super::*;
    use crate::limits::Quota;

    const SHORT: Duration = Duration::from_millis(50);

    /// Connects a client, and returns it with the stream of the server.
    async fn connect() -> (TcpStream, CountedStream) {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let address = listener.local_addr().expect("an address");
        let client = TcpStream::connect(address).await.expect("the listener accepts");
        let (stream, peer) = listener.accept().await.expect("a connection");
        let permit = Quota::new(1, 1).acquire(Some(&peer.ip())).expect("a permit");
        (client, CountedStream::new(stream, permit))
    }

    #[tokio::test]
    async fn silent_connection_times_out() {
        let (stop, stopped) = watch::channel(false);
        let (mut client, stream) = connect().await;
        assert_eq!(stream.wait_for_first_byte(SHORT, stopped.clone()).await, None);
        client.write_all(b"G").await.expect("the byte is sent");
        assert_eq!(stream.wait_for_first_byte(Duration::from_secs(60), stopped.clone()).await, Some(b'G'));
        let (_silent, stream) = connect().await;
        stop.send_replace(true);
        assert_eq!(
            stream.wait_for_first_byte(Duration::from_secs(60), stopped).await,
            None,
            "the service stops"
        );
    }

    /// A client that reads slowly keeps its connection; one that reads nothing loses it.
    #[tokio::test]
    async fn write_fails_if_the_client_does_not_read() {
        let (mut client, mut stream) = connect().await;
        stream.write_timeout = Duration::from_millis(500);
        let response = vec![0; 16 << 20];
        let slow = tokio::spawn(async move {
            let mut part = vec![0; 1 << 20];
            for _ in 0..16 {
                tokio::time::sleep(SHORT).await;
                client.read_exact(&mut part).await.expect("the connection is open");
            }
            client
        });
        stream.write_all(&response).await.expect("the client reads");
        let _client = slow.await.expect("the client has read all");
        let error = stream.write_all(&response).await.expect_err("the client does not read");
        assert_eq!(error.kind(), io::ErrorKind::TimedOut);
    }
}
