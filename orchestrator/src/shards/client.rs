//! [`Shards`]: the shard of this server, and requests to its peers.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use api_types::{MissingShard, ProblemDetails};
use axum::http::{HeaderMap, Method, StatusCode, header};
use futures_util::future::join_all;
use llm::{TrustedRoots, http_client_builder};
use reqwest::{RequestBuilder, Response};
use serde::Serialize;
use serde::de::DeserializeOwned;
use store::shard::Shard;

use super::peer_error::PeerError;
use super::peer_server::{InvalidPeers, PeerServer, check_peers};

/// Header of a request that a peer sends, with the shard of the sender. Such a request is answered from this server alone.
pub const PEER_HEADER: &str = "sparring-peer";
/// Header of every response of a server with a shard, with its name.
pub const SHARD_HEADER: &str = "sparring-shard";

/// Longest time of a request for a part of a list.
const LIST_TIMEOUT: Duration = Duration::from_secs(2);
/// Longest time of a request that is passed on, which may wait for a commit.
const FORWARD_TIMEOUT: Duration = Duration::from_secs(10);
/// Largest answer of a peer in bytes.
const MAX_PEER_ANSWER_BYTES: usize = 16 << 20;

/// The shard of this server, and its peers.
#[derive(Debug)]
pub struct Shards {
    own: Option<Shard>,
    peers: Vec<PeerLink>,
    client: reqwest::Client,
}

/// Peer with the outcome of the latest request, so that the log has changes only.
#[derive(Debug)]
struct PeerLink {
    server: PeerServer,
    is_absent: AtomicBool,
}

impl PeerLink {
    /// Logs that the peer is absent, or is back.
    fn log_change(&self, error: Option<&PeerError>) {
        let was_absent = self.is_absent.swap(error.is_some(), Ordering::Relaxed);
        match error {
            Some(error) if !was_absent => {
                tracing::warn!(shard = %self.server.shard, %error, "Lists lack the part of a peer.");
            }
            None if was_absent => {
                tracing::info!(shard = %self.server.shard, "Lists have the part of a peer again.");
            }
            _ => {}
        }
    }
}

/// Part of a list, from the server of one shard.
#[derive(Debug)]
pub(crate) struct ShardPart<T> {
    /// Shard of the server.
    pub(crate) shard: Shard,
    /// Answer of the server.
    pub(crate) part: T,
}

/// Parts of a list from the peers.
#[derive(Debug)]
pub(crate) struct PeerParts<T> {
    /// Parts of the peers that answered, in the order of the peers.
    pub(crate) parts: Vec<ShardPart<T>>,
    /// Peers that did not answer.
    pub(crate) missing: Vec<MissingShard>,
}

/// Why a request that was passed on to a peer failed.
#[derive(Debug)]
pub(crate) enum ForwardError {
    /// The peer rejected the request.
    Rejected(Box<ProblemDetails>),
    /// The peer gave no answer.
    NoAnswer(Shard, PeerError),
}

#[cfg(test)]
impl Default for Shards {
    fn default() -> Self {
        Self::new(None, Vec::new()).expect("a server without a shard needs nothing")
    }
}

impl Shards {
    /// Creates the shards of a server.
    ///
    /// # Errors
    /// Returns [`InvalidPeers`] if a peer is listed twice or is this server, or https cannot be used.
    pub fn new(own: Option<Shard>, peers: Vec<PeerServer>) -> Result<Self, InvalidPeers> {
        check_peers(own.as_ref(), &peers)?;
        let is_encrypted = peers.iter().any(PeerServer::is_encrypted);
        let roots = if is_encrypted { TrustedRoots::System } else { TrustedRoots::None };
        let builder = http_client_builder(roots).map_err(InvalidPeers::Tls)?;
        let client = builder.no_proxy().build().map_err(|error| InvalidPeers::Tls(error.to_string()))?;
        let peers =
            peers.into_iter().map(|server| PeerLink { server, is_absent: AtomicBool::default() }).collect();
        Ok(Self { own, peers, client })
    }

    /// Shard of this server, if it has one.
    #[must_use]
    pub const fn own(&self) -> Option<&Shard> {
        self.own.as_ref()
    }

    /// Shards of this server and its peers, this one first.
    pub fn names(&self) -> impl Iterator<Item = &Shard> {
        self.own.iter().chain(self.peers.iter().map(|peer| &peer.server.shard))
    }

    /// Returns true if the answer to a request has parts of the peers: there are peers, and none of them sent the request.
    pub(crate) fn is_merged(&self, headers: &HeaderMap) -> bool {
        !self.peers.is_empty() && !headers.contains_key(PEER_HEADER)
    }

    /// Returns the peer that a request for a shard is passed on to; `None` if this server answers the request.
    pub(crate) fn forward_target(&self, headers: &HeaderMap, shard: Option<&Shard>) -> Option<&PeerServer> {
        let shard = shard.filter(|shard| self.own() != Some(*shard))?;
        let peers = self.peers.iter().map(|peer| &peer.server);
        peers.filter(|_| !headers.contains_key(PEER_HEADER)).find(|peer| peer.shard == *shard)
    }

