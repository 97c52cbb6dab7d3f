//! Designed layouts: from an agent's failures to scenarios that it trains on, and their retirement.
//!
//! [`demand`] decides when a designer is asked. [`start_design`] starts a request, [`brief`] loads the designer's brief, and
//! [`finish_design`] stores the layouts that the gate admitted. [`serve`] mixes layouts into leases, with the share that
//! [`learning_value`] gives them by the groups that [`closed_groups`] counts. [`outcome`] counts how groups on layouts ended, and
//! [`layout_status`] decides when they retire. Clients use [`request_design`] and [`retire_layout`]. [`retire_wrong`]
//! takes back layouts of a worker that was expelled. The worker that calls designers
//! is `workers::design`; the designers themselves are in the crate `designer`.

pub mod brief;
pub mod closed_groups;
pub mod demand;
pub mod designers;
pub mod finish_design;
pub mod layout_status;
pub mod learning_value;
pub mod outcome;
pub mod place;
pub mod profile;
pub mod request_design;
pub mod retire_layout;
pub mod retire_wrong;
pub mod serve;
pub mod settings;
pub mod start_design;

pub use self::designers::{BuiltInDesigners, Designers, DesignersWithModel};
pub use self::settings::{DesignSettings, designer_kind};
pub use api_types::DesignerChoice;
pub use store::design_requests::DesignerKind;
