//! One tick of Basilisk's closed loop, for several satellites side by side.
//!
//! The order is part of the contract: world (access of the target), dynamics, power and storage, flight software. A torque
//! command from the state at t acts over [t + 1, t + 2] ticks. Only + − × ÷ √ and selects are used, so every lane has the same
//! bits at every SIMD width. Start reading at [`kernel`].

pub mod arctangent;
pub mod attitude;
pub mod block;
pub mod control;
pub mod dispatch;
pub mod guidance;
pub mod kernel;
pub mod parts;
pub mod state;
