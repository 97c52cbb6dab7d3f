//! Episodes of satellite tasking that the classes of `sparring.tasking` compose.

mod batch;
mod episode;
mod filter;
mod journal;
mod step;

pub(crate) use self::batch::NativeTaskingBatch;
pub(crate) use self::episode::NativeTaskingEpisode;
pub(crate) use self::step::NativeTaskingStep;
