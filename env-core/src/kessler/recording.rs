//! Episodes recorded by the public kessler-env, replayed under `compat: upstream` with every random draw
//! scripted.
//!
//! An episode of the format holds the task, the radar range and the initial bodies; a step holds the burns,
//! the draws and the state after it.

use serde::Deserialize;
use serde_json::Value;

use super::KESSLER_TASKS;
use super::constants::{RADAR_NONE, ROGUE_RADIUS, SATELLITES};
use super::event::KesslerEvent;
use super::kernel::Body;
use super::setup::{InitialState, KesslerSetup, RogueArrival};
use super::simulation::{KesslerSim, SatelliteStatus};
use crate::episode_rng::{RngStream, ScriptedRng};
use crate::error::ScenarioError;
use crate::log::{ActionLog, Precision};
use crate::task::{Recipe, TaskSpec};

/// Speed of recorded rogue debris over circular speed.
const RECORDED_ROGUE_SPEED: f64 = 1.2;

/// File of recorded episodes.
#[derive(Debug, Deserialize)]
pub struct KesslerRecording {
    /// Description of the recording.
    #[serde(default)]
    pub about: String,
    /// Recorded episodes, in order.
    pub episodes: Vec<EpisodeRecording>,
}

/// Recording of one episode.
#[derive(Debug, Deserialize)]
pub struct EpisodeRecording {
    /// Task name: `survival`, `eco_station` or `rendezvous`.
    pub task: String,
    /// Policy that produced the actions.
    #[serde(default)]
    pub policy: String,
    /// Seed of the recording's own generator.
    #[serde(default)]
    pub seed: u64,
    /// Radar range, LU; 0 hides nothing.
    #[serde(default)]
    pub radar_range: f64,
    /// Bodies at the start.
    pub initial: RecordedBodies,
    /// Recorded steps, in order.
    pub steps: Vec<StepRecording>,
}

/// Bodies at the start of a recorded episode.
#[derive(Debug, Deserialize)]
pub struct RecordedBodies {
    /// All satellites, by number.
    pub satellites: Vec<RecordedSatellite>,
    /// Debris in order, each x, y (LU), vx, vy (LU/TU).
    pub debris: Vec<[f64; 4]>,
}

/// Recorded satellite; an array of its fields in the file.
#[derive(Debug, Deserialize)]
pub struct RecordedSatellite {
    /// Position along x, LU.
    pub x: f64,
    /// Position along y, LU.
    pub y: f64,
    /// Velocity along x, LU/TU.
    pub vx: f64,
    /// Velocity along y, LU/TU.
    pub vy: f64,
    /// Remaining fuel, in fuel units.
    pub fuel: f64,
    /// Status word: `active` or `destroyed`.
    pub status: String,
}

/// Recording of one step.
#[derive(Debug, Deserialize)]
pub struct StepRecording {
    /// Burns in JSON, as the public kessler-env takes them.
    pub burns: Value,
    /// Random draws of the step.
    pub draws: RecordedDraws,
    /// Satellites after the step.
    pub satellites: Vec<RecordedSatellite>,
    /// Debris after the step, if recorded.
    #[serde(default)]
    pub debris: Option<Vec<[f64; 4]>>,
    /// Reward of the step.
    pub reward: f64,
    /// Sum of rewards so far.
    pub total_score: f64,
    /// True if the episode is over.
    pub done: bool,
    /// Alert texts of the step.
    pub alerts: Vec<String>,
    /// Number of debris bodies after the step.
    pub debris_count: usize,
    /// Ids of visible debris, if the radar is limited.
    #[serde(default)]
    pub visible_debris: Option<Vec<u32>>,
}

/// Random draws of one recorded step.
#[derive(Debug, Deserialize)]
pub struct RecordedDraws {
    /// Position of a rogue, if one arrived.
    #[serde(default)]
    pub rogue: Option<RecordedRogue>,
    /// Velocity kicks of fragments in order, LU/TU.
    #[serde(default)]
    pub fragment_kicks: Vec<[f64; 2]>,
}

/// Position at which a recorded rogue arrived.
#[derive(Debug, Deserialize)]
pub struct RecordedRogue {
    /// Position along x, LU.
    pub x: f64,
    /// Position along y, LU.
    pub y: f64,
}

