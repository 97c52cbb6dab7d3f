//! The binary frames of a vector session, byte by byte. docs/stepping.md has the table; whoever changes a byte changes
//! [`VERSION`].
//!
//! All numbers are little-endian. A frame begins with sixteen bytes: the magic `SPVF`, the version (u16), the kind (u16),
//! the sequence number (u32), the number of environments (u32). Every field after it begins at a multiple of four bytes.

use serde_json::{Value, json};

/// The version of the layout, and of the messages in text around it.
pub const VERSION: u16 = 1;
/// The first bytes of every frame.
pub const MAGIC: [u8; 4] = *b"SPVF";
/// Bytes of a frame's beginning.
pub const HEADER: usize = 16;
/// Largest frame that is sent, bytes.
pub const MAX_OUT: usize = 64 << 20;
/// Largest frame that is read, bytes.
pub const MAX_IN: usize = 16 << 20;

/// What a frame is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub enum Kind {
    /// From the client: an action of every agent.
    Actions = 1,
    /// From the server: what came of it.
    Stepped = 2,
    /// From the client: which environments begin anew.
    Reset = 3,
}

/// A frame that a client sent, checked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Command<'a> {
    /// Its number.
    pub sequence: u32,
    /// What is asked for.
    pub what: What<'a>,
}

/// What is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum What<'a> {
    /// A step: `envs × agents × action` numbers of four bytes.
    Act(&'a [u8]),
    /// A reset of the environments whose byte is not 0.
    Reset(&'a [u8]),
}

/// A frame that is none.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{field}: {reason}")]
pub struct FrameError {
    /// The field at fault.
    pub field: &'static str,
    /// What is wrong.
    pub reason: String,
}

/// Sizes of a session's frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Environments.
    pub envs: usize,
    /// Agents of each.
    pub agents: usize,
    /// Values of one agent's action.
    pub action: usize,
    /// Values of one environment's observation.
    pub observation: usize,
    /// Whether a lease is flown: frames say which episode each environment flies.
    pub leased: bool,
    /// Whether the last observations of episodes that ended follow, one row for each.
    pub finals: bool,
}

/// A field of a frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Field {
    /// Its name.
    pub name: &'static str,
    /// Where it begins, bytes.
    pub offset: usize,
    /// What it is made of, as numpy writes it.
    pub dtype: &'static str,
    /// Its lengths; none where as many rows follow as episodes ended.
    pub shape: Vec<Option<usize>>,
}

impl Field {
    fn told(&self) -> Value {
        let shape: Vec<Value> =
            self.shape.iter().map(|length| length.map_or_else(|| json!("done"), Value::from)).collect();
        json!({"name": self.name, "offset": self.offset, "dtype": self.dtype, "shape": shape})
    }
}

/// The next multiple of four.
pub(super) const fn padded(bytes: usize) -> usize {
    bytes.div_ceil(4) * 4
}

impl Layout {
    /// Bytes of a frame of actions.
    #[must_use]
    pub const fn actions_bytes(&self) -> usize {
        HEADER + self.envs * self.agents * self.action * 4
    }

    /// Bytes of a frame that resets.
    #[must_use]
    pub const fn reset_bytes(&self) -> usize {
        HEADER + padded(self.envs)
    }

    /// Bytes of an answer, without the rows at its end.
    #[must_use]
    pub fn stepped_bytes(&self) -> usize {
        let whole = |field: &Field| {
            let cells: usize = field.shape.iter().map(|length| length.unwrap_or(0)).product();
            field.offset + padded(cells * if field.dtype == "|u1" { 1 } else { 4 })
        };
        self.stepped().iter().map(whole).max().unwrap_or(HEADER)
    }

    /// Bytes of the largest answer.
    #[must_use]
    pub fn most_bytes(&self) -> usize {
        self.stepped_bytes() + if self.finals { self.envs * self.observation * 4 } else { 0 }
    }

    /// The fields of an answer, in order.
    #[must_use]
    pub fn stepped(&self) -> Vec<Field> {
        let Self { envs, agents, observation, .. } = *self;
        let mut fields = Vec::new();
        let mut offset = HEADER;
        let mut put = |name, dtype, shape: &[usize]| {
            let cells: usize = shape.iter().product();
            fields.push(Field {
                name,
                offset,
                dtype,
                shape: shape.iter().map(|&length| Some(length)).collect(),
            });
            offset += padded(cells * if dtype == "|u1" { 1 } else { 4 });
        };
        put("observations", "<f4", &[envs, observation]);
        put("rewards", "<f4", &[envs, agents]);
        put("team_rewards", "<f4", &[envs]);
        if self.leased {
            put("episodes", "<i4", &[envs]);
        }
        put("terminated", "|u1", &[envs, agents]);
        put("truncated", "|u1", &[envs, agents]);
        put("flags", "|u1", &[envs]);
        if self.finals {
            let shape = vec![None, Some(observation)];
            fields.push(Field { name: "final_observations", offset, dtype: "<f4", shape });
        }
        fields
    }

    /// All that a client needs to know of the frames.
    #[must_use]
    pub fn told(&self) -> Value {
        let Self { envs, agents, action, .. } = *self;
        let head = json!([
            {"name": "magic", "offset": 0, "dtype": "|S4", "shape": []},
            {"name": "version", "offset": 4, "dtype": "<u2", "shape": []},
            {"name": "kind", "offset": 6, "dtype": "<u2", "shape": []},
            {"name": "sequence", "offset": 8, "dtype": "<u4", "shape": []},
            {"name": "envs", "offset": 12, "dtype": "<u4", "shape": []},
        ]);
        let actions = Field {
            name: "actions",
            offset: HEADER,
            dtype: "<f4",
            shape: vec![Some(envs), Some(agents), Some(action)],
        };
        let mask = Field { name: "mask", offset: HEADER, dtype: "|u1", shape: vec![Some(envs)] };
        let fields: Vec<Value> = self.stepped().iter().map(Field::told).collect();
        json!({
            "header": head,
            "actions": {"kind": Kind::Actions as u16, "bytes": self.actions_bytes(), "fields": [actions.told()]},
            "reset": {"kind": Kind::Reset as u16, "bytes": self.reset_bytes(), "fields": [mask.told()]},
            "stepped": {"kind": Kind::Stepped as u16, "bytes": self.stepped_bytes(), "fields": fields},
        })
    }

