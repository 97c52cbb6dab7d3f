//! Why a peer gave no answer.

use std::time::Duration;

use store::shard::Shard;

/// Why a peer gave no answer, as a sentence for the dashboard without a dot.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PeerError {
    /// No connection was made.
    #[error("the server cannot be reached")]
    Unreachable,
    /// The answer took too long.
    #[error("the server did not answer within {} s", .0.as_secs())]
    TimedOut(Duration),
    /// The connection broke before the end.
    #[error("the connection broke before the answer was complete")]
    Broken,
    /// The server at the URL has another shard.
    #[error("the server at its URL has the shard {0}; correct --peers")]
    OtherShard(Shard),
    /// The server at the URL has no shard, or is not Sparring.
    #[error("the server at its URL has no shard; start it with --shard, or correct --peers")]
    NoShard,
    /// The server rejected the token.
    #[error(
        "the server rejects the token; store the token in its database too (`sparring token create --stdin`)"
    )]
    Denied,
    /// The server answered with another status than success.
    #[error("the server answered with status {0}")]
    Status(u16),
    /// The answer is too large.
    #[error("the answer is too large")]
    TooLarge,
    /// The answer has another form.
    #[error("the answer has an unknown form; run the same version on all servers")]
    Malformed,
}
