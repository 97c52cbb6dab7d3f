//! Design language of docking: layouts as deputies by distance, direction and speeds, and their compilation into states.
//!
//! - `vocabulary` and [`design`] define what a design can say, `aim` what it can aim at.
//! - `approach` has the closed-form quantities of a start, on which aims and checks depend.
//! - [`compile`](fn@compile) builds a layout, `checks` keeps it fair.
//! - `sample` and `edit` make designs, `siblings` easier and harder ones, `formation` places deputies beside each other, `mutate` edits scenarios that have no
//!   design.
//! - `schema` describes the language to a language model, `table` and `picture` show a design to people.
//!
//! Start reading at `language`, which puts them together.

mod aim;
mod approach;
mod checks;
mod compile;
pub mod design;
mod edit;
mod formation;
mod language;
mod mutate;
mod novelty;
mod picture;
mod sample;
mod schema;
mod siblings;
mod table;
#[cfg(test)]
mod tests;
pub mod vocabulary;

pub use self::compile::compile;
pub use self::design::{DeputyStart, DockingAim, DockingDesign};
pub use self::language::DockingLanguage;
pub(crate) use self::mutate::mutate;
