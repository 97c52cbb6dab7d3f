//! An episode flown again and looked at step by step.

use std::io;

use env_core::task::{Episode, StepReport};
use env_core::{ActionLog, JointAction, Scenario, ScenarioError, StepError};
use serde_json::{Value, json};

/// Bytes of JSON that the frames of one episode may be: as much as a request may be.
pub const MOST_BYTES: usize = 16 << 20;

/// What a frame shows beside actions, reward and the whole state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Show {
    /// Nothing.
    State,
    /// What the agents saw, as they are told it: `observation`.
    Telemetry,
}

/// An episode that cannot be shown.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FramesError {
    /// It cannot start.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// An action is refused.
    #[error("step {step}: {source}")]
    Step {
        /// At which step, counted from 1.
        step: u32,
        /// Why.
        source: StepError,
    },
    /// There is more to show than is shown.
    #[error(
        "the frames up to step {step} are more than {} MiB of JSON; ask for fewer bodies, or without telemetry",
        most >> 20
    )]
    TooLarge {
        /// The step that was too much.
        step: u32,
        /// What is shown at most, bytes.
        most: usize,
    },
}

/// The start, then one frame a step: `step`, `actions`, `reward`, `done`, and `state`, the whole truth, hidden bodies
/// included; with [`Show::Telemetry`] also `observation`. Past the end of a log that stopped, nobody acts.
///
/// # Errors
/// A scenario that cannot start, a log that is not one of it, or more than `most` bytes of JSON.
pub fn frames(
    scenario: &Scenario,
    log: &ActionLog,
    show: Show,
    most: usize,
) -> Result<Vec<Value>, FramesError> {
    frames_of(scenario, log, show, (most, 0, u32::MAX))
}

/// The same from the frame of step `first` up to that of step `last`, or to the end where that comes before: the last frame is always there.
///
/// # Errors
/// As of [`frames`].
pub fn frames_of(
    scenario: &Scenario,
    log: &ActionLog,
    show: Show,
    (most, first, last): (usize, u32, u32),
) -> Result<Vec<Value>, FramesError> {
    let mut episode = scenario.task().start(scenario)?;
    let mut report = StepReport::default();
    let mut bytes = 0;
    let mut frames = Vec::new();
    let mut keep = |frame: Value, step: u32| {
        bytes += size(&frame);
        frames.push(frame);
        if bytes > most { Err(FramesError::TooLarge { step, most }) } else { Ok(()) }
    };
    if first == 0 {
        keep(frame(&*episode, &json!([]), &report, show), 0)?;
    }
    while !episode.done() && episode.steps() < last {
        let step = episode.steps();
        let action = log.step(step as usize);
        episode.step(action, &mut report).map_err(|source| FramesError::Step { step: step + 1, source })?;
        if step + 1 >= first || episode.done() {
            keep(frame(&*episode, &wire_step(log, action), &report, show), step + 1)?;
        }
    }
    Ok(frames)
}

fn frame(episode: &dyn Episode, actions: &Value, report: &StepReport, show: Show) -> Value {
    let mut frame = json!({
        "step": episode.steps(),
        "actions": actions,
        "reward": report.reward,
        "done": report.done,
        "state": episode.truth(),
    });
    if show == Show::Telemetry {
        frame["observation"] = episode.telemetry();
    }
    frame
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

/// Bytes of a value as JSON.
fn size(value: &Value) -> usize {
    struct Count(usize);
    impl io::Write for Count {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0 += bytes.len();
            Ok(bytes.len())
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }
    let mut count = Count(0);
    match serde_json::to_writer(&mut count, value) {
        Ok(()) => count.0,
        Err(_) => usize::MAX / 2, // a value that cannot be written is not shown; there is none
    }
}

#[cfg(test)]
mod tests {
    use env_core::rollout::fly;

    use super::*;

    fn flown(params: &Value) -> (Scenario, ActionLog) {
        let scenario = json!({"task": "kessler/survival", "seed": 5, "params": params,
                              "physics": {"warnings": "exact"}});
        let scenario = Scenario::from_json(&scenario).unwrap();
        let mut pilot = scenario.task().policy("heuristic", &scenario, 0).unwrap();
        let (_, log) = fly(&scenario, &mut *pilot).unwrap();
        (scenario, log)
    }

    #[test]
    fn telemetry_is_what_the_agents_saw_and_the_state_is_the_truth() {
        let (scenario, log) = flown(&json!({"debris": 60, "radar_range": 20}));
        let plain = frames(&scenario, &log, Show::State, MOST_BYTES).unwrap();
        let mut shown = frames(&scenario, &log, Show::Telemetry, MOST_BYTES).unwrap();
        assert_eq!((plain.len(), shown.len()), (51, 51));
        let count = |frame: &Value, what: &str| frame[what]["radar_debris"].as_array().unwrap().len();
        assert!(shown.iter().any(|frame| count(frame, "observation") < count(frame, "state")));
        assert!(shown.iter().all(|frame| frame["observation"]["conjunctions"].is_array()));
        for frame in &mut shown {
            frame.as_object_mut().unwrap().remove("observation");
        }
        assert_eq!(plain, shown, "asking for telemetry changes nothing else");
    }

    #[test]
    fn what_is_too_much_is_said_so_and_not_shown() {
        let (scenario, log) = flown(&json!({"debris": 1000}));
        let all = frames(&scenario, &log, Show::Telemetry, MOST_BYTES).unwrap();
        let bytes: usize = all.iter().map(size).sum();
        assert!(bytes > 4 << 20 && bytes <= MOST_BYTES, "{bytes}");
        assert_eq!(frames(&scenario, &log, Show::Telemetry, bytes).unwrap().len(), 51);
        let error = frames(&scenario, &log, Show::Telemetry, 1 << 20).unwrap_err();
        let FramesError::TooLarge { step, .. } = error else { panic!("{error}") };
        assert!((1..20).contains(&step), "{error}");
        assert!(error.to_string().contains("more than 1 MiB"), "{error}");
    }
}
