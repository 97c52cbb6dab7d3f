//! Action logs: what every agent did, step by step; with the scenario, the whole truth about an episode.

use crate::error::{LogError, StepError};

/// The actions of one step: any number of entries, each for one agent. An agent without an entry goes on as it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointAction<'a> {
    /// Whose action each entry is.
    pub agents: &'a [u32],
    /// The values of the entries, one after the other; the action space says how many each has.
    pub values: &'a [f64],
}

impl JointAction<'_> {
    /// Nobody does anything new.
    pub const HOLD: JointAction<'static> = JointAction { agents: &[], values: &[] };

    /// What any world asks of an action with `dim` values an entry: not too many entries, each of an agent below
    /// `agents` (where there is such a bound), all finite.
    pub(crate) fn check(&self, dim: usize, agents: Option<usize>) -> Result<(), StepError> {
        let entries = self.agents.len();
        if entries > MAX_ENTRIES {
            return Err(StepError::TooMany { count: entries, max: MAX_ENTRIES });
        }
        if self.values.len() != dim * entries {
            return Err(StepError::Shape { values: self.values.len(), entries, dim });
        }
        for (&agent, values) in self.agents.iter().zip(self.values.chunks_exact(dim)) {
            if let Some(agents) = agents.filter(|&agents| agent as usize >= agents) {
                return Err(StepError::UnknownAgent { agent, last: agents as u32 - 1 });
            }
            if !values.iter().all(|value| value.is_finite()) {
                return Err(StepError::NotFinite { agent });
            }
        }
        Ok(())
    }
}

/// Why a log is shorter than its episode, where that was the agent's doing. The rest is flown as hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stopped {
    /// The agent's answer could not be parsed.
    Unparsable,
    /// The agent's answer, or the conversation, was too long.
    TooLong,
    /// The agent's answer came too late.
    TooLate,
}

impl Stopped {
    /// The word on the wire.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Unparsable => "unparsable",
            Self::TooLong => "too_long",
            Self::TooLate => "too_late",
        }
    }

    /// Reads the word on the wire.
    #[must_use]
    pub fn from_word(word: &str) -> Option<Self> {
        [Self::Unparsable, Self::TooLong, Self::TooLate].into_iter().find(|s| s.word() == word)
    }
}

/// The precision the actions were taken in. A log that says `F32` holds values that are exact in f32.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Precision {
    /// Single.
    F32,
    /// Double.
    F64,
}

/// What every agent did, step by step.
#[derive(Debug, Clone, PartialEq)]
pub struct ActionLog {
    dim: usize,
    precision: Precision,
    /// Where each step's entries end in `agents`.
    ends: Vec<u32>,
    agents: Vec<u32>,
    values: Vec<f64>,
    /// Why the log stops early, if it does.
    pub stopped: Option<Stopped>,
}

/// Most steps any log may have.
pub const MAX_STEPS: usize = 100_000;
/// Most entries one step may have: far more than any task has agents, enough for clients that split their burns.
pub const MAX_ENTRIES: usize = 64;
const MAX_DIM: usize = 16;
const CODEC: u8 = 1;

impl ActionLog {
    /// An empty log of actions with `dim` values each.
    #[must_use]
    pub const fn new(dim: usize, precision: Precision) -> Self {
        Self { dim, precision, ends: Vec::new(), agents: Vec::new(), values: Vec::new(), stopped: None }
    }

    /// How many values an action has.
    #[must_use]
    pub const fn dim(&self) -> usize {
        self.dim
    }

    /// The precision the actions were taken in.
    #[must_use]
    pub const fn precision(&self) -> Precision {
        self.precision
    }

    /// How many steps the log has.
    #[must_use]
    pub fn len(&self) -> usize {
        self.ends.len()
    }

