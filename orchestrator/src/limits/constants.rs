//! Fixed limits of requests, connections and background work that requests cause.

use std::num::NonZeroU32;
use std::time::Duration;

use strict_input::InputLimits;

/// Largest request body of results and columns in bytes.
pub const MAX_BODY_BYTES: usize = 16 * 1024 * 1024;
/// Largest request body of all other operations in bytes. Complete scenarios and the actions of one episode are smaller.
pub const MAX_ORDINARY_BODY_BYTES: usize = 1024 * 1024;
/// Largest content of a body of results.
pub const BULK_INPUT_LIMITS: InputLimits = InputLimits { values: 4_000_000, keys: 400_000 };
/// Largest content of the body of any other operation, and of a message to `/v1/sessions`.
pub const ORDINARY_INPUT_LIMITS: InputLimits = InputLimits { values: 250_000, keys: 20_000 };
/// Largest body of an OpenEnv request in bytes. A scenario is the largest valid body, and clients may be anonymous.
pub const MAX_OPENENV_BODY_BYTES: usize = 1024 * 1024;
/// Largest body in bytes that is read without a permit of [`BodyLimit`](super::BodyLimit).
pub const MAX_SMALL_BODY_BYTES: u64 = 1 << 20;
/// Maximum number of large request bodies that are parsed and replayed at the same time. Each may need a few hundred MiB.
pub const MAX_LARGE_BODIES: usize = 3;
/// Largest number of bytes by which a gzip body may exceed its content; a body of random bytes exceeds it by far less.
pub const MAX_GZIP_OVERHEAD: usize = 1 << 20;
/// Time in which a request body must arrive. A slow large body keeps other large bodies waiting.
pub const BODY_TIMEOUT: Duration = Duration::from_secs(20);
/// Maximum duration of a request.
pub const REQUEST_TIMEOUT: Duration = Duration::from_secs(60);
/// Additional time for a long poll, which itself waits for up to a minute.
pub const LONG_POLL_EXTRA_TIMEOUT: Duration = Duration::from_secs(30);
/// Maximum number of long polls that wait at the same time.
pub const MAX_LONG_POLLS: usize = 64;
/// Maximum number of answers with trajectories that clients read or wait for at the same time.
pub const MAX_FEED_ANSWERS: usize = 256;
/// Maximum number of such answers of one client.
pub const MAX_FEED_ANSWERS_PER_CLIENT: usize = MAX_FEED_ANSWERS / 4 * 3;
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
/// Maximum number of TLS handshakes that are open. Further connections are closed.
pub const MAX_HANDSHAKES: usize = 1024;
/// Maximum number of open TLS handshakes of one IP address.
pub const MAX_HANDSHAKES_PER_ADDRESS: usize = MAX_HANDSHAKES / 4 * 3;
/// Maximum duration of a TLS handshake.
pub const HANDSHAKE_TIMEOUT: Duration = Duration::from_secs(10);
/// Time after which a connection is closed if its client reads nothing of a response that waits.
pub const WRITE_TIMEOUT: Duration = Duration::from_secs(30);

/// Largest text message of a WebSocket in bytes. `/v1/sessions` accepts larger ones, since its frames have many environments.
pub const MAX_TEXT_FRAME_BYTES: usize = 4 * 1024 * 1024;
/// Time in which a client must read a message of up to [`SEND_TIMEOUT_BYTES`] bytes.
pub const SEND_TIMEOUT: Duration = Duration::from_secs(10);
/// Number of bytes of a message for which the timeout is extended by [`SEND_TIMEOUT`].
pub const SEND_TIMEOUT_BYTES: usize = 10 << 20;

/// Maximum number of event listeners.
pub const MAX_LISTENERS: usize = 256;
/// Maximum number of event listeners of one client.
pub const MAX_LISTENERS_PER_CLIENT: usize = MAX_LISTENERS / 4;
/// Maximum number of viewers of web sessions.
pub const MAX_VIEWERS: usize = 256;
/// Maximum number of viewers of web sessions of one client.
pub const MAX_VIEWERS_PER_CLIENT: usize = MAX_VIEWERS / 4;

/// Maximum number of requests per second and run that log a trainer's metrics; a burst may have twice as many.
pub const METRICS_REQUESTS_PER_SECOND: NonZeroU32 = NonZeroU32::MIN.saturating_add(9);
/// Largest number of a trainer's metrics in a request, and in a run.
pub const MAX_METRICS: usize = 100;

