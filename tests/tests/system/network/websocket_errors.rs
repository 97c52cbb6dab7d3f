//! Frames that violate the WebSocket protocol: the server closes with a code that says so.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;

use system_tests::{ServerProcess, raw_frame, upgrade_raw};

/// Sends bytes over a new WebSocket, and returns the close code of the server.
fn close_code(address: &str, path: &str, bytes: &[u8]) -> Option<u16> {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    upgrade_raw(&mut stream, path);
    stream.write_all(bytes).unwrap();
    loop {
        let mut head = [0; 2];
        stream.read_exact(&mut head).ok()?;
        let mut length = usize::from(head[1]);
        if length == 126 {
            let mut long = [0; 2];
            stream.read_exact(&mut long).ok()?;
            length = u16::from_be_bytes(long).into();
        }
        let mut payload = vec![0; length];
        stream.read_exact(&mut payload).ok()?;
        // Other frames, such as the state for a viewer, precede the close frame.
        if head[0] == 0x88 {
            return payload.first_chunk().map(|code| u16::from_be_bytes(*code));
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn invalid_frames_are_answered_by_a_close_code() {
    let folder = tempfile::tempdir().unwrap();
    let server = ServerProcess::start(&folder.path().join("db.sqlite3"));
    let address = server.address().to_owned();
    let invalid_utf8 = raw_frame(0x81, &[0xff, 0xfe]);
    let unmasked = vec![0x81, 2, b'h', b'i'];
    let too_large = [[0x81, 0xff].as_slice(), &(17_u64 << 20).to_be_bytes(), &[0; 4]].concat();
    let cases: [(&str, Vec<u8>, u16); 11] = [
        ("head of a text of 17 MiB", too_large, 1009),
        ("reserved bits", raw_frame(0xf1, b"x"), 1002),
        ("unknown opcode", raw_frame(0x83, b"x"), 1002),
        ("unknown control opcode", raw_frame(0x8b, b"x"), 1002),
        ("fragmented ping", raw_frame(0x09, b"x"), 1002),
        ("continuation of nothing", raw_frame(0x80, b"x"), 1002),
        ("two starts of a message", [raw_frame(0x01, b"x"), raw_frame(0x81, b"x")].concat(), 1002),
        ("no mask", unmasked, 1002),
        ("close with one byte", raw_frame(0x88, &[3]), 1002),
        ("text that is not UTF-8", invalid_utf8, 1007),
        ("normal close", raw_frame(0x88, &1000_u16.to_be_bytes()), 1000),
    ];
    for path in ["/ws", "/mcp", "/ws/ui", "/v1/sessions"] {
        for (name, bytes, expected) in cases.clone() {
            let address = address.clone();
            let code = tokio::task::spawn_blocking(move || close_code(&address, path, &bytes)).await.unwrap();
            assert_eq!(code, Some(expected), "{path}: {name}");
        }
    }
}