    /// Asks all peers for their parts of a list at once, with the token of the request. `path_of` returns the path and query for a
    /// peer. Peers that do not answer in time are missing.
    pub(crate) async fn ask<T: DeserializeOwned>(
        &self,
        headers: &HeaderMap,
        path_of: impl Fn(&Shard) -> String,
    ) -> PeerParts<T> {
        let mut found = PeerParts { parts: Vec::new(), missing: Vec::new() };
        if !self.is_merged(headers) {
            return found;
        }
        let wanted = self.peers.iter().map(|peer| (peer, path_of(&peer.server.shard)));
        let answers = join_all(wanted.map(|(peer, path)| async move {
            let request = self.client.get(peer.server.url_of(&path)).timeout(LIST_TIMEOUT);
            (peer, self.fetch::<T>(&peer.server, request, headers).await)
        }));
        for (peer, answer) in answers.await {
            peer.log_change(answer.as_ref().err());
            let shard = peer.server.shard.clone();
            match answer {
                Ok(part) => found.parts.push(ShardPart { shard, part }),
                Err(error) => {
                    found.missing.push(MissingShard { shard: shard.to_string(), reason: error.to_string() });
                }
            }
        }
        found
    }

    async fn fetch<T: DeserializeOwned>(
        &self,
        peer: &PeerServer,
        request: RequestBuilder,
        headers: &HeaderMap,
    ) -> Result<T, PeerError> {
        let response = self.send(peer, request, headers, LIST_TIMEOUT).await?;
        match response.status() {
            StatusCode::UNAUTHORIZED | StatusCode::FORBIDDEN => return Err(PeerError::Denied),
            status if !status.is_success() => return Err(PeerError::Status(status.as_u16())),
            _ => {}
        }
        let body = read_body(response, LIST_TIMEOUT).await?;
        serde_json::from_slice(&body).map_err(|_| PeerError::Malformed)
    }

    /// Passes a request on to a peer, with its token, and returns the answer.
    ///
    /// # Errors
    /// Returns [`ForwardError`] if the peer rejects the request or gives no answer.
    pub(crate) async fn forward<T: DeserializeOwned>(
        &self,
        peer: &PeerServer,
        headers: &HeaderMap,
        method: Method,
        path: &str,
        body: Option<&(impl Serialize + Sync)>,
    ) -> Result<T, ForwardError> {
        let failed = |error| ForwardError::NoAnswer(peer.shard.clone(), error);
        let mut request = self.client.request(method, peer.url_of(path)).timeout(FORWARD_TIMEOUT);
        if let Some(body) = body {
            request = request.json(body);
        }
        let response = self.send(peer, request, headers, FORWARD_TIMEOUT).await.map_err(failed)?;
        let is_success = response.status().is_success();
        let body = read_body(response, FORWARD_TIMEOUT).await.map_err(failed)?;
        let malformed = |_| failed(PeerError::Malformed);
        if is_success {
            return serde_json::from_slice(&body).map_err(malformed);
        }
        let problem: ProblemDetails = serde_json::from_slice(&body).map_err(malformed)?;
        Err(ForwardError::Rejected(Box::new(problem)))
    }

    /// Sends a request with the headers that a peer needs, and checks that the answer is from the server of its shard.
    async fn send(
        &self,
        peer: &PeerServer,
        mut request: RequestBuilder,
        headers: &HeaderMap,
        timeout: Duration,
    ) -> Result<Response, PeerError> {
        let own = self.own().map_or("", Shard::as_str);
        request = request.header(PEER_HEADER, own).header(header::ACCEPT, "application/json");
        if let Some(token) = headers.get(header::AUTHORIZATION) {
            request = request.header(header::AUTHORIZATION, token);
        }
        let response = request.send().await.map_err(|error| failure_of(&error, timeout))?;
        let found = response.headers().get(SHARD_HEADER).and_then(|value| value.to_str().ok());
        match found.and_then(|name| name.parse::<Shard>().ok()) {
            Some(found) if found == peer.shard => Ok(response),
            Some(found) => Err(PeerError::OtherShard(found)),
            // A proxy in front of the peer answers for it while it is down.
            None if response.status().is_server_error() => Err(PeerError::Status(response.status().as_u16())),
            None => Err(PeerError::NoShard),
        }
    }
}

/// Reads the body of an answer, up to its bound.
async fn read_body(mut response: Response, timeout: Duration) -> Result<Vec<u8>, PeerError> {
    let mut body = Vec::new();
    while let Some(part) = response.chunk().await.map_err(|error| failure_of(&error, timeout))? {
        if body.len() + part.len() > MAX_PEER_ANSWER_BYTES {
            return Err(PeerError::TooLarge);
        }
        body.extend_from_slice(&part);
    }
    Ok(body)
}

/// Returns why a request failed.
fn failure_of(error: &reqwest::Error, timeout: Duration) -> PeerError {
    match error {
        error if error.is_timeout() => PeerError::TimedOut(timeout),
        error if error.is_connect() => PeerError::Unreachable,
        _ => PeerError::Broken,
    }
}
