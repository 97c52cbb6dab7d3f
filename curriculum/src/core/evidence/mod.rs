//! Statistical evidence behind level moves.
//!
//! A group that is evidence is a [slot](crate::Slot). [`interval`] is the value of a slot, [`slot_queue`] keeps slots in
//! order until they are settled, [`block`] gathers settled slots into blocks and judges them, [`posterior`] computes the
//! quantiles of a block, and [`level_move`] defines the public record of a move. When a strategy asks for a judgement is
//! decided in `strategies/`.

pub(crate) mod block;
pub(crate) mod interval;
pub(crate) mod level_move;
pub(crate) mod posterior;
pub(crate) mod slot_queue;
