//! Trainers that step environments on the server over WebSockets, lose their connection on purpose, and resume their session.

use futures_util::{SinkExt, StreamExt};
use serde_json::{Value, json};
use tokio::net::TcpStream;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream, connect_async_tls_with_config};

use super::RUN;
use super::trainers::{RETRY_INTERVAL, Trainer};
use crate::Lease;

/// Messages between two connections that a trainer drops before it reads the answer.
const MESSAGES_PER_CONNECTION: u64 = 97;
/// Steps of a vector session between two reads of what it has reported.
const STEPS_PER_STATE: u32 = 10;
/// Number of environments of a vector session.
const ENVS: usize = 4;
/// Bytes of the number of a frame in its header.
const SEQUENCE: std::ops::Range<usize> = 8..12;
/// Flag of an environment whose lease has no episode left.
const IDLE: u8 = 2;

type Socket = WebSocketStream<MaybeTlsStream<TcpStream>>;

/// Session that survives its connections.
#[derive(Debug, Default)]
struct SessionClient {
    socket: Option<Socket>,
    /// Key of the session, once it is open.
    key: Option<Value>,
    /// Messages sent so far.
    sent: u64,
}

impl Trainer {
    /// Steps episodes of the run on the server, one at a time.
    pub(super) async fn step_sessions(self) -> anyhow::Result<()> {
        let mut id = self.seed << 32;
        while self.continues().await? {
            let mut session = SessionClient::default();
            let mut message = json!({"type": "open", "version": 2, "run": RUN});
            while self.is_running() {
                let Some(reply) = session.request(&self, &message).await? else { break };
                if reply["type"] == "error" {
                    tokio::time::sleep(RETRY_INTERVAL).await;
                    break; // only the receipt of a finished episode is an acknowledgement
                }
                if reply["done"] == true {
                    self.log.record_receipt("steps", &reply["reported"]);
                    tokio::time::sleep(self.pause).await;
                }
                id += 1;
                message = match reply["done"] == true {
                    true => json!({"type": "reset", "id": id, "run": RUN}),
                    false => json!({"type": "step", "id": id, "action": {}}),
                };
            }
        }
        Ok(())
    }

    /// Leases groups and steps their episodes in vector sessions, by binary frames.
    pub(super) async fn step_vectors(self) -> anyhow::Result<()> {
        while self.continues().await? {
            let response = self.request("POST", "/leases", &json!({"groups": 4, "ttl_s": 60})).await?;
            anyhow::ensure!(response.status == 201, "no lease: {}", response.body);
            let lease = Lease(response.body);
            self.step_lease(&lease).await?;
            // Episodes that the session did not finish return. The lease may have ended already.
            let _ = self.request("POST", &format!("/leases/{}/release", lease.id()), &json!({})).await?;
        }
        Ok(())
    }

    /// Steps the episodes of one task of a lease until none is left or the session is lost.
    async fn step_lease(&self, lease: &Lease) -> anyhow::Result<()> {
        let observe = self.world.vector_observation();
        let vector = json!({"envs": ENVS, "observe": observe, "task": lease.0["groups"][0]["task"]});
        let open =
            json!({"type": "open", "version": 2, "run": RUN, "lease_id": lease.id(), "vector": vector});
        let mut session = SessionClient::default();
        let Some(opened) = session.request(self, &open).await?.filter(|reply| reply["type"] == "opened")
        else {
            return Ok(());
        };
        let number =
            |value: &Value| value.as_u64().and_then(|number| usize::try_from(number).ok()).unwrap_or(0);
        let action_bytes = number(&opened["frames"]["actions"]["bytes"]);
        let fields = opened["frames"]["stepped"]["fields"].as_array().into_iter().flatten();
        let flags_at =
            fields.filter(|field| field["name"] == "flags").map(|field| number(&field["offset"])).next();
        let flags_at = flags_at.unwrap_or(0);
        for sequence in 1_u32.. {
            let Some(frame) = session.step(self, &action_frame(sequence, action_bytes)).await? else {
                return Ok(());
            };
            let flags = frame.get(flags_at..flags_at + ENVS).unwrap_or_default();
            let is_done = flags.iter().all(|flags| flags & IDLE == IDLE) || !self.is_running();
            if is_done || sequence % STEPS_PER_STATE == 0 {
                let kind = if is_done { "close" } else { "state" };
                let Some(state) = session.request(self, &json!({"type": kind})).await? else { return Ok(()) };
                let reported =
                    ["counted", "stored"].map(|field| state["reported"][field].as_u64().unwrap_or(0));
                self.log.record_vector(lease.id(), reported.iter().sum());
            }
            if is_done {
                return Ok(());
            }
        }
        Ok(())
    }
}

