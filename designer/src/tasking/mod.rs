//! Design language of tasking: starts of episodes and target fields, and their compilation into layouts.
//!
//! - `vocabulary` and [`design`] define what a design can say, `aim` what it can aim at.
//! - `field` places the targets of a field, [`compile`](fn@compile) builds a whole layout, and `facts` computes what the aim is checked
//!   against: shadow, passes and windows.
//! - `sample` and `edit` make designs, `siblings` easier and harder ones, `mutate` edits scenarios that have no design.
//! - `schema` describes the language to a language model, `table` and `picture` show a design to people.
//!
//! Start reading at `language`, which puts them together.

mod aim;
mod build;
mod compile;
pub mod design;
mod edit;
mod facts;
mod field;
mod language;
mod mutate;
mod novelty;
mod orbit_facts;
mod params;
mod picture;
mod sample;
mod sample_parts;
mod schema;
mod siblings;
mod table;
#[cfg(test)]
mod tests;
mod units;
pub mod vocabulary;

pub use self::compile::{CompiledStart, compile};
pub use self::design::{DesignedStart, TargetField, TaskingDesign};
pub use self::language::TaskingLanguage;
pub(crate) use self::mutate::mutate;
