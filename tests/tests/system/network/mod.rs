//! Clients that misbehave on the wire: floods, frames and requests that violate a protocol, and large or slow bodies.

mod bodies;
#[cfg(target_os = "linux")]
mod large_bodies;
#[cfg(target_os = "linux")]
mod pings;
#[cfg(unix)]
mod proxy;
mod request_heads;
#[cfg(unix)]
mod tls;
mod websocket_errors;

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;

/// Sends bytes on a new connection, and returns what the server sends until it closes the connection.
fn exchange(address: &str, request: &str) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    stream.write_all(request.as_bytes()).unwrap();
    let mut response = Vec::new();
    stream.read_to_end(&mut response).unwrap();
    String::from_utf8_lossy(&response).into_owned()
}