impl SessionClient {
    /// Sends a message until it is answered by text. Returns `None` if the session is lost, or if the trainer is to stop.
    async fn request(&mut self, trainer: &Trainer, message: &Value) -> anyhow::Result<Option<Value>> {
        let message = Message::text(message.to_string());
        let Some(Message::Text(text)) = self.exchange(trainer, message, Message::is_text).await? else {
            return Ok(None);
        };
        let reply: Value = serde_json::from_str(&text)?;
        if reply["type"] == "opened" {
            self.key = Some(reply["session"].clone());
        }
        Ok(Some(reply))
    }

    /// Sends a frame until it is answered by the frame of the same number. Returns `None` if the session is lost.
    async fn step(&mut self, trainer: &Trainer, frame: &[u8]) -> anyhow::Result<Option<Vec<u8>>> {
        // The first frame of a session comes without a request. A text is an error.
        let is_answer = |answer: &Message| match answer {
            Message::Binary(stepped) => stepped.get(SEQUENCE) == frame.get(SEQUENCE),
            answer => answer.is_text(),
        };
        let answer = self.exchange(trainer, Message::binary(frame.to_vec()), is_answer).await?;
        Ok(answer.and_then(|answer| if answer.is_text() { None } else { Some(answer.into_data().to_vec()) }))
    }

    /// Sends a message and reads its answer, again on a new connection if one is lost. Returns `None` if the session is lost.
    async fn exchange(
        &mut self,
        trainer: &Trainer,
        message: Message,
        is_answer: impl Fn(&Message) -> bool,
    ) -> anyhow::Result<Option<Message>> {
        while self.connect(trainer).await? {
            let Some(mut socket) = self.socket.take() else { continue };
            self.sent += 1;
            let is_sent = socket.send(message.clone()).await.is_ok();
            if !is_sent || self.key.is_some() && self.sent.is_multiple_of(MESSAGES_PER_CONNECTION) {
                continue; // the socket is dropped without a close frame, and the answer is lost
            }
            while let Some(Ok(answer)) = socket.next().await {
                if is_answer(&answer) {
                    self.socket = Some(socket);
                    return Ok(Some(answer));
                }
            }
        }
        Ok(None)
    }

    /// Connects and resumes the session, unless there is a connection. Returns false if the session is lost.
    async fn connect(&mut self, trainer: &Trainer) -> anyhow::Result<bool> {
        let url = trainer.api.websocket_url("/v1/sessions");
        while self.socket.is_none() {
            if !trainer.is_running() {
                return Ok(false);
            }
            let connected = connect_async_tls_with_config(&url, None, true, trainer.api.connector()).await;
            let Ok((mut socket, _)) = connected else {
                trainer.log.record_unreachable();
                tokio::time::sleep(RETRY_INTERVAL).await;
                continue;
            };
            if let Some(key) = &self.key {
                let resume = json!({"type": "resume", "session": key}).to_string();
                if socket.send(Message::text(resume)).await.is_err() {
                    continue;
                }
                let Some(Ok(Message::Text(text))) = socket.next().await else { continue };
                let reply: Value = serde_json::from_str(&text)?;
                if reply["type"] != "resumed" {
                    return Ok(false); // the server that had the session was killed
                }
                trainer.log.record_resumed();
            }
            self.socket = Some(socket);
        }
        Ok(true)
    }
}

/// Builds a frame of actions that are all zero.
fn action_frame(sequence: u32, bytes: usize) -> Vec<u8> {
    let mut frame = b"SPVF".to_vec();
    frame.extend(2_u16.to_le_bytes()); // version
    frame.extend(1_u16.to_le_bytes()); // kind: actions
    frame.extend(sequence.to_le_bytes());
    frame.extend((ENVS as u32).to_le_bytes());
    frame.resize(bytes.max(frame.len()), 0);
    frame
}
