//! Initial state of an episode: bodies that the layout gives, and random draws for the rest.

use std::f64::consts::TAU;

use super::KesslerSetup;
use super::fair_start::EarlyPaths;
use crate::episode_rng::{EpisodeRng, RngStream};
use crate::error::ScenarioError;
use crate::kessler::body_blocks::{BLOCK_LEN, BodyBlocks};
use crate::kessler::constants::{
    FAIR_STEPS, FAIR_TRIES, FORMATION_RADII, FORMATION_SIDE, FRAGMENTS, GM, HORIZON, ROGUE_RADIUS,
    SATELLITE_RADII, SATELLITES, TARGET_RADIUS,
};
use crate::kessler::debris_init::{self, DRAWS_PER_BODY};
use crate::kessler::kernel::Body;

/// Bodies at the start of an episode, and rogues to come.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct InitialState {
    /// Satellites at the start, by number.
    pub satellites: [Body; SATELLITES],
    /// Debris at the start, in order.
    pub debris: Vec<Body>,
    /// Rogue debris, ordered by step.
    pub rogues: Vec<RogueArrival>,
}

/// Arrival of rogue debris.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RogueArrival {
    /// Step, counted from 1; the body arrives before the motion of this step.
    pub step: u32,
    /// State of the body on arrival.
    pub body: Body,
}

/// Memory of an episode into which an initial state is drawn.
pub(in crate::kessler) struct StateBuffers<'a> {
    pub satellites: &'a mut [Body; SATELLITES],
    pub debris: &'a mut BodyBlocks,
    pub rogues: &'a mut Vec<RogueArrival>,
}

impl KesslerSetup {
    /// Draws an initial state: the layout's bodies, and random ones where it gives none.
    ///
    /// # Errors
    /// Returns [`ScenarioError::Unfair`] if the start must be fair and a body of the layout prevents it, or
    /// if 64 redraws of a random body all touch a satellite.
    pub fn draw_initial_state(&self, rng: &mut impl EpisodeRng) -> Result<InitialState, ScenarioError> {
        let mut satellites = [Body::default(); SATELLITES];
        let (mut debris, mut rogues) = (BodyBlocks::default(), Vec::new());
        let buffers = StateBuffers { satellites: &mut satellites, debris: &mut debris, rogues: &mut rogues };
        self.draw_into(rng, buffers)?;
        Ok(InitialState { satellites, debris: debris.bodies().collect(), rogues })
    }

    /// Draws an initial state into existing memory.
    ///
    /// # Errors
    /// Returns the errors of [`KesslerSetup::draw_initial_state`]. The buffers hold no valid state then.
    pub(in crate::kessler) fn draw_into(
        &self,
        rng: &mut impl EpisodeRng,
        buffers: StateBuffers<'_>,
    ) -> Result<(), ScenarioError> {
        let StateBuffers { satellites, debris, rogues } = buffers;
        *satellites = match self.layout_satellites {
            Some(given) => given,
            None if self.starts_in_formation => draw_triangle(rng),
            None => std::array::from_fn(|i| {
                let drawn = rng.uniform_in(RngStream::Agents, SATELLITE_RADII.0, SATELLITE_RADII.1);
                let radius = if i == 0 { self.scale_start_radius(drawn) } else { drawn };
                Body::circular(radius, TAU * rng.uniform(RngStream::Agents), 1.0)
            }),
        };
        debris.clear(self.max_debris());
        debris_init::draw_bodies(rng, self.spread, self.debris, debris);
        for body in &self.layout_debris {
            debris.push(*body);
        }
        self.draw_rogues(rng, rogues);
        if self.fair { self.make_fair(rng, satellites, debris, rogues) } else { Ok(()) }
    }

    /// Radius of satellite 0 at the start, LU: the drawn one, nearer to its target by the start scale.
    fn scale_start_radius(&self, drawn: f64) -> f64 {
        if self.start_scale < 1.0 {
            TARGET_RADIUS + (drawn - TARGET_RADIUS) * self.start_scale
        } else {
            drawn
        }
    }

    /// Largest number of rogues of an episode.
    #[must_use]
    pub fn max_rogues(&self) -> usize {
        self.layout_rogues.len() + if self.draws_rogues() { HORIZON as usize } else { 0 }
    }

    /// Largest number of debris bodies at any time of an episode.
    #[must_use]
    pub fn max_debris(&self) -> usize {
        self.debris + self.layout_debris.len() + self.max_rogues() + SATELLITES * FRAGMENTS
    }

    fn draws_rogues(&self) -> bool {
        self.rogue_probability > 0.0 && !self.replaces_rogues
    }