/// Maximum number of database lookups of unknown tokens per second and IP address.
pub const TOKEN_LOOKUPS_PER_SECOND: NonZeroU32 = NonZeroU32::MIN.saturating_add(199);
/// Maximum number of denials per second that the audit log records.
pub const AUDITED_DENIALS_PER_SECOND: NonZeroU32 = NonZeroU32::MIN.saturating_add(9);
/// Maximum number of denials per second and IP address that the audit log records.
pub const AUDITED_DENIALS_PER_SECOND_AND_ADDRESS: NonZeroU32 = NonZeroU32::MIN;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rollouts::feed::MAX_ANSWER_BYTES;
    use crate::sessions::vector::frame::{MAX_REPLY_BYTES, MAX_REQUEST_BYTES};
    use store::trainer_metrics::MAX_POINTS;

    const PAGE: &str = include_str!("../../../docs/reference/limits.md");

    /// Formats a number with spaces between groups of three digits.
    fn grouped(number: usize) -> String {
        let digits = number.to_string();
        let groups = digits.as_bytes().rchunks(3).rev().map(String::from_utf8_lossy);
        groups.collect::<Vec<_>>().join(" ")
    }

    fn bytes(count: usize) -> String {
        if count >= 1 << 20 { format!("{} MiB", count >> 20) } else { format!("{} KiB", count >> 10) }
    }

    fn content(InputLimits { values, keys }: InputLimits) -> String {
        format!("{} values, {} keys", grouped(values), grouped(keys))
    }

    fn seconds(time: Duration) -> String {
        format!("{} s", time.as_secs())
    }

    /// Every limit of the page is the constant that its row names.
    #[test]
    fn page_of_limits_has_the_values_of_the_constants() {
        let limits = [
            ("MAX_CONNECTIONS", grouped(MAX_CONNECTIONS)),
            ("MAX_CONNECTIONS_PER_ADDRESS", grouped(MAX_CONNECTIONS_PER_ADDRESS)),
            ("REQUEST_HEAD_TIMEOUT", seconds(REQUEST_HEAD_TIMEOUT)),
            ("MAX_READ_AHEAD_BYTES", bytes(MAX_READ_AHEAD_BYTES)),
            ("REQUEST_TIMEOUT", seconds(REQUEST_TIMEOUT)),
            ("MAX_HANDSHAKES", grouped(MAX_HANDSHAKES)),
            ("MAX_HANDSHAKES_PER_ADDRESS", grouped(MAX_HANDSHAKES_PER_ADDRESS)),
            ("HANDSHAKE_TIMEOUT", seconds(HANDSHAKE_TIMEOUT)),
            ("WRITE_TIMEOUT", seconds(WRITE_TIMEOUT)),
            ("MAX_BODY_BYTES", bytes(MAX_BODY_BYTES)),
            ("MAX_ORDINARY_BODY_BYTES", bytes(MAX_ORDINARY_BODY_BYTES)),
            ("BULK_INPUT_LIMITS", content(BULK_INPUT_LIMITS)),
            ("ORDINARY_INPUT_LIMITS", content(ORDINARY_INPUT_LIMITS)),
            ("INPUT_LIMITS", content(openenv_wire::INPUT_LIMITS)),
            ("MAX_OPENENV_BODY_BYTES", bytes(MAX_OPENENV_BODY_BYTES)),
            ("MAX_LARGE_BODIES", grouped(MAX_LARGE_BODIES)),
            ("BODY_TIMEOUT", seconds(BODY_TIMEOUT)),
            ("MAX_TEXT_FRAME_BYTES", bytes(MAX_TEXT_FRAME_BYTES)),
            ("MAX_REQUEST_BYTES", bytes(MAX_REQUEST_BYTES)),
            ("MAX_REPLY_BYTES", bytes(MAX_REPLY_BYTES)),
            ("SEND_TIMEOUT", seconds(SEND_TIMEOUT)),
            ("MAX_LISTENERS", grouped(MAX_LISTENERS)),
            ("MAX_LISTENERS_PER_CLIENT", grouped(MAX_LISTENERS_PER_CLIENT)),
            ("METRICS_REQUESTS_PER_SECOND", METRICS_REQUESTS_PER_SECOND.to_string()),
            ("MAX_METRICS", grouped(MAX_METRICS)),
            ("MAX_POINTS", grouped(MAX_POINTS.unsigned_abs() as usize)),
            ("MAX_VIEWERS", grouped(MAX_VIEWERS)),
            ("MAX_VIEWERS_PER_CLIENT", grouped(MAX_VIEWERS_PER_CLIENT)),
            ("MAX_LONG_POLLS", grouped(MAX_LONG_POLLS)),
            ("MAX_FEED_ANSWERS", grouped(MAX_FEED_ANSWERS)),
            ("MAX_FEED_ANSWERS_PER_CLIENT", grouped(MAX_FEED_ANSWERS_PER_CLIENT)),
            ("MAX_ANSWER_BYTES", bytes(usize::try_from(MAX_ANSWER_BYTES).expect("a size"))),
        ];
        for (name, value) in &limits {
            let row = PAGE.lines().find(|line| line.starts_with('|') && line.contains(&format!("`{name}`")));
            let cell = row.and_then(|row| row.split('|').nth(2)).map(str::trim);
            assert_eq!(cell, Some(value.as_str()), "docs/reference/limits.md: {name}");
        }
        let rows = PAGE.lines().filter(|line| line.starts_with('|') && line.contains("| `")).count();
        assert_eq!(rows, limits.len(), "each row of docs/reference/limits.md with a constant is compared");
    }
}
