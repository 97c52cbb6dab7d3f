//! Which servers run: each answers requests on a subject of its own, as long as it is connected.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use async_nats::Client;
use async_nats::client::RequestErrorKind;
use futures_util::StreamExt;
use parking_lot::Mutex;
use tokio::task::JoinHandle;

use crate::nats::connection::NatsError;
use crate::nats::names::ClusterName;

/// Time in which a server that runs must answer.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(2);
/// Time for which a server must be away before another one takes its feeds over: it connects again a second after an interruption.
const TAKEOVER_TIME: Duration = Duration::from_secs(10);
/// Time for which a server that hangs is not asked again.
const HANG_PAUSE: Duration = Duration::from_secs(10);

/// Answers the servers that ask for this one, until it is dropped.
#[derive(Debug)]
pub(super) struct ServerPresence(JoinHandle<()>);

impl Drop for ServerPresence {
    fn drop(&mut self) {
        self.0.abort();
    }
}

/// Servers with one name on NATS, which ask each other whether they run.
#[derive(Clone)]
pub(super) struct ServersOfCluster {
    client: Client,
    cluster: ClusterName,
    /// Servers that did not answer, as this connection saw them.
    silent: Arc<Mutex<BTreeMap<String, SilentServer>>>,
}

/// Server that did not answer when it was asked last.
#[derive(Clone, Copy)]
enum SilentServer {
    /// It is not connected.
    Away { since: Instant },
    /// It is connected and does not answer.
    Hanging { asked: Instant },
}

impl ServersOfCluster {
    pub(super) fn new(client: Client, cluster: ClusterName) -> Self {
        Self { client, cluster, silent: Arc::default() }
    }

    /// Name of the servers.
    pub(super) const fn cluster(&self) -> &ClusterName {
        &self.cluster
    }

    /// Begins to answer for a server.
    pub(super) async fn announce(&self, server: &str) -> Result<ServerPresence, NatsError> {
        let questions = self.client.subscribe(self.cluster.server_presence(server)).await;
        let mut questions = questions.map_err(|error| {
            NatsError::new("the subject on which servers ask each other cannot be read", error)
        })?;
        let client = self.client.clone();
        Ok(ServerPresence(tokio::spawn(async move {
            while let Some(question) = questions.next().await {
                if let Some(reply) = question.reply {
                    // A lost answer reads as a server that hangs, which is not replaced either.
                    let _ = client.publish(reply, Default::default()).await;
                }
            }
        })))
    }

    /// Returns true if a server runs. One that hangs runs too. One that was not connected runs until [`TAKEOVER_TIME`] after the first
    /// question that found it so.
    pub(super) async fn is_running(&self, server: &str) -> Result<bool, NatsError> {
        if let Some(SilentServer::Hanging { asked }) = self.silent.lock().get(server)
            && asked.elapsed() < HANG_PAUSE
        {
            return Ok(true);
        }
        let now = Instant::now();
        let question = self.client.request(self.cluster.server_presence(server), Default::default());
        let answer = tokio::time::timeout(ANSWER_TIMEOUT, question).await;
        let mut silent = self.silent.lock();
        match answer.map(|answer| answer.map_err(|error| (error.kind(), error))) {
            Ok(Ok(_)) => {
                silent.remove(server);
                Ok(true)
            }
            Ok(Err((RequestErrorKind::NoResponders, _))) => {
                let since = match silent.get(server) {
                    Some(SilentServer::Away { since }) => *since,
                    _ => now,
                };
                silent.insert(server.to_owned(), SilentServer::Away { since });
                Ok(since.elapsed() < TAKEOVER_TIME)
            }
            Err(_) | Ok(Err((RequestErrorKind::TimedOut, _))) => {
                silent.insert(server.to_owned(), SilentServer::Hanging { asked: now });
                Ok(true)
            }
            Ok(Err((_, error))) => {
                let step = format!("the server {server} cannot be asked whether it runs");
                Err(NatsError::new(&step, error))
            }
        }
    }
}
