//! Action logs: the actions of all agents, step by step. A scenario and a log determine an episode completely.

use crate::error::{LogError, StepError};
use crate::space::{ActionKind, ActionSpace};

/// Actions of one step: any number of entries, each for one agent. An agent without an entry holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointAction<'a> {
    /// Number of each entry's agent.
    pub agents: &'a [u32],
    /// Values of all entries, one after the other; the action space defines how many each has.
    pub values: &'a [f64],
}

impl JointAction<'_> {
    /// The action without entries: all agents hold.
    pub const HOLD: JointAction<'static> = JointAction { agents: &[], values: &[] };

    /// Values of the first `agents` agents, one after the other, with hold for those without an entry. Several entries of an agent
    /// are summed in a box; otherwise the last one counts.
    #[must_use]
    pub fn by_agent(&self, space: &ActionSpace, agents: usize) -> Vec<f64> {
        let dim = space.dim();
        let mut values = vec![f64::from(space.hold); agents * dim];
        for (&agent, entry) in self.agents.iter().zip(self.values.chunks_exact(dim.max(1))) {
            let Some(cells) = values.get_mut(agent as usize * dim..(agent as usize + 1) * dim) else {
                continue;
            };
            for (cell, value) in cells.iter_mut().zip(entry) {
                *cell = if space.kind == ActionKind::Box { *cell + value } else { *value };
            }
        }
        values
    }

    /// Checks an action with `dim` values per entry by the rules of all worlds: not too many entries, each of an agent below
    /// `agents` (if given), all values finite.
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

/// Reason why a log is shorter than its episode, if the agent caused it. The remaining steps are hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StopReason {
    /// A response of the agent could not be parsed.
    Unparsable,
    /// A response of the agent, or the conversation, was too long.
    TooLong,
    /// A response of the agent exceeded its time limit.
    TooLate,
}

impl StopReason {
    /// Name of the reason in JSON.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Unparsable => "unparsable",
            Self::TooLong => "too_long",
            Self::TooLate => "too_late",
        }
    }

    /// The reason with this name, or `None` if there is none.
    #[must_use]
    pub fn from_name(word: &str) -> Option<Self> {
        [Self::Unparsable, Self::TooLong, Self::TooLate].into_iter().find(|s| s.name() == word)
    }
}

/// Precision of a log's actions. The values of an `F32` log are exact in single precision.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Precision {
    /// Single precision, 32 bits.
    F32,
    /// Double precision, 64 bits.
    F64,
}

/// Actions of all agents, step by step.
#[derive(Debug, Clone, PartialEq)]
pub struct ActionLog {
    dim: usize,
    precision: Precision,
    /// End of each step's entries in `agents`.
    ends: Vec<u32>,
    agents: Vec<u32>,
    values: Vec<f64>,
    /// Reason why the log stops early, if it does.
    pub stopped: Option<StopReason>,
}

/// Largest number of steps of a log.
pub const MAX_LOG_STEPS: usize = 100_000;
/// Largest number of entries of a step: far more than any task has agents, enough for clients that split their burns.
pub const MAX_ENTRIES: usize = 64;
/// Largest number of values of an action.
const MAX_DIM: usize = 16;
/// Version of the binary form.
const CODEC: u8 = 1;

impl ActionLog {
    /// Creates an empty log of actions with `dim` values each.
    #[must_use]
    pub const fn new(dim: usize, precision: Precision) -> Self {
        Self { dim, precision, ends: Vec::new(), agents: Vec::new(), values: Vec::new(), stopped: None }
    }

    /// Number of values of an action.
    #[must_use]
    pub const fn dim(&self) -> usize {
        self.dim
    }

    /// Precision of the actions.
    #[must_use]
    pub const fn precision(&self) -> Precision {
        self.precision
    }

    /// Number of steps of the log.
    #[must_use]
    pub fn len(&self) -> usize {
        self.ends.len()
    }

