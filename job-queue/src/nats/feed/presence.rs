//! Which servers run: each answers requests on a subject of its own, as long as it is connected.

use std::time::Duration;

use async_nats::Client;
use async_nats::client::RequestErrorKind;
use futures_util::StreamExt;
use tokio::task::JoinHandle;

use crate::nats::connection::NatsError;
use crate::nats::names::ClusterName;

/// Time in which a server that runs must answer.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(2);

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
    pub(super) client: Client,
    pub(super) cluster: ClusterName,
}

impl ServersOfCluster {
    /// Begins to answer for a server.
    pub(super) async fn announce(&self, server: &str) -> Result<ServerPresence, NatsError> {
        let questions = self.client.subscribe(self.cluster.server_presence(server)).await;
        let mut questions =
            questions.map_err(|error| NatsError::new("questions of servers cannot be read", error))?;
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

    /// Returns true if a server is connected. One that hangs is connected too.
    pub(super) async fn is_connected(&self, server: &str) -> Result<bool, NatsError> {
        let question = self.client.request(self.cluster.server_presence(server), Default::default());
        match tokio::time::timeout(ANSWER_TIMEOUT, question).await {
            Ok(Ok(_)) | Err(_) => Ok(true),
            Ok(Err(error)) => match error.kind() {
                RequestErrorKind::NoResponders => Ok(false),
                RequestErrorKind::TimedOut => Ok(true),
                _ => Err(NatsError::new(
                    &format!("the server {server} cannot be asked whether it runs"),
                    error,
                )),
            },
        }
    }
}
