//! The curriculum of a run as a source of episodes.
//!
//! One thread leases episodes ahead ([`fetch`]), another submits results ([`report`]). Between them and the environments
//! lies the [`episode_queue`], behind the lock of [`shared_queue`]. A step waits for the network only if no episode is ready or too many results are unsent.
//! Start with [`client`], which environments call; [`native`] is its Python class.

mod client;
mod episode_queue;
mod error;
mod fetch;
mod http_client;
mod lease;
mod native;
mod native_http;
mod report;
mod shared_queue;

pub(crate) use self::client::CurriculumClient;
pub(crate) use self::error::{CurriculumError, WaitError};
pub(crate) use self::lease::LeasedEpisode;
pub(crate) use self::native::NativeCurriculum;
pub(crate) use self::native_http::{NativeHttpClient, is_loopback, server_version_problem};
