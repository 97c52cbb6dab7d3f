//! Trace of an episode replayed on the engine: every satellite after every step, the cause of each loss, and
//! rejected burns.

use std::sync::Arc;

use crate::bracket::EpisodeOutcome;
use crate::episode_rng::SeededRng;
use crate::error::ReplayError;
use crate::kessler::constants::{FRAGMENTS, HORIZON, SATELLITES};
use crate::kessler::event::KesslerEvent;
use crate::kessler::kernel::Body;
use crate::kessler::reward::Objective;
use crate::kessler::setup::{InitialState, KesslerSetup};
use crate::kessler::simulation::{KesslerSim, Satellite};
use crate::log::ActionLog;
use crate::rollout::step_through;
use crate::seed::Seed;

/// Facts of a replayed episode.
pub(super) struct EpisodeTrace {
    /// Satellites at the start and after each step.
    pub(super) satellites: Vec<[Satellite; SATELLITES]>,
    /// Loss of each satellite.
    pub(super) losses: [Option<LossEvent>; SATELLITES],
    /// Burns rejected for lack of fuel, in order.
    pub(super) rejected: Vec<RejectedBurn>,
    /// Fragments, in order of arrival.
    pub(super) fragments: Vec<FragmentTrack>,
    /// Outcome of the episode.
    pub(super) outcome: EpisodeOutcome,
}

/// Loss of a satellite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LossEvent {
    /// Step, counted from 1. Under `risk: pc` that of the close approach that cost most survival.
    pub step: u32,
    /// Debris that caused the loss; `None` if the satellite fell into the Earth.
    pub debris: Option<DebrisContact>,
    /// Close approach that caused the loss under `risk: pc`; `None` if the satellite was destroyed.
    pub approach: Option<LossApproach>,
}

/// Close approach under `risk: pc`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LossApproach {
    /// Miss distance of the approach, LU.
    pub miss: f64,
    /// Probability of collision of this approach.
    pub probability: f64,
}

/// Debris that caused a loss.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct DebrisContact {
    /// Id of the debris in the engine.
    pub id: u32,
    /// Identity of the debris in the analysis.
    pub identity: DebrisIdentity,
    /// State of the debris at the end of the step.
    pub body: Body,
}

/// Identity of a debris body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum DebrisIdentity {
    /// Debris of the start, by its column in the ephemeris.
    Initial(usize),
    /// Rogue debris, by its column in the ephemeris.
    Rogue(usize),
    /// Fragment, by its index in the trace.
    Fragment(usize),
}

/// Burn that was rejected for lack of fuel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RejectedBurn {
    /// Number of the satellite.
    pub satellite: usize,
    /// Step, counted from 1.
    pub step: u32,
    /// Fuel that the burn would have taken.
    pub cost: f64,
    /// Fuel that was left.
    pub fuel: f64,
}

/// Fragment of a satellite that was hit.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct FragmentTrack {
    id: u32,
    /// Step in which the fragment appeared.
    pub(super) first_step: u32,
    /// State after each step from then on, until it fell into the Earth.
    pub(super) bodies: Vec<Body>,
}

impl EpisodeTrace {
    /// Replays an episode.
    ///
    /// # Errors
    /// Returns [`ReplayError`] if the log cannot be replayed.
    pub(super) fn replay(
        objective: Objective,
        setup: &Arc<KesslerSetup>,
        start: &InitialState,
        seed: Seed,
        log: &ActionLog,
    ) -> Result<Self, ReplayError> {
        let mut sim = KesslerSim::new(objective, Arc::clone(setup), start, SeededRng::new(seed));
        let mut trace = Self {
            satellites: Vec::with_capacity(HORIZON as usize + 1),
            losses: [None; SATELLITES],
            rejected: Vec::new(),
            fragments: Vec::new(),
            outcome: sim.outcome(),
        };
        trace.satellites.push(*sim.satellites());
        let mut ids = DebrisIds::new(start);
        step_through(log, |action| {
            let stepped = sim.step(action)?;
            trace.record_step(&sim, &mut ids);
            Ok(stepped.done)
        })?;
        trace.outcome = sim.outcome();
        // Under `risk: pc` nothing is destroyed. A satellite with too little survival counts as lost to its
        // worst approach.
        for (loss, s) in trace.losses.iter_mut().zip(sim.satellites()) {
            *loss = loss.filter(|_| s.is_lost());
        }
        Ok(trace)
    }

