//! The binary frames of a vector session, byte by byte. docs/reference/stepping.md has the table. A change of any byte needs a new
//! [`FRAME_VERSION`].
//!
//! All numbers are little-endian. A frame begins with a header of sixteen bytes: the magic `SPVF`, the version (u16), the
//! kind (u16), the sequence number (u32), the number of environments (u32). Every later field begins at a multiple of four
//! bytes.

use serde_json::{Value, json};

/// Version of the frames, and of the text messages around them.
pub const FRAME_VERSION: u16 = 2;
/// First bytes of every frame.
pub const MAGIC: [u8; 4] = *b"SPVF";
/// Size of the header in bytes.
pub const HEADER_BYTES: usize = 16;
/// Maximum size of a reply frame in bytes.
pub const MAX_REPLY_BYTES: usize = 64 << 20;
/// Maximum size of a client's frame in bytes.
pub const MAX_REQUEST_BYTES: usize = 16 << 20;

/// Kind of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub enum FrameKind {
    /// From the client: the action of every agent.
    Actions = 1,
    /// From the server: the result of a step or a reset.
    Stepped = 2,
    /// From the client: the environments to reset.
    Reset = 3,
}

/// Valid frame of a client.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ClientFrame<'a> {
    /// Sequence number of the frame.
    pub sequence: u32,
    /// Command with its data.
    pub command: FrameCommand<'a>,
}

/// Command of a client.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameCommand<'a> {
    /// Steps all environments; `envs × agents × action` numbers of four bytes.
    Step(&'a [u8]),
    /// Resets the environments whose byte is not 0.
    Reset(&'a [u8]),
}

/// Error of bytes that are not a frame of the session.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{field}: {reason}")]
pub struct FrameError {
    /// Field of the frame that is invalid.
    pub field: &'static str,
    /// Reason why the field is rejected.
    pub reason: String,
}

/// Sizes of a session's frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameLayout {
    /// Number of environments in the session.
    pub envs: usize,
    /// Number of agents in each environment.
    pub agents: usize,
    /// Number of values in one agent's action.
    pub action: usize,
    /// Number of values in one environment's observation.
    pub observation: usize,
    /// True if replies have the index of each environment's episode in the lease.
    pub is_leased: bool,
    /// True if replies end with the last observations of the episodes that ended, one row each.
    pub has_finals: bool,
}

/// Field of a frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FrameField {
    /// Name of the field.
    pub name: &'static str,
    /// Offset of the field in bytes.
    pub offset: usize,
    /// Type of the values in numpy's notation.
    pub dtype: &'static str,
    /// Length of each dimension; `None` for as many rows as episodes ended.
    pub shape: Vec<Option<usize>>,
}

impl FrameField {
    /// Describes the field for clients.
    fn describe(&self) -> Value {
        let shape: Vec<Value> =
            self.shape.iter().map(|length| length.map_or_else(|| json!("done"), Value::from)).collect();
        json!({"name": self.name, "offset": self.offset, "dtype": self.dtype, "shape": shape})
    }
}

/// Rounds up to a multiple of four bytes.
pub(super) const fn padded(bytes: usize) -> usize {
    bytes.div_ceil(4) * 4
}

/// Returns the size of one value in bytes.
fn value_bytes(dtype: &str) -> usize {
    if dtype == "|u1" { 1 } else { 4 }
}

impl FrameLayout {
    /// Returns the size of a frame of actions in bytes.
    #[must_use]
    pub const fn actions_bytes(&self) -> usize {
        HEADER_BYTES + self.envs * self.agents * self.action * 4
    }

    /// Returns the size of a reset frame in bytes.
    #[must_use]
    pub const fn reset_bytes(&self) -> usize {
        HEADER_BYTES + padded(self.envs)
    }

    /// Returns the size of a reply without final observations in bytes.
    #[must_use]
    pub fn reply_bytes(&self) -> usize {
        let end = |field: &FrameField| {
            let values: usize = field.shape.iter().map(|length| length.unwrap_or(0)).product();
            field.offset + padded(values * value_bytes(field.dtype))
        };
        self.reply_fields().iter().map(end).max().unwrap_or(HEADER_BYTES)
    }

    /// Returns the size of the largest reply in bytes.
    #[must_use]
    pub fn max_reply_bytes(&self) -> usize {
        self.reply_bytes() + if self.has_finals { self.envs * self.observation * 4 } else { 0 }
    }

