//! Many environments that are stepped over one connection by binary frames.
//!
//! The environments run one recipe, with seeds of their own for every slot and episode, or the episodes of a lease, which
//! the slots take in order and the session reports. [`VectorSession`] answers frames ([`frame`] has every byte), `env_batch`
//! steps the environments and writes the reply, `assigner` and `reporter` connect them to the lease. `plan` sizes a session
//! before it is opened.

mod assigner;
mod env_batch;
mod error;
pub mod frame;
pub(super) mod plan;
mod reporter;
mod session;

use tokio::sync::oneshot;

pub(super) use self::assigner::LeaseAssigner;
pub(super) use self::env_batch::EnvBatch;
pub use self::env_batch::{FLAG_DONE, FLAG_IDLE};
pub use self::error::{MemoryExceeded, VectorError};
pub use self::plan::VectorRequest;
pub(super) use self::reporter::EpisodeReporter;
pub use self::reporter::EpisodeTally;
pub(super) use self::session::{LastFrame, LeaseBinding};
pub use self::session::{VectorSession, VectorSource};

/// Runs work on the threads for environments, so that no connection waits for it. Returns `None` if the work panicked.
pub(super) async fn run_on<T: Send + 'static>(
    threads: &rayon::ThreadPool,
    work: impl FnOnce() -> T + Send + 'static,
) -> Option<T> {
    let (sender, result) = oneshot::channel();
    threads.spawn(move || {
        let _ = sender.send(work());
    });
    result.await.ok()
}
