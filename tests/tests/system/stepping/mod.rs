//! `/v1/sessions`: environments on the server, stepped over one WebSocket.

mod bounds;
mod client;
mod examples;
mod leased;
mod resume;
mod single;
mod vector;
