//! Subcommands of `sparring` that do not contain the service: one file or folder each, with `Args` and `run`. They work offline
//! or are clients of a server.
//!
//! [`llm_args`], [`names`], [`run_names`] and [`options`] have arguments that several subcommands share; [`api`] is the client of the service;
//! [`files`], [`output`], [`logs`], [`interrupt`], [`plot`] and [`worlds`] are shared helpers. The crate `cli` has the subcommands that
//! start the service or open its database.

pub mod agreement;
pub mod api;
pub mod bench;
pub mod critique;
pub mod demo;
pub mod design;
pub mod eval;
pub mod files;
#[doc(hidden)]
pub mod fuzzing;
pub mod interrupt;
pub mod llm_args;
pub mod logs;
pub mod machine;
pub mod mcp;
pub mod names;
pub mod nats_args;
pub mod options;
pub mod output;
pub mod play;
pub mod plot;
pub mod policy_args;
pub mod replay;
pub mod run_names;
pub mod runs;
mod server_url;
pub mod simulate;
pub mod status;
pub mod suite;
pub mod tail;
pub mod worker;
pub mod workers;
pub mod worlds;
