//! The episode as the engine flies it: every satellite after every step, who was lost to what, which burns were refused.

use crate::bracket::Flown;
use crate::chance::Seeded;
use crate::kessler::constants::{FRAGMENTS, HORIZON, SATELLITES};
use crate::kessler::event::Event;
use crate::kessler::flight::{Flight, Satellite};
use crate::kessler::kernel::Body;
use crate::kessler::reward::Objective;
use crate::kessler::setup::{Setup, Start};
use crate::log::ActionLog;
use crate::rollout::{ReplayError, follow};
use crate::seed::Seed;

/// The episode as it was flown.
pub(super) struct Trace {
    /// The satellites after each step; the start first.
    pub(super) satellites: Vec<[Satellite; SATELLITES]>,
    /// How each satellite was lost.
    pub(super) ends: [Option<End>; SATELLITES],
    /// Burns refused for lack of fuel, in order.
    pub(super) refused: Vec<Refused>,
    /// Fragments, in order of arrival.
    pub(super) fragments: Vec<Fragment>,
    /// How it went.
    pub(super) flown: Flown,
}

/// How a satellite was lost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct End {
    /// When, counted from 1.
    pub(super) step: u32,
    /// By what; none is the Earth.
    pub(super) met: Option<Met>,
}

/// What hit a satellite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Met {
    /// The engine's id.
    pub(super) id: u32,
    /// Which body that is.
    pub(super) who: Who,
    /// Where it was at contact, and how it moved.
    pub(super) body: Body,
}

/// A body of debris.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Who {
    /// Debris of the start, by its column in the table.
    Debris(usize),
    /// A rogue, by its column in the table.
    Rogue(usize),
    /// A fragment, by its place in the trace.
    Fragment(usize),
}

/// A burn that was refused.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Refused {
    /// Whose.
    pub(super) satellite: usize,
    /// When.
    pub(super) step: u32,
    /// What it would have cost.
    pub(super) cost: f64,
    /// What there was.
    pub(super) fuel: f64,
}

/// A fragment of a satellite that was hit.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Fragment {
    id: u32,
    /// The step in which it appeared.
    pub(super) born: u32,
    /// Where it was after each step from then on, until it fell into the Earth.
    pub(super) places: Vec<(f64, f64)>,
}

impl Trace {
    /// Flies the episode.
    pub(super) fn of(
        objective: Objective,
        setup: &Setup,
        start: &Start,
        seed: Seed,
        log: &ActionLog,
    ) -> Result<Self, ReplayError> {
        let mut flight = Flight::new(objective, setup.clone(), start.clone(), Seeded::new(seed));
        let mut trace = Self {
            satellites: Vec::with_capacity(HORIZON as usize + 1),
            ends: [None; SATELLITES],
            refused: Vec::new(),
            fragments: Vec::new(),
            flown: flight.flown(),
        };
        trace.satellites.push(*flight.satellites());
        let mut ids = Ids::of(start);
        follow(log, |action| {
            let stepped = flight.step(action)?;
            trace.after(&flight, &mut ids);
            Ok(stepped.done)
        })?;
        trace.flown = flight.flown();
        Ok(trace)
    }

    fn after(&mut self, flight: &Flight<Seeded>, ids: &mut Ids) {
        let step = flight.steps();
        let before = self.satellites.last().copied().unwrap_or(*flight.satellites());
        for event in flight.events() {
            match *event {
                Event::BurnRefused { satellite, cost } => {
                    let satellite = satellite as usize;
                    let fuel = before[satellite].fuel;
                    self.refused.push(Refused { satellite, step, cost, fuel });
                }
                Event::RogueArrived { debris } => ids.rogue(debris),
                Event::Decayed { satellite } => {
                    self.ends[satellite as usize] = Some(End { step, met: None });
                }
                Event::Collision { satellite, debris } => {
                    let body = find(flight, debris).unwrap_or_default();
                    let met = ids.who(debris).map(|who| Met { id: debris, who, body });
                    self.ends[satellite as usize] = Some(End { step, met });
                    for id in ids.fragments() {
                        self.fragments.push(Fragment { id, born: step, places: Vec::new() });
                    }
                }
                Event::DebrisDecayed { .. } => {}
            }
        }
        for fragment in &mut self.fragments {
            // One that fell into the Earth is found no more.
            if let Some(body) = find(flight, fragment.id) {
                fragment.places.push((body.x, body.y));
            }
        }
        self.satellites.push(*flight.satellites());
    }

    /// A satellite after `step`; where it was lost, as it was then.
    pub(super) fn satellite(&self, satellite: usize, step: u32) -> &Satellite {
        let last = self.satellites.len() - 1;
        &self.satellites[(step as usize).min(last)][satellite]
    }
}

/// Debris by its id. Ids ascend in order of arrival.
fn find(flight: &Flight<Seeded>, id: u32) -> Option<Body> {
    let debris = flight.debris();
    let at = debris.id.binary_search(&id).ok()?;
    Some(debris.body(at))
}

/// Which body an id of the engine's is: debris of the start, then rogues and fragments as they come.
struct Ids {
    debris: usize,
    later: Vec<(u32, Who)>,
    rogues: usize,
    fragments: usize,
}

impl Ids {
    fn of(start: &Start) -> Self {
        Self { debris: start.debris.len(), later: Vec::new(), rogues: 0, fragments: 0 }
    }

    fn next(&self) -> u32 {
        (self.debris + self.later.len()) as u32
    }

    fn rogue(&mut self, id: u32) {
        self.later.push((id, Who::Rogue(self.debris + self.rogues)));
        self.rogues += 1;
    }

    /// The ids of the fragments that a collision makes.
    fn fragments(&mut self) -> [u32; FRAGMENTS] {
        [(); FRAGMENTS].map(|()| {
            let id = self.next();
            self.later.push((id, Who::Fragment(self.fragments)));
            self.fragments += 1;
            id
        })
    }

    fn who(&self, id: u32) -> Option<Who> {
        if (id as usize) < self.debris {
            return Some(Who::Debris(id as usize));
        }
        self.later.iter().find(|(of, _)| *of == id).map(|(_, who)| *who)
    }
}
