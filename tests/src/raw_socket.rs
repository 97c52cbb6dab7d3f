//! WebSockets whose bytes a test writes itself, for frames that no WebSocket library sends.

use std::io::{Read, Write};
use std::net::TcpStream;

/// Start of the response that accepts a WebSocket.
const SWITCHING: &[u8] = b"HTTP/1.1 101";

/// Upgrades a connection to a WebSocket at `path`, and reads the response to its end.
///
/// # Panics
/// Panics if the server rejects the upgrade.
pub fn upgrade_raw(stream: &mut TcpStream, path: &str) {
    let request = format!(
        "GET {path} HTTP/1.1\r\nhost: localhost\r\nconnection: upgrade\r\nupgrade: websocket\r\n\
         sec-websocket-version: 13\r\nsec-websocket-key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
    );
    stream.write_all(request.as_bytes()).expect("the connection is open");
    let (mut head, mut byte) = (Vec::new(), [0]);
    while !head.ends_with(b"\r\n\r\n") {
        stream.read_exact(&mut byte).expect("the server responds");
        head.push(byte[0]);
    }
    assert!(head.starts_with(SWITCHING), "{}", String::from_utf8_lossy(&head));
}

/// Returns the bytes of a masked frame of at most 125 bytes. `first` has the flags and the opcode.
///
/// # Panics
/// Panics if the payload is longer than 125 bytes.
#[must_use]
pub fn raw_frame(first: u8, payload: &[u8]) -> Vec<u8> {
    assert!(payload.len() <= 125, "a longer payload has a longer header");
    // A mask of zeros leaves the payload as it is.
    [&[first, 0x80 | payload.len() as u8, 0, 0, 0, 0], payload].concat()
}
