//! Fixed limits of requests, connections and background work that requests cause.

use std::num::NonZeroU32;
use std::time::Duration;

/// Largest request body in bytes.
pub const MAX_BODY_BYTES: usize = 16 * 1024 * 1024;
/// Largest body of an OpenEnv request in bytes. A scenario is the largest valid body, and clients may be anonymous.
pub const MAX_OPENENV_BODY_BYTES: usize = 1024 * 1024;
/// Largest body in bytes that is read without a permit of [`BodyLimit`](super::BodyLimit).
pub const MAX_SMALL_BODY_BYTES: u64 = 1 << 20;
/// Maximum number of large request bodies that are parsed and replayed at the same time. Each may need a few hundred MiB.
pub const MAX_LARGE_BODIES: usize = 3;
/// Time in which a request body must arrive. A slow large body keeps other large bodies waiting.
pub const BODY_TIMEOUT: Duration = Duration::from_secs(20);
/// Maximum duration of a request.
pub const REQUEST_TIMEOUT: Duration = Duration::from_secs(60);
/// Additional time for a long poll, which itself waits for up to a minute.
pub const LONG_POLL_EXTRA_TIMEOUT: Duration = Duration::from_secs(30);
/// Maximum number of long polls that wait at the same time.
pub const MAX_LONG_POLLS: usize = 64;
/// Maximum time that a request waits for a permit of a [`ConcurrencyLimit`](super::ConcurrencyLimit).
pub const CONCURRENCY_WAIT_TIMEOUT: Duration = Duration::from_secs(10);

/// Maximum number of open connections, WebSockets included. Further connections wait to be accepted.
pub const MAX_CONNECTIONS: usize = 16_384;
/// Maximum number of open connections of one IP address. Further connections are closed.
pub const MAX_CONNECTIONS_PER_ADDRESS: usize = MAX_CONNECTIONS / 4 * 3;
/// Maximum duration of a request's head, and of the silence between two requests of a connection.
pub const REQUEST_HEAD_TIMEOUT: Duration = Duration::from_secs(75);
/// Maximum number of bytes that the server reads ahead of a connection.
pub const MAX_READ_AHEAD_BYTES: usize = 64 * 1024;

/// Maximum number of event listeners.
pub const MAX_LISTENERS: usize = 256;
/// Maximum number of event listeners of one client.
pub const MAX_LISTENERS_PER_CLIENT: usize = MAX_LISTENERS / 4;
/// Maximum number of viewers of web sessions.
pub const MAX_VIEWERS: usize = 256;
/// Maximum number of viewers of web sessions of one client.
pub const MAX_VIEWERS_PER_CLIENT: usize = MAX_VIEWERS / 4;

/// Maximum number of database lookups of unknown tokens per second and IP address.
pub const TOKEN_LOOKUPS_PER_SECOND: NonZeroU32 = NonZeroU32::MIN.saturating_add(199);
/// Maximum number of denials per second that the audit log records.
pub const AUDITED_DENIALS_PER_SECOND: NonZeroU32 = NonZeroU32::MIN.saturating_add(9);
/// Maximum number of denials per second and IP address that the audit log records.
pub const AUDITED_DENIALS_PER_SECOND_AND_ADDRESS: NonZeroU32 = NonZeroU32::MIN;