    /// Returns the fields of a reply after its header, in order.
    #[must_use]
    pub fn reply_fields(&self) -> Vec<FrameField> {
        let Self { envs, agents, observation, .. } = *self;
        let mut fields = Vec::new();
        let mut offset = HEADER_BYTES;
        let mut push = |name, dtype, shape: &[usize]| {
            let values: usize = shape.iter().product();
            let shape = shape.iter().map(|&length| Some(length)).collect();
            fields.push(FrameField { name, offset, dtype, shape });
            offset += padded(values * value_bytes(dtype));
        };
        push("observations", "<f4", &[envs, observation]);
        push("rewards", "<f4", &[envs, agents]);
        push("team_rewards", "<f4", &[envs]);
        push("elapsed", "<f4", &[envs]);
        if self.is_leased {
            push("episodes", "<i4", &[envs]);
        }
        push("terminated", "|u1", &[envs, agents]);
        push("truncated", "|u1", &[envs, agents]);
        push("needs_action", "|u1", &[envs, agents]);
        push("flags", "|u1", &[envs]);
        if self.has_finals {
            let shape = vec![None, Some(observation)];
            fields.push(FrameField { name: "final_observations", offset, dtype: "<f4", shape });
        }
        fields
    }

    /// Describes all frames of the session for clients.
    #[must_use]
    pub fn describe(&self) -> Value {
        let Self { envs, agents, action, .. } = *self;
        let header = json!([
            {"name": "magic", "offset": 0, "dtype": "|S4", "shape": []},
            {"name": "version", "offset": 4, "dtype": "<u2", "shape": []},
            {"name": "kind", "offset": 6, "dtype": "<u2", "shape": []},
            {"name": "sequence", "offset": 8, "dtype": "<u4", "shape": []},
            {"name": "envs", "offset": 12, "dtype": "<u4", "shape": []},
        ]);
        let offset = HEADER_BYTES;
        let shape = vec![Some(envs), Some(agents), Some(action)];
        let actions = FrameField { name: "actions", offset, dtype: "<f4", shape };
        let mask = FrameField { name: "mask", offset, dtype: "|u1", shape: vec![Some(envs)] };
        let fields: Vec<Value> = self.reply_fields().iter().map(FrameField::describe).collect();
        json!({
            "header": header,
            "actions": {
                "kind": FrameKind::Actions as u16,
                "bytes": self.actions_bytes(),
                "fields": [actions.describe()],
            },
            "reset": {"kind": FrameKind::Reset as u16, "bytes": self.reset_bytes(), "fields": [mask.describe()]},
            "stepped": {"kind": FrameKind::Stepped as u16, "bytes": self.reply_bytes(), "fields": fields},
        })
    }

