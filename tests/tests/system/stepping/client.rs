//! A client as near to the wire as the documentation is.

use std::time::Duration;

use futures_util::{SinkExt, StreamExt};
use serde_json::{Value, json};
use system_tests::Api;
use tokio::net::TcpStream;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream, connect_async};

/// A WebSocket to `/v1/sessions`.
pub(crate) struct Socket(WebSocketStream<MaybeTlsStream<TcpStream>>);

/// What came over it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Came {
    Text(Value),
    Binary(Vec<u8>),
    /// It was closed, with this code.
    Closed(u16),
    Nothing,
}

impl Socket {
    pub(crate) async fn to(api: &Api) -> Self {
        let url = format!("{}/v1/sessions", api.base().replacen("http", "ws", 1));
        Self(connect_async(url).await.unwrap().0)
    }

    /// Opens a session; the answer.
    pub(crate) async fn open(api: &Api, wish: Value) -> (Self, Value) {
        let mut socket = Self::to(api).await;
        let told = socket.ask(opening(wish)).await;
        assert_eq!(told["type"], "opened", "{told}");
        (socket, told)
    }

    /// Comes back to a session; the answer.
    pub(crate) async fn resume(api: &Api, opened: &Value) -> (Self, Value) {
        let mut socket = Self::to(api).await;
        let told = socket.ask(json!({"type": "resume", "session": opened["session"]})).await;
        (socket, told)
    }

    pub(crate) async fn text(&mut self, text: impl Into<String>) {
        self.0.send(Message::text(text.into())).await.unwrap();
    }

    pub(crate) async fn bytes(&mut self, bytes: &[u8]) {
        self.0.send(Message::binary(bytes.to_vec())).await.unwrap();
    }

    /// Sends bytes, which who does not want them may cut short.
    pub(crate) async fn too_many_bytes(&mut self, bytes: &[u8]) {
        drop(self.0.send(Message::binary(bytes.to_vec())).await);
    }

    pub(crate) async fn next(&mut self) -> Came {
        self.next_within(20.0).await
    }

    pub(crate) async fn next_within(&mut self, seconds: f64) -> Came {
        loop {
            match tokio::time::timeout(Duration::from_secs_f64(seconds), self.0.next()).await {
                Err(_) => return Came::Nothing,
                Ok(Some(Ok(Message::Text(text)))) => return Came::Text(serde_json::from_str(&text).unwrap()),
                Ok(Some(Ok(Message::Binary(bytes)))) => return Came::Binary(bytes.to_vec()),
                Ok(Some(Ok(Message::Close(frame)))) => {
                    return Came::Closed(frame.map_or(1005, |frame| frame.code.into()));
                }
                Ok(Some(Ok(_))) => {}
                Ok(Some(Err(_)) | None) => return Came::Closed(1006),
            }
        }
    }

    /// Text that comes next.
    pub(crate) async fn told(&mut self) -> Value {
        match self.next().await {
            Came::Text(told) => told,
            other => panic!("{other:?}"),
        }
    }

    pub(crate) async fn ask(&mut self, message: Value) -> Value {
        self.text(message.to_string()).await;
        self.told().await
    }

    /// Steps; the answer.
    pub(crate) async fn step(&mut self, id: u64, action: &Value) -> Value {
        self.ask(json!({"type": "step", "id": id, "action": action})).await
    }

    /// A binary frame that comes next.
    pub(crate) async fn frame(&mut self) -> Vec<u8> {
        match self.next().await {
            Came::Binary(bytes) => bytes,
            other => panic!("{other:?}"),
        }
    }

    /// Cut off without a word: no close frame, and what was sent and not read is lost.
    pub(crate) async fn cut(mut self) {
        let MaybeTlsStream::Plain(stream) = self.0.get_mut() else { panic!("no TLS here") };
        stream.set_zero_linger().unwrap();
    }

    /// Says goodbye properly.
    pub(crate) async fn leave(mut self) {
        self.0.close(None).await.unwrap();
    }
}

pub(crate) fn opening(mut wish: Value) -> Value {
    wish["type"] = json!("open");
    wish["version"] = json!(1);
    wish
}

/// A session of many environments.
pub(crate) struct Vector {
    pub(crate) socket: Socket,
    pub(crate) opened: Value,
    pub(crate) sequence: u32,
}