/// Largest differences between a recorded episode and its replay.
#[derive(Debug, Clone, Default)]
pub struct EpisodeDifferences {
    /// Number of steps compared.
    pub steps: usize,
    /// Largest absolute difference of a satellite's position, velocity or fuel.
    pub satellite: f64,
    /// Largest absolute difference of a debris position or velocity.
    pub debris: f64,
    /// Largest absolute difference of a reward.
    pub reward: f64,
    /// Largest absolute difference of the sum of rewards.
    pub total_score: f64,
    /// First difference of a value that is not a number.
    pub first_mismatch: Option<StepDifference>,
    /// First difference of a number by more than the tolerance.
    pub first_beyond: Option<StepDifference>,
}

/// Difference found in one step.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StepDifference {
    /// Step, counted from 1.
    pub step: usize,
    /// Quantity that differs, with both values.
    pub what: String,
}

impl EpisodeDifferences {
    /// Largest difference over all quantities.
    #[must_use]
    pub fn worst(&self) -> f64 {
        self.satellite.max(self.debris).max(self.reward).max(self.total_score)
    }
}

/// Reason why a recording cannot be replayed.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The task is unknown.
    #[error("task {0:?} is unknown; survival, eco_station and rendezvous are replayed")]
    Task(String),
    /// The number of satellites is not that of kessler.
    #[error("{0} satellites at the start; kessler has {SATELLITES}")]
    Satellites(usize),
    /// A value is out of range.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// A step has no valid action, or the environment rejects it.
    #[error("step {step}: {reason}")]
    Step {
        /// Step, counted from 1.
        step: usize,
        /// Reason why the step cannot be replayed.
        reason: String,
    },
}

/// Replays one episode and compares it with the recording step by step. A number differs if it is off by more
/// than `tolerance`.
///
/// # Errors
/// Returns [`RecordingError`] if the recording cannot be replayed.
pub fn compare_episode(
    episode: &EpisodeRecording,
    tolerance: f64,
) -> Result<EpisodeDifferences, RecordingError> {
    let mut sim = restore(episode)?;
    let mut differences = EpisodeDifferences::default();
    let mut ended = false;
    for (index, step) in episode.steps.iter().enumerate() {
        if ended {
            break; // Steps past the end only show what the public kessler-env does after it.
        }
        let number = index + 1;
        let fault = |reason: String| RecordingError::Step { step: number, reason };
        if step.satellites.len() != SATELLITES {
            return Err(fault(format!("it has {} satellites, not {SATELLITES}", step.satellites.len())));
        }
        let mut log = ActionLog::new(2, Precision::F64);
        super::codec::read_step(&step.burns, &mut log).map_err(|e| fault(e.to_string()))?;
        log.end_step();
        let stepped = sim.step(log.step(0)).map_err(|e| fault(e.to_string()))?;
        compare_numbers(&sim, step, stepped.reward, number, tolerance, &mut differences);
        compare_discrete(&sim, step, number, &mut differences);
        differences.steps = number;
        ended = stepped.done;
    }
    Ok(differences)
}

/// Builds the recorded start, with every draw of the recording scripted.
fn restore(episode: &EpisodeRecording) -> Result<KesslerSim<ScriptedRng>, RecordingError> {
    let id = format!("kessler/{}", episode.task);
    let task = KESSLER_TASKS
        .iter()
        .find(|task| task.id() == id)
        .ok_or_else(|| RecordingError::Task(episode.task.clone()))?;
    let count = episode.initial.satellites.len();
    let first = episode.initial.satellites.first().filter(|_| count == SATELLITES);
    let fuel = first.ok_or(RecordingError::Satellites(count))?.fuel;
    let radar = if episode.radar_range > 0.0 { episode.radar_range } else { RADAR_NONE };
    let params = [("fuel", fuel), ("radar_range", radar), ("debris", 0.0), ("rogue_probability", 0.0)];
    let recipe = Recipe::with_params(task, params.into_iter())?
        .with_option("compat", "upstream")?
        .with_option("start", "upstream")?;
    let mut start = InitialState {
        satellites: [Body::default(); SATELLITES],
        debris: episode.initial.debris.iter().map(|&[x, y, vx, vy]| Body { x, y, vx, vy }).collect(),
        ..InitialState::default()
    };
    for (body, s) in start.satellites.iter_mut().zip(&episode.initial.satellites) {
        *body = Body { x: s.x, y: s.y, vx: s.vx, vy: s.vy };
    }
    let mut script = ScriptedRng::new();
    for (step, recorded) in (1u32..).zip(&episode.steps) {
        if let Some(rogue) = &recorded.draws.rogue {
            // The draw is an angle; the state follows from it by the world's own rule.
            let angle = libm::atan2(rogue.y, rogue.x);
            let body = Body::circular(ROGUE_RADIUS, angle, RECORDED_ROGUE_SPEED);
            start.rogues.push(RogueArrival { step, body });
        }
        for kick in recorded.draws.fragment_kicks.iter().flatten() {
            script.push_draw(RngStream::Fragments, 0.5 * (kick + 1.0));
        }
    }
    Ok(KesslerSim::new(task.objective(), KesslerSetup::from_recipe(&recipe)?, &start, script))
}