    /// Whether it has no steps.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.ends.is_empty()
    }

    /// Appends one entry to the step being written; [`ActionLog::end_step`] closes it. Values past `dim` are dropped,
    /// missing ones are zero.
    pub fn act(&mut self, agent: u32, values: &[f64]) {
        self.agents.push(agent);
        for i in 0..self.dim {
            let value = values.get(i).copied().unwrap_or(0.0);
            self.values.push(match self.precision {
                Precision::F64 => value,
                Precision::F32 => f64::from(to_f32(value)),
            });
        }
    }

    /// Closes the step being written.
    pub fn end_step(&mut self) {
        self.ends.push(u32::try_from(self.agents.len()).unwrap_or(u32::MAX));
    }

    /// Drops from the last step, which is closed, what agents from this number on did: where they are to be ignored and
    /// are no error.
    pub fn keep_agents(&mut self, agents: u32) {
        let Some((&end, before)) = self.ends.split_last() else { return };
        let start = before.last().map_or(0, |&end| end as usize);
        let mut kept = start;
        for i in start..end as usize {
            if self.agents[i] < agents {
                self.agents[kept] = self.agents[i];
                self.values.copy_within(i * self.dim..(i + 1) * self.dim, kept * self.dim);
                kept += 1;
            }
        }
        self.agents.truncate(kept);
        self.values.truncate(kept * self.dim);
        if let Some(end) = self.ends.last_mut() {
            *end = kept as u32;
        }
    }

    /// Appends a whole step.
    pub fn push(&mut self, action: JointAction<'_>) {
        for (i, &agent) in action.agents.iter().enumerate() {
            let values = action.values.get(i * self.dim..(i + 1) * self.dim).unwrap_or(&[]);
            self.act(agent, values);
        }
        self.end_step();
    }

    /// Forgets all but the first `steps` steps.
    pub fn truncate(&mut self, steps: usize) {
        self.ends.truncate(steps);
        let entries = self.ends.last().map_or(0, |end| *end as usize);
        self.agents.truncate(entries);
        self.values.truncate(entries * self.dim);
    }

    /// The actions of step `index`, counted from 0; nobody acts in a step the log does not have.
    #[must_use]
    pub fn step(&self, index: usize) -> JointAction<'_> {
        let Some(&end) = self.ends.get(index) else { return JointAction::HOLD };
        let start = if index == 0 { 0 } else { self.ends[index - 1] as usize };
        JointAction {
            agents: &self.agents[start..end as usize],
            values: &self.values[start * self.dim..end as usize * self.dim],
        }
    }

    /// All steps in order.
    pub fn steps(&self) -> impl Iterator<Item = JointAction<'_>> {
        (0..self.len()).map(|i| self.step(i))
    }

    /// The binary form in which logs are stored: codec 1.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let mut out = Vec::with_capacity(8 + self.ends.len() + self.values.len() * 8);
        let stopped = self.stopped.map_or(0, |s| s as u8 + 1);
        out.extend_from_slice(&[CODEC, self.dim as u8, u8::from(self.precision == Precision::F64), stopped]);
        out.extend_from_slice(&(self.ends.len() as u32).to_le_bytes());
        for step in self.steps() {
            out.push(step.agents.len() as u8);
            for (i, agent) in step.agents.iter().enumerate() {
                out.extend_from_slice(&agent.to_le_bytes());
                for value in &step.values[i * self.dim..(i + 1) * self.dim] {
                    match self.precision {
                        Precision::F64 => out.extend_from_slice(&value.to_le_bytes()),
                        Precision::F32 => out.extend_from_slice(&to_f32(*value).to_le_bytes()),
                    }
                }
            }
        }
        out
    }

    /// Reads the binary form.
    ///
    /// # Errors
    /// Bytes that are not a log of codec 1.
    pub fn decode(bytes: &[u8]) -> Result<Self, LogError> {
        let mut reader = Reader(bytes);
        let [codec, dim, precision, stopped] = reader.take::<4>()?;
        let precision = match (codec, precision) {
            (CODEC, 0) => Precision::F32,
            (CODEC, 1) => Precision::F64,
            _ => {
                return Err(LogError::malformed(
                    "codec",
                    format!("{codec}.{precision} is unknown; 1 is read"),
                ));
            }
        };
        if dim as usize > MAX_DIM {
            return Err(LogError::malformed("dim", format!("{dim}; at most {MAX_DIM}")));
        }
        let mut log = Self::new(dim as usize, precision);
        log.stopped = match stopped {
            0 => None,
            1 => Some(Stopped::Unparsable),
            2 => Some(Stopped::TooLong),
            3 => Some(Stopped::TooLate),
            other => return Err(LogError::malformed("stopped", format!("{other} is unknown"))),
        };
        let steps = u32::from_le_bytes(reader.take()?) as usize;
        if steps > MAX_STEPS {
            return Err(LogError::malformed("steps", format!("{steps}; at most {MAX_STEPS}")));
        }
        let mut values = [0.0; MAX_DIM];
        for _ in 0..steps {
            let [entries] = reader.take::<1>()?;
            for _ in 0..entries {
                let agent = u32::from_le_bytes(reader.take()?);
                for value in &mut values[..log.dim] {
                    *value = match precision {
                        Precision::F64 => f64::from_le_bytes(reader.take()?),
                        Precision::F32 => f64::from(f32::from_le_bytes(reader.take()?)),
                    };
                }
                log.act(agent, &values[..log.dim]);
            }
            log.end_step();
        }
        if reader.0.is_empty() { Ok(log) } else { Err(LogError::malformed("log", "bytes follow its end")) }
    }
}

#[expect(clippy::cast_possible_truncation, reason = "rounding to single precision is what is wanted")]
const fn to_f32(value: f64) -> f32 {
    value as f32
}

struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], LogError> {
        match self.0.split_first_chunk::<N>() {
            Some((head, rest)) => {
                self.0 = rest;
                Ok(*head)
            }
            None => Err(LogError::malformed("log", "it ends too early")),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn encoded_logs_read_back(
            steps in proptest::collection::vec(proptest::collection::vec((0u32..9, -2.0..2.0f64, -2.0..2.0f64), 0..5), 0..60),
            single: bool,
            stopped in 0u8..4,
        ) {
            let mut log = ActionLog::new(2, if single { Precision::F32 } else { Precision::F64 });
            for step in &steps {
                step.iter().for_each(|&(agent, x, y)| log.act(agent, &[x, y]));
                log.end_step();
            }
            log.stopped = [None, Some(Stopped::Unparsable), Some(Stopped::TooLong), Some(Stopped::TooLate)][stopped as usize];
            prop_assert_eq!(ActionLog::decode(&log.encode()).unwrap(), log);
        }

        #[test]
        fn strange_bytes_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
            let _ = ActionLog::decode(&bytes);
            let mut near = vec![1, 2, 1, 0, 3, 0, 0, 0];
            near.extend(bytes);
            let _ = ActionLog::decode(&near);
        }
    }
}
