//! The trainer feed: columns with their audits, and events.

pub(crate) mod column_trainer;
mod columns;
mod events;
mod examples;
mod invalid_columns;
