//! Scenario design: designers behind one trait, and the gate that every layout passes before an agent sees it.
//!
//! A [`Designer`] receives a [`DesignBrief`] (the agent's failures and the limits of the task) and the [`Gate`]. It returns
//! the layouts that it made, with the gate's verdict on each.
//!
//! - [`procedural`] samples layouts from the failure profile and edits successful ones, [`llm_designer`] asks a language
//!   model, [`replay`] reads layouts from a file.
//! - [`DesignLanguage`] is the interface of a world whose layouts can be designed; [`docking`], [`kessler`] and [`tasking`]
//!   implement it.
//! - [`design_thread`] runs a designer beside other work, and [`reported`] checks layouts that another process made.
//! - [`mutate`] edits scenarios for a curriculum, without a designer.
//! - `registry` maps tasks to worlds, and is the only file that names all worlds.
//!
//! Storing layouts and scheduling designers is the server's work. Start reading at `designer` and [`gate`].

mod angles;
mod bound;
pub mod brief;
mod design_fields;
mod design_language;
pub mod design_thread;
mod designer;
mod distance_parts;
pub mod docking;
mod edit_direction;
mod field_error;
#[doc(hidden)]
pub mod fuzzing;
pub mod gate;
pub mod kessler;
mod label_placer;
pub mod llm_designer;
mod mutation;
mod picture_parts;
pub mod procedural;
pub mod profile;
mod profile_sampling;
mod refusal;
mod registry;
pub mod replay;
pub mod reported;
mod schema_forms;
pub mod svg;
pub mod tasking;
#[cfg(test)]
mod test_support;
mod untrusted_text;
mod world_language;

pub use self::bound::Bound;
pub use self::brief::DesignBrief;
pub use self::design_language::{DesignLanguage, DesignTable, LayoutKind, LayoutView, PromptTexts};
pub use self::designer::{DesignError, DesignFuture, DesignOutcome, DesignUsage, Designer, JudgedLayout};
pub use self::edit_direction::EditDirection;
pub use self::field_error::FieldError;
pub use self::gate::{AdmittedLayout, Gate};
pub use self::mutation::Mutation;
pub use self::profile::FailureProfile;
pub use self::refusal::{GateCheck, MIN_NOVELTY, Refusal, RefusalWords};
pub use self::registry::{design_language, draw_layout, mutate};