    /// True if the log has no steps.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.ends.is_empty()
    }

    /// Appends an entry to the open step, which [`ActionLog::end_step`] closes. Values past `dim` are dropped; missing ones
    /// are zero.
    pub fn push_entry(&mut self, agent: u32, values: &[f64]) {
        self.agents.push(agent);
        for i in 0..self.dim {
            let value = values.get(i).copied().unwrap_or(0.0);
            self.values.push(match self.precision {
                Precision::F64 => value,
                Precision::F32 => f64::from(to_f32(value)),
            });
        }
    }

    /// Closes the open step.
    pub fn end_step(&mut self) {
        self.ends.push(u32::try_from(self.agents.len()).unwrap_or(u32::MAX));
    }

    /// Drops the entries of agents from this number on from the last closed step, to ignore them instead of rejecting them.
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

    /// Appends a complete step.
    pub fn push_step(&mut self, action: JointAction<'_>) {
        for (i, &agent) in action.agents.iter().enumerate() {
            let values = action.values.get(i * self.dim..(i + 1) * self.dim).unwrap_or(&[]);
            self.push_entry(agent, values);
        }
        self.end_step();
    }

    /// Appends a complete step from the values of all agents, one after the other. Agents that hold have no entry.
    pub fn push_by_agent<T: Copy + Into<f64>>(&mut self, space: &ActionSpace, values: &[T]) {
        let hold = f64::from(space.hold);
        for (agent, action) in (0u32..).zip(values.chunks_exact(self.dim.max(1))) {
            if action.iter().any(|value| (*value).into() != hold) {
                let mut entry = [0.0; MAX_DIM];
                entry.iter_mut().zip(action).for_each(|(cell, value)| *cell = (*value).into());
                self.push_entry(agent, &entry);
            }
        }
        self.end_step();
    }

    /// Removes all but the first `steps` steps.
    pub fn truncate(&mut self, steps: usize) {
        self.ends.truncate(steps);
        let entries = self.ends.last().map_or(0, |end| *end as usize);
        self.agents.truncate(entries);
        self.values.truncate(entries * self.dim);
    }

    /// Actions of the step `index`, counted from 0; hold if the log does not have that step.
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

    /// Encodes the log in the binary form in which logs are stored (codec 1).
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

    /// Decodes the binary form.
    ///
    /// # Errors
    /// Returns [`LogError::Malformed`] if the bytes are not a log of codec 1.
    pub fn decode(bytes: &[u8]) -> Result<Self, LogError> {
        let mut reader = Reader(bytes);
        let [codec, dim, precision, stopped] = reader.take::<4>()?;
        let precision = match (codec, precision) {
            (CODEC, 0) => Precision::F32,
            (CODEC, 1) => Precision::F64,
            _ => {
                return Err(LogError::malformed(
                    "codec",
                    format!("unknown codec {codec} with precision {precision}; the known codec is {CODEC}"),
                ));
            }
        };
        if dim as usize > MAX_DIM {
            return Err(LogError::malformed("dim", format!("must be at most {MAX_DIM}, got {dim}")));
        }
        let mut log = Self::new(dim as usize, precision);
        log.stopped = match stopped {
            0 => None,
            1 => Some(StopReason::Unparsable),
            2 => Some(StopReason::TooLong),
            3 => Some(StopReason::TooLate),
            other => return Err(LogError::malformed("stopped", format!("unknown stop reason {other}"))),
        };
        let steps = u32::from_le_bytes(reader.take()?) as usize;
        if steps > MAX_LOG_STEPS {
            return Err(LogError::malformed(
                "steps",
                format!("must be at most {MAX_LOG_STEPS}, got {steps}"),
            ));
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
                log.push_entry(agent, &values[..log.dim]);
            }
            log.end_step();
        }
        if reader.0.is_empty() { Ok(log) } else { Err(LogError::malformed("log", "has bytes after its end")) }
    }
}

#[expect(clippy::cast_possible_truncation, reason = "rounding to single precision is what is wanted")]
const fn to_f32(value: f64) -> f32 {
    value as f32
}

/// Reader of the binary form.
struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], LogError> {
        match self.0.split_first_chunk::<N>() {
            Some((head, rest)) => {
                self.0 = rest;
                Ok(*head)
            }
            None => Err(LogError::malformed("log", "ends too early")),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn encoded_logs_decode_to_themselves(
            steps in proptest::collection::vec(proptest::collection::vec((0u32..9, -2.0..2.0f64, -2.0..2.0f64), 0..5), 0..60),
            single: bool,
            stopped in 0u8..4,
        ) {
            let mut log = ActionLog::new(2, if single { Precision::F32 } else { Precision::F64 });
            for step in &steps {
                step.iter().for_each(|&(agent, x, y)| log.push_entry(agent, &[x, y]));
                log.end_step();
            }
            log.stopped = [None, Some(StopReason::Unparsable), Some(StopReason::TooLong), Some(StopReason::TooLate)][stopped as usize];
            prop_assert_eq!(ActionLog::decode(&log.encode()).unwrap(), log);
        }

        #[test]
        fn arbitrary_bytes_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
            let _ = ActionLog::decode(&bytes);
            let mut near = vec![1, 2, 1, 0, 3, 0, 0, 0];
            near.extend(bytes);
            let _ = ActionLog::decode(&near);
        }
    }
}
