//! Episodes recorded elsewhere, replayed under `compat: upstream` with every random draw scripted.
//!
//! The format is that of the reference data: per episode the task, radar range and initial bodies; per step the burns,
//! the draws, and the state after it.

use serde::Deserialize;
use serde_json::Value;

use super::TASKS;
use super::constants::{RADAR_NONE, SATELLITES};
use super::event::Event;
use super::flight::{Flight, Status};
use super::kernel::Body;
use super::setup::{Setup, Start};
use crate::chance::{Scripted, Stream};
use crate::error::ScenarioError;
use crate::log::ActionLog;
use crate::scenario::Recipe;
use crate::task::TaskSpec;

/// A file of recorded episodes.
#[derive(Debug, Deserialize)]
pub struct Recording {
    /// What it is, in words.
    #[serde(default)]
    pub about: String,
    /// The episodes.
    pub episodes: Vec<RecordedEpisode>,
}

/// One recorded episode.
#[derive(Debug, Deserialize)]
pub struct RecordedEpisode {
    /// `survival`, `eco_station` or `rendezvous`.
    pub task: String,
    /// What flew it.
    #[serde(default)]
    pub policy: String,
    /// The seed of the recording's own generator.
    #[serde(default)]
    pub seed: u64,
    /// Radar range, LU; 0 sees everything.
    #[serde(default)]
    pub radar_range: f64,
    /// Bodies at the start.
    pub initial: RecordedBodies,
    /// The steps.
    pub steps: Vec<RecordedStep>,
}

/// Bodies at the start.
#[derive(Debug, Deserialize)]
pub struct RecordedBodies {
    /// x, y, vx, vy, fuel, status.
    pub satellites: Vec<RecordedSatellite>,
    /// x, y, vx, vy.
    pub debris: Vec<[f64; 4]>,
}

/// x, y, vx, vy, fuel, status.
#[derive(Debug, Deserialize)]
pub struct RecordedSatellite(pub f64, pub f64, pub f64, pub f64, pub f64, pub String);

/// One recorded step.
#[derive(Debug, Deserialize)]
pub struct RecordedStep {
    /// The burns, in the wire form.
    pub burns: Value,
    /// The draws made.
    pub draws: RecordedDraws,
    /// Satellites after the step.
    pub satellites: Vec<RecordedSatellite>,
    /// Debris after the step, where recorded.
    #[serde(default)]
    pub debris: Option<Vec<[f64; 4]>>,
    /// Reward of the step.
    pub reward: f64,
    /// Sum of rewards.
    pub total_score: f64,
    /// Whether the episode is over.
    pub done: bool,
    /// Alerts in words.
    pub alerts: Vec<String>,
    /// How much debris there is.
    pub debris_count: usize,
    /// Ids of visible debris, where radar is limited.
    #[serde(default)]
    pub visible_debris: Option<Vec<u32>>,
}

/// The draws of one step.
#[derive(Debug, Deserialize)]
pub struct RecordedDraws {
    /// Where a rogue appeared, if one did.
    #[serde(default)]
    pub rogue: Option<RecordedRogue>,
    /// Kicks of fragments, in order.
    #[serde(default)]
    pub fragment_kicks: Vec<[f64; 2]>,
}

/// Where a rogue appeared.
#[derive(Debug, Deserialize)]
pub struct RecordedRogue {
    /// LU.
    pub x: f64,
    /// LU.
    pub y: f64,
}

/// The worst differences found in one episode.
#[derive(Debug, Clone, Default, serde::Serialize)]
pub struct Differences {
    /// Steps compared.
    pub steps: usize,
    /// Largest absolute difference of a satellite's position, velocity or fuel.
    pub satellite: f64,
    /// Of a debris' position or velocity.
    pub debris: f64,
    /// Of a reward.
    pub reward: f64,
    /// Of the sum of rewards.
    pub total_score: f64,
    /// First step (counted from 1) at which something that is not a number differs, and what.
    pub first_mismatch: Option<(usize, String)>,
    /// First step at which a number differs by more than the tolerance, and what.
    pub first_beyond: Option<(usize, String)>,
}

impl Differences {
    /// The largest of all.
    #[must_use]
    pub fn worst(&self) -> f64 {
        self.satellite.max(self.debris).max(self.reward).max(self.total_score)
    }
}

/// A recording that cannot be replayed.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// A task nobody knows.
    #[error("task {0:?} is unknown; survival, eco_station and rendezvous are replayed")]
    Task(String),
    /// Not three satellites.
    #[error("{0} satellites at the start; kessler has {SATELLITES}")]
    Satellites(usize),
    /// Something out of range.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// A step that is no action, or that the environment refuses.
    #[error("step {step}: {reason}")]
    Step {
        /// Counted from 1.
        step: usize,
        /// Why.
        reason: String,
    },
}

/// Replays one episode and compares it step by step.
///
/// # Errors
/// A recording that is none.
pub fn compare(episode: &RecordedEpisode, tolerance: f64) -> Result<Differences, RecordError> {
    let mut flight = restage(episode)?;
    let mut found = Differences::default();
    let mut ended = false;
    for (index, step) in episode.steps.iter().enumerate() {
        if ended {
            break; // steps past the end show what the peer does after it; informative only
        }
        let number = index + 1;
        let fault = |reason: String| RecordError::Step { step: number, reason };
        if step.satellites.len() != SATELLITES {
            return Err(fault(format!("it has {} satellites, not {SATELLITES}", step.satellites.len())));
        }
        let mut log = ActionLog::new(2, crate::log::Precision::F64);
        super::codec::read_step(&step.burns, &mut log).map_err(|e| fault(e.to_string()))?;
        log.end_step();
        let stepped = flight.step(log.step(0)).map_err(|e| fault(e.to_string()))?;
        compare_numbers(&flight, step, stepped.reward, number, tolerance, &mut found);
        compare_words(&flight, step, number, &mut found);
        found.steps = number;
        ended = stepped.done;
    }
    Ok(found)
}