    /// Draws all rogues of the episode. They do not depend on actions, so they can be drawn at the start.
    fn draw_rogues(&self, rng: &mut impl EpisodeRng, rogues: &mut Vec<RogueArrival>) {
        rogues.clear();
        rogues.reserve(self.max_rogues());
        rogues.extend_from_slice(&self.layout_rogues);
        if self.draws_rogues() {
            for step in 1..=HORIZON {
                if rng.uniform(RngStream::Arrivals) < self.rogue_probability {
                    let angle = TAU * rng.uniform(RngStream::ArrivalPlace);
                    let body = Body::circular(ROGUE_RADIUS, angle, self.rogue_speed);
                    rogues.push(RogueArrival { step, body });
                }
            }
            if !rogues.is_sorted_by_key(|rogue| rogue.step) {
                rogues.sort_by_key(|rogue| rogue.step);
            }
        }
    }

    /// Redraws each random body that would touch a satellite before any agent could act, from a substream of
    /// its own.
    fn make_fair(
        &self,
        rng: &mut impl EpisodeRng,
        satellites: &[Body; SATELLITES],
        debris: &mut BodyBlocks,
        rogues: &[RogueArrival],
    ) -> Result<(), ScenarioError> {
        let early = EarlyPaths::new(satellites, self.physics);
        for rogue in rogues.iter().take_while(|rogue| rogue.step <= FAIR_STEPS) {
            if let Some(contact) = early.first_contact(rogue.body, Some(rogue.step)) {
                return Err(unfair(
                    "layout.bodies.rogues",
                    format!(
                        "the rogue of step {} touches satellite {} at step {} under hold, before any agent could act",
                        rogue.step, contact.satellite, contact.step
                    ),
                ));
            }
        }
        // Bit i: some body in block i touches a satellite.
        let mut blocks = early.blocks_in_contact(debris);
        while blocks != 0 {
            let first = blocks.trailing_zeros() as usize * BLOCK_LEN;
            blocks &= blocks - 1;
            for index in first..(first + BLOCK_LEN).min(debris.len()) {
                self.make_body_fair(rng, debris, &early, index)?;
            }
        }
        Ok(())
    }

    fn make_body_fair(
        &self,
        rng: &mut impl EpisodeRng,
        debris: &mut BodyBlocks,
        early: &EarlyPaths,
        index: usize,
    ) -> Result<(), ScenarioError> {
        let mut tries = 0;
        while let Some(contact) = early.first_contact(debris.body(index), None) {
            if index >= self.debris {
                return Err(unfair(
                    &format!("layout.bodies.debris.{}", index - self.debris),
                    format!(
                        "it touches satellite {} at step {} under hold, before any agent could act",
                        contact.satellite, contact.step
                    ),
                ));
            }
            if tries == FAIR_TRIES {
                return Err(unfair(
                    "params.debris",
                    format!("debris {index} touched a satellite before step 3 in {FAIR_TRIES} tries"),
                ));
            }
            tries += 1;
            debris.set(index, self.draw_debris(rng, RngStream::Redraw(index as u32)));
        }
        Ok(())
    }

    /// Draws one body. Radius, angle and both velocity offsets are always drawn, so the draws do not depend
    /// on `spread`.
    fn draw_debris(&self, rng: &mut impl EpisodeRng, stream: RngStream) -> Body {
        let mut draws = [0.0; DRAWS_PER_BODY];
        rng.fill(stream, &mut draws);
        debris_init::body_from_draws(draws, self.spread)
    }
}

/// Draws an equilateral triangle of random orientation. Each satellite is on the circular prograde orbit of
/// its radius.
fn draw_triangle(rng: &mut impl EpisodeRng) -> [Body; SATELLITES] {
    let mut draw = || rng.uniform(RngStream::Agents);
    let radius = FORMATION_RADII.0 + (FORMATION_RADII.1 - FORMATION_RADII.0) * draw();
    let (sin, cos) = libm::sincos(TAU * draw());
    let orientation = TAU * draw();
    let circumradius = FORMATION_SIDE / 3.0f64.sqrt();
    std::array::from_fn(|i| {
        let (dy, dx) = libm::sincos(orientation + TAU * i as f64 / SATELLITES as f64);
        let (x, y) = (radius * cos + circumradius * dx, radius * sin + circumradius * dy);
        let r = (x * x + y * y).sqrt();
        let v = (GM / r).sqrt();
        Body { x, y, vx: -v * (y / r), vy: v * (x / r) }
    })
}

fn unfair(field: &str, reason: String) -> ScenarioError {
    ScenarioError::Unfair { field: field.to_owned(), reason }
}
