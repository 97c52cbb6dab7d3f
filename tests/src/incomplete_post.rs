//! POST requests without a complete body, on a connection of their own.

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;

use crate::ApiClient;

/// Interim response to `Expect: 100-continue`, which the server sends when it begins to read the body.
const CONTINUE: &[u8] = b"HTTP/1.1 100 Continue\r\n\r\n";

/// Connection with the head of a POST request, whose body never becomes complete.
#[derive(Debug)]
pub struct IncompletePost(TcpStream);

impl IncompletePost {
    /// Connects and sends a head that announces `length` bytes of JSON.
    ///
    /// # Panics
    /// Panics if the server does not accept the connection.
    pub async fn send_head(api: &ApiClient, path: &str, length: usize) -> Self {
        let address = api.base().trim_start_matches("http://");
        let mut stream = TcpStream::connect(address).await.expect("the server accepts the connection");
        let head = format!(
            "POST {path} HTTP/1.1\r\nhost: {address}\r\ncontent-type: application/json\r\n\
             expect: 100-continue\r\ncontent-length: {length}\r\n\r\n"
        );
        stream.write_all(head.as_bytes()).await.expect("the connection is open");
        Self(stream)
    }

    /// Waits until the server reads the body, and sends the first byte of it.
    ///
    /// # Panics
    /// Panics if the server sends a response instead.
    pub async fn send_first_byte(&mut self) {
        let mut interim = vec![0; CONTINUE.len()];
        self.0.read_exact(&mut interim).await.expect("the connection is open");
        assert_eq!(String::from_utf8_lossy(&interim), String::from_utf8_lossy(CONTINUE));
        self.0.write_all(b"{").await.expect("the connection is open");
    }

    /// Returns true if the server has neither sent a response nor closed the connection.
    #[must_use]
    pub fn is_pending(&self) -> bool {
        let received = self.0.try_read(&mut [0; 1]);
        received.is_err_and(|error| error.kind() == std::io::ErrorKind::WouldBlock)
    }

    /// Returns what the server sends until it closes the connection.
    ///
    /// # Panics
    /// Panics if the connection fails.
    pub async fn response(mut self) -> String {
        let mut bytes = Vec::new();
        self.0.read_to_end(&mut bytes).await.expect("the connection is open");
        String::from_utf8_lossy(&bytes).into_owned()
    }
}
