//! The trainer feed: columns with their audits, and events.

#![expect(clippy::unwrap_used, reason = "a test that finds something else than it wants must fail")]

mod bad;
mod columns;
mod events;
mod examples;
mod trainer;
