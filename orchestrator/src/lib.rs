//! Sparring.
pub mod cli;
pub mod clock;
pub mod counts;
pub mod evaluation;
pub mod frames;
pub mod http;
pub mod ids;
pub mod judging;
pub mod policy;
mod reading;
pub mod service;
pub mod sessions;
pub mod store;
pub mod threads;
pub mod tokens;
pub mod training;
pub mod workers;
