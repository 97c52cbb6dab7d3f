//! Queues of jobs: the use cases submit jobs as data and await their results, wherever they are computed.
//!
//! [`JobQueue`] is the interface. [`LocalQueue`] computes on thread pools of this process. [`nats::server::NatsQueue`] sends jobs to
//! workers on other machines through NATS JetStream, and computes itself what no worker can do. [`nats::worker`] is the other side.
//! [`nats::feed`] carries trajectory feeds by the same connection settings.
//! Nothing here touches a database: a result comes with a [`Receipt`], which its caller acknowledges after the commit. Start reading
//! at [`queue`].

#[cfg(test)]
mod child_group;
#[doc(hidden)]
pub mod fuzzing;
pub mod local;
pub mod nats;
pub mod queue;
pub mod status;
#[cfg(test)]
pub mod testing;

pub use self::local::{LocalQueue, QueuePools};
pub use self::queue::{CompletedJob, JobError, JobQueue, Receipt};

/// Name of this host, as its operators know it; `host` if the system does not tell.
#[must_use]
pub fn host_name() -> String {
    let variable = |name| std::env::var(name).ok();
    let of_system = || std::fs::read_to_string("/proc/sys/kernel/hostname").ok();
    let name = of_system().or_else(|| variable("HOSTNAME")).or_else(|| variable("COMPUTERNAME"));
    let name = name.map(|name| name.trim().to_owned()).filter(|name| !name.is_empty());
    name.unwrap_or_else(|| "host".to_owned())
}
