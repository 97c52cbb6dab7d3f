//! The trainer feed: columns with their audits, and events.

mod bad;
mod columns;
mod events;
mod examples;
mod trainer;