/// An answer, taken apart by what `opened` says of it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Stepped {
    pub(crate) sequence: u32,
    pub(crate) observations: Vec<f32>,
    pub(crate) rewards: Vec<f32>,
    pub(crate) team_rewards: Vec<f32>,
    pub(crate) episodes: Vec<i32>,
    pub(crate) terminated: Vec<u8>,
    pub(crate) truncated: Vec<u8>,
    pub(crate) flags: Vec<u8>,
    pub(crate) finals: Vec<f32>,
}

pub(crate) fn head(kind: u16, sequence: u32, envs: u32) -> Vec<u8> {
    let mut bytes = b"SPVF".to_vec();
    bytes.extend(1u16.to_le_bytes());
    bytes.extend(kind.to_le_bytes());
    bytes.extend(sequence.to_le_bytes());
    bytes.extend(envs.to_le_bytes());
    bytes
}

impl Vector {
    /// Opens one, and reads its first frame.
    pub(crate) async fn open(api: &Api, wish: Value) -> (Self, Stepped) {
        let (mut socket, opened) = Socket::open(api, wish).await;
        let frame = socket.frame().await;
        let vector = Self { socket, opened, sequence: 0 };
        let first = vector.read(&frame);
        (vector, first)
    }

    pub(crate) fn size(&self, name: &str) -> usize {
        self.opened[name].as_u64().unwrap() as usize
    }

    pub(crate) fn actions(&self, sequence: u32, actions: &[f32]) -> Vec<u8> {
        let mut bytes = head(1, sequence, self.size("envs") as u32);
        bytes.extend(actions.iter().flat_map(|action| action.to_le_bytes()));
        bytes
    }

    /// How many numbers a frame of actions has.
    pub(crate) fn width(&self) -> usize {
        self.size("envs") * self.size("agents") * self.size("action")
    }

    pub(crate) async fn step(&mut self, actions: &[f32]) -> Stepped {
        self.sequence += 1;
        let frame = self.actions(self.sequence, actions);
        self.socket.bytes(&frame).await;
        let frame = self.socket.frame().await;
        self.read(&frame)
    }

    pub(crate) async fn reset(&mut self, mask: &[u8]) -> Stepped {
        self.sequence += 1;
        let mut frame = head(3, self.sequence, self.size("envs") as u32);
        frame.extend(mask);
        frame.resize(frame.len().div_ceil(4) * 4, 0);
        self.socket.bytes(&frame).await;
        let frame = self.socket.frame().await;
        self.read(&frame)
    }

    pub(crate) fn read(&self, frame: &[u8]) -> Stepped {
        let told = &self.opened["frames"]["stepped"];
        let sequence = u32::from_le_bytes(frame[8..12].try_into().unwrap());
        assert_eq!(frame[..8], head(2, 0, 0)[..8]);
        assert_eq!(frame[12..16], (self.size("envs") as u32).to_le_bytes());
        let bytes = |name: &str| -> Vec<u8> {
            let fields = told["fields"].as_array().unwrap();
            let Some(field) = fields.iter().find(|field| field["name"] == name) else { return Vec::new() };
            let from = field["offset"].as_u64().unwrap() as usize;
            assert_eq!(from % 4, 0, "{name}");
            let shape = field["shape"].as_array().unwrap();
            if shape[0] == "done" {
                return frame[from..].to_vec();
            }
            let cells: u64 = shape.iter().map(|length| length.as_u64().unwrap()).product();
            let each = if field["dtype"] == "|u1" { 1 } else { 4 };
            frame[from..from + cells as usize * each].to_vec()
        };
        let floats = |name: &str| -> Vec<f32> {
            bytes(name).as_chunks::<4>().0.iter().map(|cell| f32::from_le_bytes(*cell)).collect()
        };
        let finals = floats("final_observations");
        assert_eq!(frame.len(), told["bytes"].as_u64().unwrap() as usize + finals.len() * 4);
        Stepped {
            sequence,
            observations: floats("observations"),
            rewards: floats("rewards"),
            team_rewards: floats("team_rewards"),
            episodes: bytes("episodes").as_chunks::<4>().0.iter().map(|c| i32::from_le_bytes(*c)).collect(),
            terminated: bytes("terminated"),
            truncated: bytes("truncated"),
            flags: bytes("flags"),
            finals,
        }
    }
}

/// A number in [0, 1) for a name and a place: what an agent does, the same wherever it is asked.
pub(crate) fn draw(seed: u64, step: u64) -> f32 {
    let mut z = (seed << 32 | step).wrapping_add(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((z ^ (z >> 31)) >> 40) as f32 / (1u64 << 24) as f32
}
