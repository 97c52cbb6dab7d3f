//! Episodes recorded by the public kessler-env, replayed under `compat: upstream` with every random draw
//! scripted.
//!
//! An episode of the format holds the task, the radar range and the initial bodies; a step holds the burns,
//! the draws and the state after it.

use std::fmt::Arguments;

use serde::Deserialize;
use serde_json::Value;

use super::KESSLER_TASKS;
use super::codec::BURN_FORMAT;
use super::constants::{RADAR_NONE, ROGUE_RADIUS, SATELLITES};
use super::event::KesslerEvent;
use super::kernel::Body;
use super::setup::{InitialState, KesslerSetup, RogueArrival};
use super::simulation::{KesslerSim, SatelliteStatus};
use crate::difference_tally::DifferenceTally;
use crate::episode_rng::{RngStream, ScriptedRng};
use crate::log::{ActionLog, Precision};
use crate::task::{Recipe, TaskSpec};
use crate::world::{ComparisonError, RecordingComparison};

/// Speed of recorded rogue debris over circular speed.
const RECORDED_ROGUE_SPEED: f64 = 1.2;
/// Names of the compared quantities.
const QUANTITIES: [&str; 4] = ["satellite", "debris", "reward", "total_score"];

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

/// True if a file looks like a recording of this world: its episodes start from satellites and debris.
#[must_use]
pub fn is_recording(recording: &Value) -> bool {
    recording.pointer("/episodes/0/initial/satellites").is_some()
}

/// Replays every episode and compares it step by step.
///
/// # Errors
/// Returns an error if the file is not a recording or an episode cannot be replayed.
pub fn compare_recording(recording: &Value, tolerance: f64) -> Result<RecordingComparison, ComparisonError> {
    let recording = KesslerRecording::deserialize(recording)
        .map_err(|error| ComparisonError::Malformed(format!("it is not a recording: {error}")))?;
    let mut tally = DifferenceTally::new(&QUANTITIES, None, tolerance);
    for (index, episode) in recording.episodes.iter().enumerate() {
        tally.episode = index;
        compare_episode(episode, &mut tally)
            .map_err(|reason| ComparisonError::Episode { episode: index, reason })?;
    }
    Ok(tally.into_comparison(recording.episodes.len()))
}

/// Compares one episode; the error says why it cannot be replayed.
fn compare_episode(episode: &EpisodeRecording, tally: &mut DifferenceTally) -> Result<(), String> {
    if episode.steps.is_empty() {
        return Err("it has no steps".to_owned());
    }
    // A missing satellite could not be compared.
    if let Some(step) = episode.steps.iter().position(|step| step.satellites.len() != SATELLITES) {
        return Err(format!("step {} does not have {SATELLITES} satellites", step + 1));
    }
    let mut sim = restore_start(episode)?;
    for (number, step) in (1..).zip(&episode.steps) {
        tally.step = number;
        let mut log = ActionLog::new(2, Precision::F64);
        let read = BURN_FORMAT.read_entries(&step.burns, &mut log);
        read.map_err(|error| format!("step {number}: {error}"))?;
        log.end_step();
        let stepped = sim.step(log.step(0)).map_err(|error| format!("step {number}: {error}"))?;
        compare_numbers(&sim, step, stepped.reward, tally);
        compare_discrete(&sim, step, tally);
        tally.steps += 1;
        if stepped.done {
            break; // Steps past the end only show what the public kessler-env does after it.
        }
    }
    Ok(())
}

/// Builds the recorded start, with every draw of the recording scripted.
fn restore_start(episode: &EpisodeRecording) -> Result<KesslerSim<ScriptedRng>, String> {
    let id = format!("kessler/{}", episode.task);
    let task = KESSLER_TASKS.iter().find(|task| task.id() == id).ok_or_else(|| {
        format!("task {:?} is unknown; survival, eco_station and rendezvous are replayed", episode.task)
    })?;
    let count = episode.initial.satellites.len();
    let first = episode.initial.satellites.first().filter(|_| count == SATELLITES);
    let first = first.ok_or_else(|| format!("{count} satellites at the start; kessler has {SATELLITES}"))?;
    let radar = if episode.radar_range > 0.0 { episode.radar_range } else { RADAR_NONE };
    let params = [("fuel", first.fuel), ("radar_range", radar), ("debris", 0.0), ("rogue_probability", 0.0)];
    let setup = Recipe::with_params(task, params.into_iter())
        .and_then(|recipe| recipe.with_option("compat", "upstream"))
        .and_then(|recipe| recipe.with_option("start", "upstream"))
        .and_then(|recipe| KesslerSetup::from_recipe(&recipe))
        .map_err(|error| error.to_string())?;
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
    Ok(KesslerSim::new(task.objective(), setup, &start, script))
}

fn compare_numbers(
    sim: &KesslerSim<ScriptedRng>,
    recorded: &StepRecording,
    reward: f64,
    tally: &mut DifferenceTally,
) {
    let mut compare = |quantity, ours, theirs, what: Arguments<'_>| {
        tally.compare_numbers(quantity, ours, theirs, tally.tolerance, what);
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
            compare("satellite", ours, theirs, format_args!("satellite {i}"));
        }
    }
    for (i, theirs) in recorded.debris.iter().flatten().enumerate().take(sim.debris().len()) {
        let b = sim.debris().body(i);
        for (ours, theirs) in [b.x, b.y, b.vx, b.vy].into_iter().zip(*theirs) {
            compare("debris", ours, theirs, format_args!("debris {i}"));
        }
    }
    compare("reward", reward, recorded.reward, format_args!("reward"));
    compare("total_score", sim.total_reward(), recorded.total_score, format_args!("total_score"));
}

/// Compares statuses, counts, ids, alerts and `done`.
fn compare_discrete(sim: &KesslerSim<ScriptedRng>, recorded: &StepRecording, tally: &mut DifferenceTally) {
    for (i, (ours, theirs)) in sim.satellites().iter().zip(&recorded.satellites).enumerate() {
        let status = if ours.status == SatelliteStatus::Active { "active" } else { "destroyed" };
        if status != theirs.status {
            tally.add_mismatch(format!("satellite {i} is {status}, recorded {}", theirs.status));
        }
    }
    let debris = sim.debris();
    let is_other_length = |bodies: &Vec<[f64; 4]>| bodies.len() != debris.len();
    if debris.len() != recorded.debris_count || recorded.debris.as_ref().is_some_and(is_other_length) {
        tally.add_mismatch(format!("{} debris, recorded {}", debris.len(), recorded.debris_count));
    }
    let alerts: Vec<String> = sim.events().iter().filter_map(KesslerEvent::alert).collect();
    if alerts != recorded.alerts {
        tally.add_mismatch(format!("alerts {alerts:?}, recorded {:?}", recorded.alerts));
    }
    if let Some(theirs) = &recorded.visible_debris {
        let visible: Vec<u32> = (0..debris.len())
            .filter(|&i| sim.is_visible(debris.body(i).x, debris.body(i).y))
            .map(|i| debris.id(i))
            .collect();
        if visible != *theirs {
            tally.add_mismatch(format!("debris {visible:?} is visible, recorded {theirs:?}"));
        }
    }
    if sim.is_done() != recorded.done {
        tally.add_mismatch(format!("done is {}, recorded {}", sim.is_done(), recorded.done));
    }
    if sim.rng().missing_draws() > 0 {
        tally.add_mismatch("a draw was made that the recording does not hold".to_owned());
    }
}
