//! The start of an episode: what the layout gives, what is drawn, and that nobody is hit before anybody could act.

use super::{Contact, Physics, Setup};
use crate::chance::{Chance, Stream};
use crate::error::ScenarioError;
use crate::kessler::cloud::{BLOCK, Cloud};
use crate::kessler::constants::{
    CONTACT_2, FAIR_STEPS, FAIR_TRIES, FORMATION_RADII, FORMATION_SIDE, FRAGMENTS, GM, HORIZON, ROGUE_RADIUS,
    SATELLITE_RADII, SATELLITES,
};
use crate::kessler::kernel::{Body, distance_2, swept_2};
use crate::kessler::pass;
use crate::kessler::scatter::{self, DRAWS};

const TAU: f64 = std::f64::consts::TAU;

/// Bodies at the start, and rogues to come.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Start {
    /// The satellites.
    pub satellites: [Body; SATELLITES],
    /// Debris in order.
    pub debris: Vec<Body>,
    /// (step, body) by step: a rogue that arrives before the motion of that step (counted from 1).
    pub rogues: Vec<(u32, Body)>,
}

/// Where a start is drawn: the episode's own memory.
pub(in crate::kessler) struct Draft<'a> {
    pub satellites: &'a mut [Body; SATELLITES],
    pub debris: &'a mut Cloud,
    pub rogues: &'a mut Vec<(u32, Body)>,
}

impl Setup {
    /// Draws what the layout does not give.
    ///
    /// # Errors
    /// `Unfair`, where `start: fair` cannot be had: by a layout's body, or after 64 tries at one that is drawn.
    pub fn start(&self, chance: &mut impl Chance) -> Result<Start, ScenarioError> {
        let mut satellites = [Body::default(); SATELLITES];
        let (mut debris, mut rogues) = (Cloud::default(), Vec::new());
        let draft = Draft { satellites: &mut satellites, debris: &mut debris, rogues: &mut rogues };
        self.start_into(chance, draft)?;
        Ok(Start { satellites, debris: debris.bodies().collect(), rogues })
    }

    /// The same into memory that is there already.
    ///
    /// # Errors
    /// As [`Setup::start`]; what `draft` then holds is of no use.
    pub(in crate::kessler) fn start_into(
        &self,
        chance: &mut impl Chance,
        draft: Draft<'_>,
    ) -> Result<(), ScenarioError> {
        let Draft { satellites, debris, rogues } = draft;
        *satellites = match self.satellites {
            Some(given) => given,
            None if self.formation => triangle(chance),
            None => [(); SATELLITES].map(|()| {
                let radius = chance.between(Stream::Agents, SATELLITE_RADII.0, SATELLITE_RADII.1);
                Body::circular(radius, TAU * chance.uniform(Stream::Agents), 1.0)
            }),
        };
        debris.clear(self.most_debris());
        scatter::bodies(chance, self.spread, self.debris, debris);
        for body in &self.layout_debris {
            debris.push(*body);
        }
        self.rogues(chance, rogues);
        if self.fair { self.make_fair(chance, satellites, debris, rogues) } else { Ok(()) }
    }

    /// Draws again, each from a substream of its own, what would touch a satellite before anybody could act.
    fn make_fair(
        &self,
        chance: &mut impl Chance,
        satellites: &[Body; SATELLITES],
        debris: &mut Cloud,
        rogues: &[(u32, Body)],
    ) -> Result<(), ScenarioError> {
        let early = EarlyPaths::of(satellites, self.physics);
        for &(arrives, body) in rogues.iter().take_while(|(step, _)| *step <= FAIR_STEPS) {
            if let Some((satellite, step)) = early.touched_by(body, Some(arrives)) {
                return Err(unfair(
                    "layout.bodies.rogues",
                    format!(
                        "the rogue of step {arrives} touches satellite {satellite} at step {step} under hold, before anybody \
                         could act"
                    ),
                ));
            }
        }
        // Bit i: somewhere in block i of eight bodies there is one that touches.
        let mut blocks = early.may_touch(debris);
        while blocks != 0 {
            let first = blocks.trailing_zeros() as usize * BLOCK;
            blocks &= blocks - 1;
            for index in first..(first + BLOCK).min(debris.len()) {
                self.make_one_fair(chance, debris, &early, index)?;
            }
        }
        Ok(())
    }