fn compare_numbers(
    sim: &KesslerSim<ScriptedRng>,
    recorded: &StepRecording,
    reward: f64,
    step: usize,
    tolerance: f64,
    differences: &mut EpisodeDifferences,
) {
    let mut first_beyond = None;
    let mut note = |worst: &mut f64, ours: f64, theirs: f64, what: &str| {
        // NaN counts as an infinite difference.
        let difference = if ours == theirs { 0.0 } else { (ours - theirs).abs() };
        let difference = if difference.is_nan() { f64::INFINITY } else { difference };
        if difference > tolerance && first_beyond.is_none() {
            let what = format!("{what}: {ours} here, {theirs} recorded");
            first_beyond = Some(StepDifference { step, what });
        }
        *worst = worst.max(difference);
    };
    for (i, (ours, theirs)) in sim.satellites().iter().zip(&recorded.satellites).enumerate() {
        let b = ours.body;
        let pairs = [
            (b.x, theirs.x),
            (b.y, theirs.y),
            (b.vx, theirs.vx),
            (b.vy, theirs.vy),
            (ours.fuel, theirs.fuel),
        ];
        for (ours, theirs) in pairs {
            note(&mut differences.satellite, ours, theirs, &format!("satellite {i}"));
        }
    }
    for (i, theirs) in recorded.debris.iter().flatten().enumerate().take(sim.debris().len()) {
        let b = sim.debris().body(i);
        for (ours, theirs) in [b.x, b.y, b.vx, b.vy].into_iter().zip(*theirs) {
            note(&mut differences.debris, ours, theirs, &format!("debris {i}"));
        }
    }
    note(&mut differences.reward, reward, recorded.reward, "reward");
    note(&mut differences.total_score, sim.total_reward(), recorded.total_score, "total_score");
    if differences.first_beyond.is_none() {
        differences.first_beyond = first_beyond;
    }
}

/// Compares statuses, counts, ids, alerts and `done`.
fn compare_discrete(
    sim: &KesslerSim<ScriptedRng>,
    recorded: &StepRecording,
    step: usize,
    differences: &mut EpisodeDifferences,
) {
    let mut note = |what: String| {
        if differences.first_mismatch.is_none() {
            differences.first_mismatch = Some(StepDifference { step, what });
        }
    };
    for (i, (ours, theirs)) in sim.satellites().iter().zip(&recorded.satellites).enumerate() {
        let status = if ours.status == SatelliteStatus::Active { "active" } else { "destroyed" };
        if status != theirs.status {
            note(format!("satellite {i} is {status}, recorded {}", theirs.status));
        }
    }
    let debris = sim.debris();
    let is_other_length = |bodies: &Vec<[f64; 4]>| bodies.len() != debris.len();
    if debris.len() != recorded.debris_count || recorded.debris.as_ref().is_some_and(is_other_length) {
        note(format!("{} debris, recorded {}", debris.len(), recorded.debris_count));
    }
    let alerts: Vec<String> = sim.events().iter().filter_map(KesslerEvent::alert).collect();
    if alerts != recorded.alerts {
        note(format!("alerts {alerts:?}, recorded {:?}", recorded.alerts));
    }
    if let Some(theirs) = &recorded.visible_debris {
        let visible: Vec<u32> = (0..debris.len())
            .filter(|&i| sim.is_visible(debris.body(i).x, debris.body(i).y))
            .map(|i| debris.id(i))
            .collect();
        if visible != *theirs {
            note(format!("debris {visible:?} is visible, recorded {theirs:?}"));
        }
    }
    if sim.is_done() != recorded.done {
        note(format!("done is {}, recorded {}", sim.is_done(), recorded.done));
    }
    if sim.rng().missing_draws() > 0 {
        note("a draw was made that the recording does not hold".to_owned());
    }
}