    /// Reads a client's frame.
    ///
    /// # Errors
    /// The field at fault.
    pub fn read<'a>(&self, bytes: &'a [u8]) -> Result<Command<'a>, FrameError> {
        let wrong = |field, reason| Err(FrameError { field, reason });
        let Some((head, body)) = bytes.split_first_chunk::<HEADER>() else {
            return wrong("length", format!("it is {}; a frame begins with {HEADER} bytes", bytes.len()));
        };
        let [m0, m1, m2, m3, v0, v1, k0, k1, s0, s1, s2, s3, n0, n1, n2, n3] = *head;
        if [m0, m1, m2, m3] != MAGIC {
            return wrong("magic", "a frame begins with SPVF".to_owned());
        }
        let version = u16::from_le_bytes([v0, v1]);
        if version != VERSION {
            return wrong("version", format!("it is {version}; {VERSION} is spoken here"));
        }
        let kind = u16::from_le_bytes([k0, k1]);
        let envs = u32::from_le_bytes([n0, n1, n2, n3]);
        if envs as usize != self.envs {
            return wrong("envs", format!("it is {envs}; the session has {}", self.envs));
        }
        let (what, length) = match kind {
            1 => (What::Act(body), self.actions_bytes()),
            3 => (What::Reset(body.get(..self.envs).unwrap_or_default()), self.reset_bytes()),
            _ => return wrong("kind", format!("it is {kind}; a client sends 1 (actions) or 3 (reset)")),
        };
        if bytes.len() != length {
            return wrong(
                "length",
                format!("it is {}; a frame of this kind has {length} bytes", bytes.len()),
            );
        }
        Ok(Command { sequence: u32::from_le_bytes([s0, s1, s2, s3]), what })
    }

    /// The beginning of an answer.
    pub(super) fn head(&self, sequence: u32) -> [u8; HEADER] {
        let mut head = [0; HEADER];
        head[..4].copy_from_slice(&MAGIC);
        head[4..6].copy_from_slice(&VERSION.to_le_bytes());
        head[6..8].copy_from_slice(&(Kind::Stepped as u16).to_le_bytes());
        head[8..12].copy_from_slice(&sequence.to_le_bytes());
        head[12..16].copy_from_slice(&u32::try_from(self.envs).unwrap_or(u32::MAX).to_le_bytes());
        head
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const LAYOUT: Layout =
        Layout { envs: 3, agents: 3, action: 2, observation: 5, leased: true, finals: true };

    fn frame(kind: u16, sequence: u32, body: usize) -> Vec<u8> {
        let mut bytes = LAYOUT.head(sequence).to_vec();
        bytes[6..8].copy_from_slice(&kind.to_le_bytes());
        bytes.resize(HEADER + body, 0);
        bytes
    }

    #[test]
    fn fields_follow_each_other_at_multiples_of_four() {
        let fields = LAYOUT.stepped();
        let places: Vec<_> = fields.iter().map(|field| (field.name, field.offset)).collect();
        let wanted = [
            ("observations", 16),
            ("rewards", 76),
            ("team_rewards", 112),
            ("episodes", 124),
            ("terminated", 136),
            ("truncated", 148),
            ("flags", 160),
            ("final_observations", 164),
        ];
        assert_eq!(places, wanted);
        assert_eq!((LAYOUT.stepped_bytes(), LAYOUT.most_bytes()), (164, 224));
        assert_eq!(LAYOUT.actions_bytes(), 16 + 72);
    }

    #[test]
    fn what_is_wrong_is_named() {
        let good = frame(1, 9, 72);
        assert_eq!(LAYOUT.read(&good).unwrap(), Command { sequence: 9, what: What::Act(&[0; 72]) });
        assert_eq!(
            LAYOUT.read(&frame(3, 7, 4)).unwrap(),
            Command { sequence: 7, what: What::Reset(&[0; 3]) }
        );
        let field = |bytes: &[u8]| LAYOUT.read(bytes).unwrap_err().field;
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
        assert_eq!(field(&with(4, 2)), "version");
        assert_eq!(field(&with(6, 2)), "kind");
        assert_eq!(field(&with(12, 4)), "envs");
    }

    proptest! {
        /// Whatever comes is read or refused, and what is read is as long as it must be.
        #[test]
        fn any_bytes_are_read_or_refused(mut bytes in proptest::collection::vec(any::<u8>(), 0..200), near: bool) {
            if near && bytes.len() >= HEADER {
                let mut head = LAYOUT.head(5);
                head[6] = bytes[6] % 5; // the kind
                bytes[..HEADER].copy_from_slice(&head);
                bytes.resize(if bytes[HEADER - 1] % 2 == 0 { 88 } else { 20 }, 0);
            }
            match LAYOUT.read(&bytes) {
                Ok(Command { what: What::Act(body), .. }) => prop_assert_eq!(body.len(), 72),
                Ok(Command { what: What::Reset(body), .. }) => prop_assert_eq!(body.len(), 3),
                Err(error) => prop_assert!(["length", "magic", "version", "envs", "kind"].contains(&error.field)),
            }
        }
    }
}
