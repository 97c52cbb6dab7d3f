//! Design language of kessler: layouts as encounters of satellites with debris, and their compilation into bodies.
//!
//! - `vocabulary` and [`design`] define what a design can say, `aim` what it can aim at.
//! - `placement` places the body of one encounter, [`compile`](fn@compile) builds a whole layout.
//! - `sample` and `edit` make designs, `siblings` easier and harder ones, `mutate` edits scenarios that have no design.
//! - `schema` describes the language to a language model, `table` and `picture` show a design to people.
//! - [`agents`] are scripted agents with known weaknesses, for checks and benchmarks.
//!
//! Start reading at `language`, which puts them together.

pub mod agents;
mod aim;
mod checks;
mod coast;
mod compile;
pub mod design;
mod edit;
mod language;
mod mutate;
mod novelty;
mod picture;
mod placement;
mod sample;
mod schema;
mod siblings;
mod table;
#[cfg(test)]
mod tests;
pub mod vocabulary;

pub use self::compile::{CompiledDesign, compile};
pub use self::design::{Aim, Design, Encounter};
pub use self::language::KesslerLanguage;
pub(crate) use self::mutate::mutate;
pub use self::placement::PlacedBody;
pub use self::vocabulary::EncounterKind;
