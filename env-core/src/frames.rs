//! Frames of an episode: its replay, step by step, as JSON.

use std::io;

use crate::task::{Episode, StepReport};
use crate::{ActionLog, JointAction, Scenario, ScenarioError, StepError};
use serde_json::{Value, json};

/// Largest size of the frames of one episode as JSON, bytes: as large as a request may be.
pub const MAX_FRAME_BYTES: usize = 16 << 20;

/// Content of a frame beside actions, reward and the whole state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameContent {
    /// Nothing beside these three.
    State,
    /// The `observation` that the agents received.
    Telemetry,
}

/// Range of an episode's frames, with a limit on their size.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameRange {
    /// First step to show. Step 0 is the start of the episode.
    pub first: u32,
    /// Last step to show. The last frame of the episode is shown if the episode ends earlier.
    pub last: u32,
    /// Largest size of all frames as JSON, bytes.
    pub max_bytes: usize,
}

impl FrameRange {
    /// All frames of an episode, up to a size in bytes.
    #[must_use]
    pub const fn all(max_bytes: usize) -> Self {
        Self { first: 0, last: u32::MAX, max_bytes }
    }
}

/// Why an episode cannot be shown.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FramesError {
    /// The scenario cannot start.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// An action is invalid.
    #[error("step {step}: {source}")]
    Step {
        /// Number of the step, from 1.
        step: u32,
        /// Why the action is invalid.
        source: StepError,
    },
    /// The frames are larger than the limit.
    #[error(
        "the frames up to step {step} exceed {} MiB of JSON; request fewer steps, fewer bodies, or no telemetry",
        max_bytes >> 20
    )]
    TooLarge {
        /// The step at which the limit was exceeded.
        step: u32,
        /// The limit in bytes.
        max_bytes: usize,
    },
}

/// Replays an episode and returns its frames: the start, then one frame for each step.
///
/// A frame has `step`, `actions`, `reward`, `done` and `state`, which is the whole state with hidden bodies. With
/// [`FrameContent::Telemetry`] it also has `observation`. After the end of a log that stopped early, the agents do nothing.
///
/// # Errors
/// Returns [`FramesError::Scenario`] if the scenario cannot start, [`FramesError::Step`] if an action is invalid, and
/// [`FramesError::TooLarge`] if the frames exceed the limit of `range`.
pub fn frames(
    scenario: &Scenario,
    log: &ActionLog,
    content: FrameContent,
    range: FrameRange,
) -> Result<Vec<Value>, FramesError> {
    let FrameRange { first, last, max_bytes } = range;
    let mut episode = scenario.task().start(scenario)?;
    episode.record_motion();
    let mut report = StepReport::default();
    let mut bytes = 0;
    let mut frames = Vec::new();
    let mut push = |frame: Value, step: u32| {
        bytes += json_bytes(&frame);
        frames.push(frame);
        if bytes > max_bytes { Err(FramesError::TooLarge { step, max_bytes }) } else { Ok(()) }
    };
    if first == 0 {
        push(frame(&*episode, &json!([]), &report, content), 0)?;
    }
    while !episode.done() && episode.steps() < last {
        let step = episode.steps();
        let action = log.step(step as usize);
        episode.step(action, &mut report).map_err(|source| FramesError::Step { step: step + 1, source })?;
        if step + 1 >= first || episode.done() {
            push(frame(&*episode, &wire_step(log, action), &report, content), step + 1)?;
        }
    }
    Ok(frames)
}

/// One step of a log in the wire form: a list of `[agent, value, …]`.
#[must_use]
pub fn wire_step(log: &ActionLog, action: JointAction<'_>) -> Value {
    let entries = action.agents.iter().zip(action.values.chunks(log.dim().max(1)));
    let entry = |(agent, values): (&u32, &[f64])| {
        std::iter::once(json!(agent)).chain(values.iter().map(|value| json!(value))).collect()
    };
    Value::Array(entries.map(entry).collect())
}

fn frame(episode: &dyn Episode, actions: &Value, report: &StepReport, content: FrameContent) -> Value {
    let mut frame = json!({
        "step": episode.steps(),
        "actions": actions,
        "reward": report.reward,
        "done": report.done,
        "state": episode.truth(),
    });
    if content == FrameContent::Telemetry {
        frame["observation"] = episode.telemetry();
    }
    frame
}

/// Size of a value as JSON, bytes.
fn json_bytes(value: &Value) -> usize {
    struct ByteCounter(usize);
    impl io::Write for ByteCounter {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0 += bytes.len();
            Ok(bytes.len())
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }
    let mut counter = ByteCounter(0);
    match serde_json::to_writer(&mut counter, value) {
        Ok(()) => counter.0,
        Err(_) => usize::MAX / 2, // larger than any limit: a value that cannot be written is not shown
    }
}

#[cfg(test)]
mod tests {
    use crate::rollout::roll_out;

    use super::*;

    fn rollout(params: &Value) -> (Scenario, ActionLog) {
        let scenario = json!({"task": "kessler/survival", "seed": 5, "params": params,
                              "physics": {"warnings": "exact"}});
        let scenario = Scenario::from_json(&scenario).unwrap();
        let mut policy = scenario.task().policy("heuristic", &scenario, 0).unwrap();
        let log = roll_out(&scenario, &mut *policy).unwrap().log;
        (scenario, log)
    }

    #[test]
    fn telemetry_adds_only_what_the_agents_observed() {
        let (scenario, log) = rollout(&json!({"debris": 60, "radar_range": 20}));
        let plain = frames(&scenario, &log, FrameContent::State, FrameRange::all(MAX_FRAME_BYTES)).unwrap();
        let mut shown =
            frames(&scenario, &log, FrameContent::Telemetry, FrameRange::all(MAX_FRAME_BYTES)).unwrap();
        assert_eq!((plain.len(), shown.len()), (51, 51));
        let count = |frame: &Value, what: &str| frame[what]["radar_debris"].as_array().unwrap().len();
        assert!(shown.iter().any(|frame| count(frame, "observation") < count(frame, "state")));
        assert!(shown.iter().all(|frame| frame["observation"]["conjunctions"].is_array()));
        for frame in &mut shown {
            frame.as_object_mut().unwrap().remove("observation");
        }
        assert_eq!(plain, shown, "telemetry changes nothing else");
    }

    #[test]
    fn frames_above_the_limit_are_refused() {
        let (scenario, log) = rollout(&json!({"debris": 1000}));
        let telemetry =
            |max_bytes| frames(&scenario, &log, FrameContent::Telemetry, FrameRange::all(max_bytes));
        let all = telemetry(MAX_FRAME_BYTES).unwrap();
        let bytes: usize = all.iter().map(json_bytes).sum();
        assert!(bytes > 4 << 20 && bytes <= MAX_FRAME_BYTES, "{bytes}");
        assert_eq!(telemetry(bytes).unwrap().len(), 51);
        let error = telemetry(1 << 20).unwrap_err();
        let FramesError::TooLarge { step, .. } = error else { panic!("{error}") };
        assert!((1..20).contains(&step), "{error}");
        assert!(error.to_string().contains("exceed 1 MiB"), "{error}");
    }
}
