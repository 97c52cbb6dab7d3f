//! Background jobs. Each is idempotent: what it does twice is done once.

pub mod clock;
pub mod critique;
pub mod design;
pub mod evaluate;
pub mod expire;
pub mod checkpoint;
pub mod revoke_connections;
pub mod prepare;
pub mod retention;
pub mod rollout;
