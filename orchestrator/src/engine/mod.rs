//! The engine that changes runs: one [`writer`] applies every [`change::Change`] in a write transaction ([`write_tx`]) and answers
//! after the commit.
//!
//! Use cases live in `leases/`, `results/`, `designs/`, `rollouts/`, `evaluation/`, `retention/` and `runs/`; SQL lives in `store/`.
//! Start reading at [`change`], then [`writer`].

pub mod access_log;
pub mod change;
pub mod commit_log;
pub mod error;
pub mod event;
pub mod outbox;
pub mod run_cache;
pub mod run_state;
pub mod run_tx;
pub mod shift_deadlines;
pub mod signals;
pub mod storage_health;
pub mod task_history;
pub mod write_probe;
pub mod write_tx;
pub mod writer;