/// The recorded start, with every draw of the recording scripted.
fn restage(episode: &RecordedEpisode) -> Result<Flight<Scripted>, RecordError> {
    let id = format!("kessler/{}", episode.task);
    let task = TASKS.iter().find(|t| t.id() == id).ok_or_else(|| RecordError::Task(episode.task.clone()))?;
    let count = episode.initial.satellites.len();
    let first = episode.initial.satellites.first().filter(|_| count == SATELLITES);
    let fuel = first.ok_or(RecordError::Satellites(count))?.4;
    let radar = if episode.radar_range > 0.0 { episode.radar_range } else { RADAR_NONE };
    let params = [("fuel", fuel), ("radar_range", radar), ("debris", 0.0), ("rogue_probability", 0.0)];
    let recipe = Recipe::with_params(task, params.into_iter())?
        .with_option("compat", "upstream")?
        .with_option("start", "upstream")?;
    let mut start = Start {
        satellites: [Body::default(); SATELLITES],
        debris: episode.initial.debris.iter().map(|&[x, y, vx, vy]| Body { x, y, vx, vy }).collect(),
        ..Start::default()
    };
    for (body, s) in start.satellites.iter_mut().zip(&episode.initial.satellites) {
        *body = Body { x: s.0, y: s.1, vx: s.2, vy: s.3 };
    }
    let mut script = Scripted::new();
    for (step, recorded) in (1u32..).zip(&episode.steps) {
        if let Some(rogue) = &recorded.draws.rogue {
            // The draw is an angle; the state follows from it by the world's own rule, at 1.2 of circular speed.
            let angle = libm::atan2(rogue.y, rogue.x);
            start.rogues.push((step, Body::circular(super::constants::ROGUE_RADIUS, angle, 1.2)));
        }
        for kick in recorded.draws.fragment_kicks.iter().flatten() {
            script.push(Stream::Fragments, 0.5 * (kick + 1.0));
        }
    }
    Ok(Flight::new(task.objective(), Setup::read(&recipe)?, &start, script))
}

fn compare_numbers(
    flight: &Flight<Scripted>,
    step: &RecordedStep,
    reward: f64,
    number: usize,
    tolerance: f64,
    found: &mut Differences,
) {
    let mut beyond = None;
    let mut note = |worst: &mut f64, ours: f64, theirs: f64, what: &str| {
        // NaN counts as infinitely far.
        let difference = if ours == theirs { 0.0 } else { (ours - theirs).abs() };
        let difference = if difference.is_nan() { f64::INFINITY } else { difference };
        if difference > tolerance && beyond.is_none() {
            beyond = Some((number, format!("{what}: {ours} here, {theirs} recorded")));
        }
        *worst = worst.max(difference);
    };
    for (i, (ours, theirs)) in flight.satellites().iter().zip(&step.satellites).enumerate() {
        let b = ours.body;
        for (a, b) in
            [(b.x, theirs.0), (b.y, theirs.1), (b.vx, theirs.2), (b.vy, theirs.3), (ours.fuel, theirs.4)]
        {
            note(&mut found.satellite, a, b, &format!("satellite {i}"));
        }
    }
    for (i, theirs) in step.debris.iter().flatten().enumerate().take(flight.debris().len()) {
        let b = flight.debris().body(i);
        for (a, b) in [b.x, b.y, b.vx, b.vy].into_iter().zip(*theirs) {
            note(&mut found.debris, a, b, &format!("debris {i}"));
        }
    }
    note(&mut found.reward, reward, step.reward, "reward");
    note(&mut found.total_score, flight.total(), step.total_score, "total_score");
    if found.first_beyond.is_none() {
        found.first_beyond = beyond;
    }
}

fn compare_words(flight: &Flight<Scripted>, step: &RecordedStep, number: usize, found: &mut Differences) {
    let mut differ = |what: String| {
        if found.first_mismatch.is_none() {
            found.first_mismatch = Some((number, what));
        }
    };
    for (i, (ours, theirs)) in flight.satellites().iter().zip(&step.satellites).enumerate() {
        let status = if ours.status == Status::Active { "active" } else { "destroyed" };
        if status != theirs.5 {
            differ(format!("satellite {i} is {status}, recorded {}", theirs.5));
        }
    }
    let debris = flight.debris();
    if debris.len() != step.debris_count || step.debris.as_ref().is_some_and(|d| d.len() != debris.len()) {
        differ(format!("{} debris, recorded {}", debris.len(), step.debris_count));
    }
    let alerts: Vec<String> = flight.events().iter().filter_map(Event::alert).collect();
    if alerts != step.alerts {
        differ(format!("alerts {alerts:?}, recorded {:?}", step.alerts));
    }
    if let Some(theirs) = &step.visible_debris {
        let seen: Vec<u32> = (0..debris.len())
            .filter(|&i| flight.sees(debris.body(i).x, debris.body(i).y))
            .map(|i| debris.id(i))
            .collect();
        if seen != *theirs {
            differ(format!("debris {seen:?} is visible, recorded {theirs:?}"));
        }
    }
    if flight.done() != step.done {
        differ(format!("done is {}, recorded {}", flight.done(), step.done));
    }
    if flight.chance().missing() > 0 {
        differ("a draw was made that the recording does not hold".to_owned());
    }
}
