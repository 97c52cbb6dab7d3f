//! Statistical evidence behind level moves.
//!
//! [`block`] gathers contested outcomes into blocks and judges them, [`posterior`] computes the quantiles of a block,
//! and [`level_move`] defines the public record of a move. When a strategy asks for a judgement is decided in
//! `strategies/`.

pub(crate) mod block;
pub(crate) mod level_move;
pub(crate) mod posterior;
