//! `/v1/sessions`: environments on the server that a client steps over one WebSocket.

pub(crate) mod client;
mod examples;
mod lease_sessions;
mod limits;
mod resume;
mod single;
mod vector;