    /// State of a satellite after `step`; the last one if the episode ended before.
    pub(super) fn satellite(&self, satellite: usize, step: u32) -> &Satellite {
        let last = self.satellites.len() - 1;
        &self.satellites[(step as usize).min(last)][satellite]
    }

    fn record_step(&mut self, sim: &KesslerSim<SeededRng>, ids: &mut DebrisIds) {
        let step = sim.steps();
        let before = self.satellites.last().copied().unwrap_or(*sim.satellites());
        let contact = |ids: &DebrisIds, id: u32| {
            let body = find_debris(sim, id).unwrap_or_default();
            ids.identity(id).map(|identity| DebrisContact { id, identity, body })
        };
        for event in sim.events() {
            match *event {
                KesslerEvent::BurnRejected { satellite, cost } => {
                    let satellite = satellite as usize;
                    let fuel = before[satellite].fuel;
                    self.rejected.push(RejectedBurn { satellite, step, cost, fuel });
                }
                KesslerEvent::RogueArrived { debris } => ids.add_rogue(debris),
                KesslerEvent::Decayed { satellite } => {
                    self.losses[satellite as usize] = Some(LossEvent { step, debris: None, approach: None });
                }
                KesslerEvent::Collision { satellite, debris } => {
                    let debris = contact(ids, debris);
                    self.losses[satellite as usize] = Some(LossEvent { step, debris, approach: None });
                    for id in ids.add_fragments() {
                        self.fragments.push(FragmentTrack { id, first_step: step, bodies: Vec::new() });
                    }
                }
                KesslerEvent::CloseApproach { satellite, debris, miss, probability } => {
                    let loss = &mut self.losses[satellite as usize];
                    let worst = loss.and_then(|loss| loss.approach).map_or(0.0, |worst| worst.probability);
                    if probability > worst {
                        let debris = contact(ids, debris);
                        let approach = Some(LossApproach { miss, probability });
                        *loss = Some(LossEvent { step, debris, approach });
                    }
                }
                KesslerEvent::DebrisDecayed { .. } => {}
            }
        }
        for fragment in &mut self.fragments {
            // A fragment that fell into the Earth is not found any more.
            if let Some(body) = find_debris(sim, fragment.id) {
                fragment.bodies.push(body);
            }
        }
        self.satellites.push(*sim.satellites());
    }
}

/// Returns the debris with this id.
fn find_debris(sim: &KesslerSim<SeededRng>, id: u32) -> Option<Body> {
    let debris = sim.debris();
    (0..debris.len()).rev().find(|&i| debris.id(i) == id).map(|i| debris.body(i))
}

/// Identities of the engine's debris ids: debris of the start, then rogues and fragments as they arrive.
struct DebrisIds {
    initial: usize,
    later: Vec<LaterDebris>,
    rogues: usize,
    fragments: usize,
}

/// Debris that arrived after the start.
struct LaterDebris {
    id: u32,
    identity: DebrisIdentity,
}

impl DebrisIds {
    fn new(start: &InitialState) -> Self {
        Self { initial: start.debris.len(), later: Vec::new(), rogues: 0, fragments: 0 }
    }

    fn next_id(&self) -> u32 {
        (self.initial + self.later.len()) as u32
    }

    fn add_rogue(&mut self, id: u32) {
        let identity = DebrisIdentity::Rogue(self.initial + self.rogues);
        self.later.push(LaterDebris { id, identity });
        self.rogues += 1;
    }

    /// Adds the fragments of a collision and returns their ids.
    fn add_fragments(&mut self) -> [u32; FRAGMENTS] {
        [(); FRAGMENTS].map(|()| {
            let id = self.next_id();
            self.later.push(LaterDebris { id, identity: DebrisIdentity::Fragment(self.fragments) });
            self.fragments += 1;
            id
        })
    }

    fn identity(&self, id: u32) -> Option<DebrisIdentity> {
        if (id as usize) < self.initial {
            return Some(DebrisIdentity::Initial(id as usize));
        }
        self.later.iter().find(|later| later.id == id).map(|later| later.identity)
    }
}
