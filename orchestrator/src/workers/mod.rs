//! Background jobs. Each is idempotent: what it does twice is done once.

pub mod clock;
pub mod critique;
pub mod design;
pub mod evaluate;
pub mod expire;
pub mod fold;
pub mod passes;
pub mod prepare;
pub mod retain;
pub mod rollout;