    fn make_one_fair(
        &self,
        chance: &mut impl Chance,
        debris: &mut Cloud,
        early: &EarlyPaths,
        index: usize,
    ) -> Result<(), ScenarioError> {
        let mut tries = 0;
        while let Some((satellite, step)) = early.touched_by(debris.body(index), None) {
            if index >= self.debris {
                return Err(unfair(
                    &format!("layout.bodies.debris.{}", index - self.debris),
                    format!(
                        "it touches satellite {satellite} at step {step} under hold, before anybody could act"
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
            debris.set(index, self.draw_debris(chance, Stream::Redraw(index as u32)));
        }
        Ok(())
    }

    /// Angle, radius and both velocity offsets are always drawn, so that the same body is drawn at any spread.
    fn draw_debris(&self, chance: &mut impl Chance, stream: Stream) -> Body {
        let mut draws = [0.0; DRAWS];
        chance.fill(stream, &mut draws);
        scatter::body(draws, self.spread)
    }

    /// Rogues do not depend on what anybody does, so all of them are drawn at the start.
    fn rogues(&self, chance: &mut impl Chance, rogues: &mut Vec<(u32, Body)>) {
        rogues.clear();
        rogues.reserve(self.most_rogues());
        rogues.extend_from_slice(&self.layout_rogues);
        if self.rogue_probability > 0.0 && !self.rogues_replaced {
            for step in 1..=HORIZON {
                if chance.uniform(Stream::Arrivals) < self.rogue_probability {
                    let angle = TAU * chance.uniform(Stream::ArrivalPlace);
                    rogues.push((step, Body::circular(ROGUE_RADIUS, angle, self.rogue_speed)));
                }
            }
            if !rogues.is_sorted_by_key(|(step, _)| *step) {
                rogues.sort_by_key(|(step, _)| *step);
            }
        }
    }

    /// Most rogues there can be.
    #[must_use]
    pub fn most_rogues(&self) -> usize {
        let drawn = self.rogue_probability > 0.0 && !self.rogues_replaced;
        self.layout_rogues.len() + if drawn { HORIZON as usize } else { 0 }
    }

    /// Most debris there can be at once.
    #[must_use]
    pub fn most_debris(&self) -> usize {
        self.debris + self.layout_debris.len() + self.most_rogues() + SATELLITES * FRAGMENTS
    }
}

/// An equilateral triangle of random orientation, each satellite on the circular prograde orbit of its own radius.
fn triangle(chance: &mut impl Chance) -> [Body; SATELLITES] {
    let mut draw = || chance.uniform(Stream::Agents);
    let radius = FORMATION_RADII.0 + (FORMATION_RADII.1 - FORMATION_RADII.0) * draw();
    let (sin, cos) = libm::sincos(TAU * draw());
    let turn = TAU * draw();
    let circumradius = FORMATION_SIDE / 3.0f64.sqrt();
    std::array::from_fn(|i| {
        let (dy, dx) = libm::sincos(turn + TAU * i as f64 / SATELLITES as f64);
        let (x, y) = (radius * cos + circumradius * dx, radius * sin + circumradius * dy);
        let r = (x * x + y * y).sqrt();
        let v = (GM / r).sqrt();
        Body { x, y, vx: -v * (y / r), vy: v * (x / r) }
    })
}

/// Where the satellites are under hold at steps 0 to 2.
struct EarlyPaths {
    paths: [[Body; SATELLITES]; FAIR_STEPS as usize + 1],
    physics: Physics,
}

impl EarlyPaths {
    fn of(satellites: &[Body; SATELLITES], physics: Physics) -> Self {
        let mut paths = [*satellites; FAIR_STEPS as usize + 1];
        for step in 1..paths.len() {
            paths[step] = paths[step - 1].map(|body| body.coasted(physics.gravity));
        }
        Self { paths, physics }
    }

    /// Which blocks of bodies have one that touches a satellite in these steps; all, where there are too many to tell.
    fn may_touch(&self, debris: &Cloud) -> u128 {
        if debris.blocks().len() > u128::BITS as usize {
            return u128::MAX;
        }
        let swept = self.physics.contact == Contact::Swept;
        pass::early(self.physics.gravity, swept, debris.blocks(), &self.paths)
    }

    /// The first satellite this body touches, and when. What arrives in a step is put there before it moves: it first counts
    /// where it has moved to.
    fn touched_by(&self, mut body: Body, arrives: Option<u32>) -> Option<(usize, usize)> {
        let swept = self.physics.contact == Contact::Swept;
        let from = arrives.map_or(0, |step| step as usize - 1);
        for (step, satellites) in self.paths.iter().enumerate().skip(from) {
            if step > from {
                body = body.coasted(self.physics.gravity);
            }
            let touched = satellites.iter().position(|s| {
                let counts = arrives.is_none() || step > from;
                let within = counts && distance_2(s.x, s.y, body.x, body.y) < CONTACT_2;
                let crossed = || {
                    let (dx, dy) = (s.x - body.x, s.y - body.y);
                    swept_2(dx, dy, s.vx - body.vx, s.vy - body.vy) < CONTACT_2
                };
                within || (swept && step > from && crossed())
            });
            if let Some(satellite) = touched {
                return Some((satellite, step));
            }
        }
        None
    }
}

fn unfair(field: &str, reason: String) -> ScenarioError {
    ScenarioError::Unfair { field: field.to_owned(), reason }
}
