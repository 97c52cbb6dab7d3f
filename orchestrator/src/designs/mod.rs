//! The designer's life: from what an agent fails at to layouts that it is given, and to their end.
//!
//! [`stock`] decides when to ask, [`ask`] begins and ends a round of asking, [`brief`] gathers what a designer is told,
//! [`serve`] mixes layouts into leases, [`outcome`] takes how they were flown, [`life`] decides when they retire.

pub mod design_request;
pub mod brief;
pub mod designers;
pub mod manual;
pub mod layout_life;
pub mod outcome;
pub mod profile;
pub mod serve;
pub mod settings;
pub mod demand;

pub use crate::store::design_requests::DesignerKind;
pub use designers::{BuiltInDesigners, Designers, DesignersWithModel};
pub use settings::{DesignSettings, DesignSettingsRequest, DesignerChoice};
