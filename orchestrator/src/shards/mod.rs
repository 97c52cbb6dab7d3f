//! Several servers that divide the runs of a team: the shard of this server, and its peers.
//!
//! Runs are independent, so that each server has a database of its own, and ids say which one has a run (`store::shard`). A proxy
//! routes requests by these ids. [`Shards`] sends the few requests that concern several servers to the peers, and `merge` joins
//! the pages of lists. HTTP handlers are in `http`. Start reading at [`Shards`].

mod client;
pub(crate) mod merge;
mod peer_error;
mod peer_server;

pub(crate) use self::client::{ForwardError, PeerParts, ShardPart};
pub use self::client::{PEER_HEADER, SHARD_HEADER, Shards};
pub use self::peer_error::PeerError;
pub use self::peer_server::{InvalidPeer, InvalidPeers, PeerServer};
