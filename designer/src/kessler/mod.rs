//! The language of kessler's layouts: encounters of satellites with debris, and what makes bodies of them.

pub mod agents;
pub mod claim;
pub mod compile;
#[cfg(test)]
mod document;
mod edit;
mod hold;
pub mod language;
mod listing;
pub mod novelty;
mod picture;
mod place;
mod sample;
mod schema;
mod sky;
mod speak;
#[cfg(test)]
mod tests;
mod vary;

pub use self::compile::{Compiled, compile};
pub use self::language::{Aim, Design, Encounter, Kind};
pub use self::speak::Kessler;
pub(crate) use self::vary::vary;
