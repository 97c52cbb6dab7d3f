//! `/v1/sessions`: environments on the server, stepped over one WebSocket.

#![expect(clippy::unwrap_used, reason = "a test that finds something else than it wants must fail")]

mod bounds;
mod client;
mod examples;
mod leased;
mod resume;
mod single;
mod vector;
