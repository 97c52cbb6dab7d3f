//! Background jobs. Each is idempotent: what it does twice is done once.

pub mod critique;
pub mod expire;
pub mod prepare;
