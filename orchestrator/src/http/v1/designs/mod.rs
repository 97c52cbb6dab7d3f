//! Designs of a run: what designers thought of, what the gate said, how the agent fared; and asking for more.

pub(super) mod ask;
pub(super) mod asks;
pub(super) mod list;
pub(super) mod show;
pub(super) mod summary;
pub(super) mod turn;
pub(super) mod view;
