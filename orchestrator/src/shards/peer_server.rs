//! Peers as the operator configures them: `NAME=URL`.

use std::str::FromStr;

use reqwest::Url;
use store::shard::{InvalidShard, Shard};

/// Another server of the team: its shard and its address.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PeerServer {
    /// Shard of the server.
    pub shard: Shard,
    /// URL of the server, without a slash at its end.
    url: String,
}

/// A text that is not a peer.
#[derive(Debug, thiserror::Error)]
pub enum InvalidPeer {
    /// There is no `=`.
    #[error("{0:?} has no URL: write NAME=URL, such as west=http://10.0.0.6:8700")]
    NoUrl(String),
    /// The name is not that of a shard.
    #[error(transparent)]
    Shard(#[from] InvalidShard),
    /// The URL cannot be that of a server.
    #[error(
        "{url:?} is not the URL of a server: write http:// or https://, a host and a port, such as http://10.0.0.6:8700"
    )]
    Url {
        /// Text after the `=`.
        url: String,
    },
}

/// Peers that do not fit together, or do not fit this server.
#[derive(Debug, thiserror::Error)]
pub enum InvalidPeers {
    /// The server has no shard.
    #[error("--peers needs the name of this server's own shard: add --shard NAME")]
    NoOwnShard,
    /// A peer has the shard of this server.
    #[error("--peers lists {0}, which is the shard of this server: list only the other servers")]
    OwnShard(Shard),
    /// Two peers have one shard.
    #[error("--peers lists the shard {0} twice: each shard is one server")]
    Repeated(Shard),
    /// Two peers have one URL.
    #[error("--peers lists the URL {0} twice: each shard is one server")]
    RepeatedUrl(String),
    /// The system's certificates cannot be used for a peer with https.
    #[error("--peers cannot be reached with https: {0}")]
    Tls(String),
}

impl PeerServer {
    /// Returns the URL of a path of the server, which begins with a slash.
    pub(super) fn url_of(&self, path: &str) -> String {
        format!("{}{path}", self.url)
    }

    /// Returns true if requests to the server are encrypted.
    pub(super) fn is_encrypted(&self) -> bool {
        self.url.starts_with("https://")
    }
}

impl FromStr for PeerServer {
    type Err = InvalidPeer;

    fn from_str(text: &str) -> Result<Self, InvalidPeer> {
        let (name, url) = text.trim().split_once('=').ok_or_else(|| InvalidPeer::NoUrl(text.to_owned()))?;
        let shard = name.trim().parse()?;
        let invalid = || InvalidPeer::Url { url: url.to_owned() };
        let parsed = Url::parse(url.trim()).map_err(|_| invalid())?;
        let is_plain = parsed.query().is_none()
            && parsed.fragment().is_none()
            && parsed.username().is_empty()
            && parsed.password().is_none();
        if !["http", "https"].contains(&parsed.scheme()) || !parsed.has_host() || !is_plain {
            return Err(invalid());
        }
        Ok(Self { shard, url: parsed.as_str().trim_end_matches('/').to_owned() })
    }
}

/// Checks that the peers and the shard of this server all differ.
pub(super) fn check_peers(own: Option<&Shard>, peers: &[PeerServer]) -> Result<(), InvalidPeers> {
    let Some(own) = own else {
        return if peers.is_empty() { Ok(()) } else { Err(InvalidPeers::NoOwnShard) };
    };
    for (at, peer) in peers.iter().enumerate() {
        if peer.shard == *own {
            return Err(InvalidPeers::OwnShard(own.clone()));
        }
        if let Some(same) = peers[..at].iter().find(|before| before.shard == peer.shard) {
            return Err(InvalidPeers::Repeated(same.shard.clone()));
        }
        if peers[..at].iter().any(|before| before.url == peer.url) {
            return Err(InvalidPeers::RepeatedUrl(peer.url.clone()));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn peers_have_a_name_and_the_url_of_a_server() {
        let peer: PeerServer = " west = http://10.0.0.6:8700/ ".parse().expect("a peer");
        assert_eq!(peer.shard.as_str(), "west");
        assert_eq!(peer.url_of("/v1/runs"), "http://10.0.0.6:8700/v1/runs");
        assert!(!peer.is_encrypted());
        let behind_a_path: PeerServer = "b=https://example.com/shards/b".parse().expect("a peer");
        assert_eq!(behind_a_path.url_of("/v1/runs"), "https://example.com/shards/b/v1/runs");
        for text in [
            "",
            "west",
            "=http://a",
            "West=http://a",
            "west=",
            "west=10.0.0.6:8700",
            "west=ftp://a",
            "west=http://",
            "west=http://user@a",
            "west=http://a/?x=1",
            "west=http://a/#x",
        ] {
            assert!(text.parse::<PeerServer>().is_err(), "{text}");
        }
    }

    #[test]
    fn peers_differ_from_each_other_and_from_this_server() {
        let peers = |texts: &[&str]| {
            texts.iter().map(|text| text.parse().expect("a peer")).collect::<Vec<PeerServer>>()
        };
        let own: Shard = "east".parse().expect("a shard");
        let check = |texts: &[&str]| check_peers(Some(&own), &peers(texts));
        assert!(check(&["west=http://a", "north=http://b"]).is_ok());
        assert!(matches!(check(&["east=http://a"]), Err(InvalidPeers::OwnShard(_))));
        assert!(matches!(check(&["west=http://a", "west=http://b"]), Err(InvalidPeers::Repeated(_))));
        assert!(matches!(check(&["west=http://a", "north=http://a/"]), Err(InvalidPeers::RepeatedUrl(_))));
        assert!(check_peers(None, &[]).is_ok());
        assert!(matches!(check_peers(None, &peers(&["west=http://a"])), Err(InvalidPeers::NoOwnShard)));
    }
}
