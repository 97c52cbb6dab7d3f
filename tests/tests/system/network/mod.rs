//! Clients that misbehave on the wire: floods, frames and requests that violate a protocol, and large or slow bodies.

#[cfg(target_os = "linux")]
mod pings;
mod websocket_errors;