    /// Parses a client's frame.
    ///
    /// # Errors
    /// Returns the first field of the frame that is invalid.
    pub fn parse<'a>(&self, bytes: &'a [u8]) -> Result<ClientFrame<'a>, FrameError> {
        let wrong = |field, reason| Err(FrameError { field, reason });
        let Some((header, body)) = bytes.split_first_chunk::<HEADER_BYTES>() else {
            let reason =
                format!("must be at least {HEADER_BYTES} bytes, the size of the header, got {}", bytes.len());
            return wrong("length", reason);
        };
        let [m0, m1, m2, m3, v0, v1, k0, k1, s0, s1, s2, s3, n0, n1, n2, n3] = *header;
        if [m0, m1, m2, m3] != MAGIC {
            return wrong("magic", "must be SPVF".to_owned());
        }
        let version = u16::from_le_bytes([v0, v1]);
        if version != FRAME_VERSION {
            return wrong("version", format!("must be {FRAME_VERSION}, got {version}"));
        }
        let kind = u16::from_le_bytes([k0, k1]);
        let envs = u32::from_le_bytes([n0, n1, n2, n3]);
        if envs as usize != self.envs {
            return wrong(
                "envs",
                format!("must be {}, the environments of the session, got {envs}", self.envs),
            );
        }
        let (command, length) = match kind {
            1 => (FrameCommand::Step(body), self.actions_bytes()),
            3 => (FrameCommand::Reset(body.get(..self.envs).unwrap_or_default()), self.reset_bytes()),
            _ => return wrong("kind", format!("must be 1 (actions) or 3 (reset), got {kind}")),
        };
        if bytes.len() != length {
            return wrong(
                "length",
                format!("must be {length} bytes for this kind of frame, got {}", bytes.len()),
            );
        }
        Ok(ClientFrame { sequence: u32::from_le_bytes([s0, s1, s2, s3]), command })
    }

    /// Returns the header of a reply.
    pub(super) fn reply_header(&self, sequence: u32) -> [u8; HEADER_BYTES] {
        let mut header = [0; HEADER_BYTES];
        header[..4].copy_from_slice(&MAGIC);
        header[4..6].copy_from_slice(&FRAME_VERSION.to_le_bytes());
        header[6..8].copy_from_slice(&(FrameKind::Stepped as u16).to_le_bytes());
        header[8..12].copy_from_slice(&sequence.to_le_bytes());
        header[12..16].copy_from_slice(&u32::try_from(self.envs).unwrap_or(u32::MAX).to_le_bytes());
        header
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const LAYOUT: FrameLayout =
        FrameLayout { envs: 3, agents: 3, action: 2, observation: 5, is_leased: true, has_finals: true };

    fn frame(kind: u16, sequence: u32, body: usize) -> Vec<u8> {
        let mut bytes = LAYOUT.reply_header(sequence).to_vec();
        bytes[6..8].copy_from_slice(&kind.to_le_bytes());
        bytes.resize(HEADER_BYTES + body, 0);
        bytes
    }

    #[test]
    fn reply_fields_are_aligned_to_four_bytes() {
        let fields = LAYOUT.reply_fields();
        let offsets: Vec<_> = fields.iter().map(|field| (field.name, field.offset)).collect();
        let expected = [
            ("observations", 16),
            ("rewards", 76),
            ("team_rewards", 112),
            ("elapsed", 124),
            ("episodes", 136),
            ("terminated", 148),
            ("truncated", 160),
            ("needs_action", 172),
            ("flags", 184),
            ("final_observations", 188),
        ];
        assert_eq!(offsets, expected);
        assert_eq!((LAYOUT.reply_bytes(), LAYOUT.max_reply_bytes()), (188, 248));
        assert_eq!(LAYOUT.actions_bytes(), 16 + 72);
    }

    #[test]
    fn invalid_frames_name_the_field() {
        let good = frame(1, 9, 72);
        let step = ClientFrame { sequence: 9, command: FrameCommand::Step(&[0; 72]) };
        assert_eq!(LAYOUT.parse(&good).unwrap(), step);
        let reset = ClientFrame { sequence: 7, command: FrameCommand::Reset(&[0; 3]) };
        assert_eq!(LAYOUT.parse(&frame(3, 7, 4)).unwrap(), reset);
        let field = |bytes: &[u8]| LAYOUT.parse(bytes).unwrap_err().field;
        let with = |at: usize, byte: u8| {
            let mut bytes = good.clone();
            bytes[at] = byte;
            bytes
        };
        assert_eq!(field(&[]), "length");
        assert_eq!(field(&good[..15]), "length");
        assert_eq!(field(&good[..87]), "length");
        assert_eq!(field(&frame(1, 1, 73)), "length");
        assert_eq!(field(&frame(3, 1, 3)), "length");
        assert_eq!(field(&with(0, b'X')), "magic");
        assert_eq!(field(&with(4, 1)), "version");
        assert_eq!(field(&with(6, 2)), "kind");
        assert_eq!(field(&with(12, 4)), "envs");
    }

    proptest! {
        /// Any bytes are parsed or rejected, and a parsed frame has the length of its kind.
        #[test]
        fn any_bytes_are_parsed_or_rejected(
            mut bytes in proptest::collection::vec(any::<u8>(), 0..200),
            is_near_valid: bool,
        ) {
            if is_near_valid && bytes.len() >= HEADER_BYTES {
                let mut header = LAYOUT.reply_header(5);
                header[6] = bytes[6] % 5; // the kind
                bytes[..HEADER_BYTES].copy_from_slice(&header);
                bytes.resize(if bytes[HEADER_BYTES - 1] % 2 == 0 { 88 } else { 20 }, 0);
            }
            match LAYOUT.parse(&bytes) {
                Ok(ClientFrame { command: FrameCommand::Step(body), .. }) => prop_assert_eq!(body.len(), 72),
                Ok(ClientFrame { command: FrameCommand::Reset(body), .. }) => prop_assert_eq!(body.len(), 3),
                Err(error) => prop_assert!(["length", "magic", "version", "envs", "kind"].contains(&error.field)),
            }
        }
    }
}
