//! Client of `/v1/sessions`, written from the documentation of its messages and frames.

use std::ops::{Deref, DerefMut};

use serde_json::{Value, json};
use system_tests::{ApiClient, TestSocket};

/// WebSocket to the route `/v1/sessions`.
pub(crate) struct SessionSocket(TestSocket);

impl Deref for SessionSocket {
    type Target = TestSocket;

    fn deref(&self) -> &TestSocket {
        &self.0
    }
}

impl DerefMut for SessionSocket {
    fn deref_mut(&mut self) -> &mut TestSocket {
        &mut self.0
    }
}

impl SessionSocket {
    pub(crate) async fn connect(api: &ApiClient) -> Self {
        Self(TestSocket::connect(api, "/v1/sessions").await)
    }

    /// Connects and opens a session; returns the `opened` message.
    pub(crate) async fn open(api: &ApiClient, options: Value) -> (Self, Value) {
        let mut socket = Self::connect(api).await;
        let opened = socket.request(&open_message(options)).await;
        assert_eq!(opened["type"], "opened", "{opened}");
        (socket, opened)
    }

    /// Connects and requests the session of an `opened` message; returns the reply.
    pub(crate) async fn resume(api: &ApiClient, opened: &Value) -> (Self, Value) {
        let mut socket = Self::connect(api).await;
        let reply = socket.request(&json!({"type": "resume", "session": opened["session"]})).await;
        (socket, reply)
    }

    /// Sends a step and returns the reply.
    pub(crate) async fn step(&mut self, id: u64, action: &Value) -> Value {
        self.request(&json!({"type": "step", "id": id, "action": action})).await
    }

    /// Resets the TCP connection without a close frame.
    pub(crate) fn abort(self) {
        self.0.abort();
    }

    /// Sends a close frame.
    pub(crate) async fn close(self) {
        self.0.close().await;
    }
}

/// Builds an `open` message with these options.
pub(crate) fn open_message(mut options: Value) -> Value {
    options["type"] = json!("open");
    options["version"] = json!(2);
    options
}

/// WebSocket session with many environments.
pub(crate) struct VectorSession {
    pub(crate) socket: SessionSocket,
    pub(crate) opened: Value,
    pub(crate) sequence: u32,
}

/// Decoded step frame; `opened` describes its layout.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct StepFrame {
    pub(crate) sequence: u32,
    pub(crate) observations: Vec<f32>,
    pub(crate) rewards: Vec<f32>,
    pub(crate) team_rewards: Vec<f32>,
    pub(crate) elapsed: Vec<f32>,
    pub(crate) episodes: Vec<i32>,
    pub(crate) terminated: Vec<u8>,
    pub(crate) truncated: Vec<u8>,
    pub(crate) needs_action: Vec<u8>,
    pub(crate) flags: Vec<u8>,
    pub(crate) final_observations: Vec<f32>,
}

pub(crate) fn frame_header(kind: u16, sequence: u32, envs: u32) -> Vec<u8> {
    let mut bytes = b"SPVF".to_vec();
    bytes.extend(2u16.to_le_bytes());
    bytes.extend(kind.to_le_bytes());
    bytes.extend(sequence.to_le_bytes());
    bytes.extend(envs.to_le_bytes());
    bytes
}

impl VectorSession {
    /// Opens a vector session and decodes its first step frame.
    pub(crate) async fn open(api: &ApiClient, options: Value) -> (Self, StepFrame) {
        let (mut socket, opened) = SessionSocket::open(api, options).await;
        let frame = socket.receive_bytes().await;
        let vector = Self { socket, opened, sequence: 0 };
        let first = vector.decode(&frame);
        (vector, first)
    }

    pub(crate) fn opened_number(&self, name: &str) -> usize {
        self.opened[name].as_u64().unwrap() as usize
    }

    pub(crate) fn action_frame(&self, sequence: u32, actions: &[f32]) -> Vec<u8> {
        let mut bytes = frame_header(1, sequence, self.opened_number("envs") as u32);
        bytes.extend(actions.iter().flat_map(|action| action.to_le_bytes()));
        bytes
    }

    /// Number of values that a frame of actions has.
    pub(crate) fn action_len(&self) -> usize {
        self.opened_number("envs") * self.opened_number("agents") * self.opened_number("action")
    }

    pub(crate) async fn step(&mut self, actions: &[f32]) -> StepFrame {
        self.sequence += 1;
        let frame = self.action_frame(self.sequence, actions);
        self.socket.send_bytes(&frame).await;
        let frame = self.socket.receive_bytes().await;
        self.decode(&frame)
    }

    pub(crate) async fn reset(&mut self, mask: &[u8]) -> StepFrame {
        self.sequence += 1;
        let mut frame = frame_header(3, self.sequence, self.opened_number("envs") as u32);
        frame.extend(mask);
        frame.resize(frame.len().div_ceil(4) * 4, 0);
        self.socket.send_bytes(&frame).await;
        let frame = self.socket.receive_bytes().await;
        self.decode(&frame)
    }

    pub(crate) fn decode(&self, frame: &[u8]) -> StepFrame {
        let layout = &self.opened["frames"]["stepped"];
        let sequence = u32::from_le_bytes(frame[8..12].try_into().unwrap());
        assert_eq!(frame[..8], frame_header(2, 0, 0)[..8]);
        assert_eq!(frame[12..16], (self.opened_number("envs") as u32).to_le_bytes());
        let bytes = |name: &str| -> Vec<u8> {
            let fields = layout["fields"].as_array().unwrap();
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
        let final_observations = floats("final_observations");
        assert_eq!(frame.len(), layout["bytes"].as_u64().unwrap() as usize + final_observations.len() * 4);
        StepFrame {
            sequence,
            observations: floats("observations"),
            rewards: floats("rewards"),
            team_rewards: floats("team_rewards"),
            elapsed: floats("elapsed"),
            episodes: bytes("episodes").as_chunks::<4>().0.iter().map(|c| i32::from_le_bytes(*c)).collect(),
            terminated: bytes("terminated"),
            truncated: bytes("truncated"),
            needs_action: bytes("needs_action"),
            flags: bytes("flags"),
            final_observations,
        }
    }
}

/// Returns a number in [0, 1) that depends on the seed and the step only.
pub(crate) fn uniform(seed: u64, step: u64) -> f32 {
    let mut z = (seed << 32 | step).wrapping_add(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((z ^ (z >> 31)) >> 40) as f32 / (1u64 << 24) as f32
}
