//! A recipe read into kessler's own terms, and the start of an episode.

use super::constants::{
    CONTACT_2, EARTH_RADIUS, FAIR_STEPS, FAIR_TRIES, FORMATION_RADII, FORMATION_SIDE, FRAGMENTS, GM, HORIZON,
    RADAR_NONE, ROGUE_RADIUS, SATELLITE_RADII, SATELLITES,
};
use super::kernel::{Body, Gravity, distance_2, swept_2};
use super::pass::{self, BLOCK};
use super::scatter::{self, DRAWS};
use crate::chance::{Chance, Stream};
use crate::error::ScenarioError;
use crate::scenario::{LayoutMode, MAX_LAYOUT_ROWS, Recipe};

/// The task whose satellites start in a triangle.
const FORMATION: &str = "kessler/formation";
const TAU: f64 = std::f64::consts::TAU;
/// Positions and speeds a layout may give, LU and LU/TU: far beyond anything that matters in 50 steps.
const MAX_COORDINATE: f64 = 1000.0;
const MAX_SPEED: f64 = 100.0;

/// What it means to meet debris.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Contact {
    /// Whatever is nearer than contact distance where a step ends destroys a satellite.
    EndOfStep,
    /// Whatever comes nearer than that within the step.
    Swept,
    /// Nothing destroys; every closest approach costs survival, at this standard deviation of the relative position, LU.
    Chance(f64),
}

/// The laws an episode is flown by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Physics {
    /// The public original's arithmetic.
    pub upstream: bool,
    /// What pulls.
    pub gravity: Gravity,
    /// What destroys.
    pub contact: Contact,
}

impl Physics {
    /// With every option at its default: what a pilot that is told nothing else reckons with.
    pub const PLAIN: Self = Self { upstream: false, gravity: Gravity::Point, contact: Contact::EndOfStep };
}

/// Conjunction warnings in the observation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Warnings {
    /// None.
    None,
    /// As the dynamics have it.
    Exact,
    /// With errors that grow with look-ahead.
    Noisy,
}

/// A recipe in kessler's terms.
#[derive(Debug, Clone, PartialEq)]
pub struct Setup {
    /// Satellites start in a triangle.
    formation: bool,
    /// Debris the generator draws.
    pub debris: usize,
    /// Fuel of each satellite.
    pub fuel: f64,
    /// Velocity spread of debris, LU/TU.
    pub spread: f64,
    /// Chance of a rogue per step.
    pub rogue_probability: f64,
    /// Speed of a rogue over circular.
    pub rogue_speed: f64,
    /// Radar range, LU; `None` sees everything.
    pub radar_range: Option<f64>,
    /// Starts are made fair.
    pub fair: bool,
    /// The laws of flight.
    pub physics: Physics,
    /// Conjunction warnings.
    pub warnings: Warnings,
    /// Standard deviation of relative positions, LU.
    pub sigma: f64,
    /// Satellites given by the layout.
    satellites: Option<[Body; SATELLITES]>,
    /// Debris given by the layout.
    layout_debris: Vec<Body>,
    /// Rogues given by the layout: (step, body), by step.
    layout_rogues: Vec<(u32, Body)>,
    /// The layout's rogues stand instead of random ones.
    rogues_replaced: bool,
}

/// Bodies at the start, and rogues to come.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Start {
    /// The satellites.
    pub satellites: [Body; SATELLITES],
    /// Debris in order.
    pub debris: Vec<Body>,
    /// (step, body) by step: a rogue that arrives before the motion of that step (counted from 1).
    pub rogues: Vec<(u32, Body)>,
    /// What debris was drawn from.
    pub(super) draws: Vec<f64>,
}

impl Start {
    /// Bytes of its tables.
    pub(super) fn bytes(&self) -> usize {
        self.draws.capacity() * size_of::<f64>()
            + self.debris.capacity() * size_of::<Body>()
            + self.rogues.capacity() * size_of::<(u32, Body)>()
    }
}

impl Setup {
    /// Reads a recipe.
    ///
    /// # Errors
    /// A layout kessler does not understand, or that contradicts the params.
    pub fn read(recipe: &Recipe) -> Result<Self, ScenarioError> {
        let param = |name: &str| recipe.param(name).unwrap_or(0.0);
        let radar = param("radar_range");
        let mut setup = Self {
            formation: recipe.task().id() == FORMATION,
            debris: param("debris") as usize,
            fuel: param("fuel"),
            spread: param("spread"),
            rogue_probability: param("rogue_probability"),
            rogue_speed: param("rogue_speed"),
            radar_range: (radar < RADAR_NONE).then_some(radar),
            fair: recipe.option("start") == Some("fair"),
            physics: physics(recipe)?,
            warnings: match recipe.option("warnings") {
                Some("exact") => Warnings::Exact,
                Some("noisy") => Warnings::Noisy,
                _ => Warnings::None,
            },
            sigma: param("sigma"),
            satellites: None,
            layout_debris: Vec::new(),
            layout_rogues: Vec::new(),
            rogues_replaced: false,
        };
        if let Some(layout) = recipe.layout() {
            setup.read_layout(layout)?;
        }
        Ok(setup)
    }

    fn read_layout(&mut self, layout: &crate::scenario::Layout) -> Result<(), ScenarioError> {
        let rows: usize = layout.bodies.values().map(Vec::len).sum();
        if rows > MAX_LAYOUT_ROWS {
            return Err(fault("layout.bodies", format!("{rows} rows; at most {MAX_LAYOUT_ROWS} are taken")));
        }
        let replace = layout.mode == LayoutMode::Replace;
        for (table, rows) in &layout.bodies {
            let at = |i: usize| format!("layout.bodies.{table}.{i}");
            match table.as_str() {
                "satellites" => {
                    let bodies: Result<Vec<Body>, _> =
                        rows.iter().enumerate().map(|(i, r)| body(&at(i), r)).collect();
                    let bodies: [Body; SATELLITES] = bodies?.try_into().map_err(|given: Vec<Body>| {
                        fault(
                            "layout.bodies.satellites",
                            format!("{} rows; give all {SATELLITES}", given.len()),
                        )
                    })?;
                    self.satellites = Some(bodies);
                }
                "debris" => {
                    for (i, row) in rows.iter().enumerate() {
                        self.layout_debris.push(body(&at(i), row)?);
                    }
                    if replace {
                        if self.debris != rows.len() {
                            return Err(fault(
                                "params.debris",
                                format!(
                                    "it is {}, but the layout replaces debris by {}",
                                    self.debris,
                                    rows.len()
                                ),
                            ));
                        }
                        self.debris = 0;
                    }
                }
                "rogues" => {
                    for (i, row) in rows.iter().enumerate() {
                        self.layout_rogues.push(rogue(&at(i), row)?);
                    }
                    self.layout_rogues.sort_by_key(|(step, _)| *step);
                    self.rogues_replaced = replace;
                }
                _ => {
                    return Err(ScenarioError::UnknownField {
                        field: format!("layout.bodies.{}", table.chars().take(60).collect::<String>()),
                        known: "satellites, debris, rogues".to_owned(),
                    });
                }
            }
        }
        Ok(())
    }

    /// Draws what the layout does not give.
    ///
    /// # Errors
    /// `Unfair`, where `start: fair` cannot be had: by a layout's body, or after 64 tries at one that is drawn.
    pub fn start(&self, chance: &mut impl Chance) -> Result<Start, ScenarioError> {
        let mut start = Start::default();
        self.start_into(chance, &mut start)?;
        Ok(start)
    }

    /// The same into memory that is there already.
    ///
    /// # Errors
    /// As [`Setup::start`]; what `start` then holds is of no use.
    pub fn start_into(&self, chance: &mut impl Chance, start: &mut Start) -> Result<(), ScenarioError> {
        start.satellites = match self.satellites {
            Some(given) => given,
            None if self.formation => triangle(chance),
            None => [(); SATELLITES].map(|()| {
                let radius = chance.between(Stream::Agents, SATELLITE_RADII.0, SATELLITE_RADII.1);
                Body::circular(radius, TAU * chance.uniform(Stream::Agents), 1.0)
            }),
        };
        start.draws.clear();
        start.draws.resize(self.debris * DRAWS, 0.0);
        chance.fill(Stream::Bodies, &mut start.draws);
        scatter::bodies(&start.draws, self.spread, &mut start.debris);
        start.debris.extend_from_slice(&self.layout_debris);
        if self.fair {
            self.make_fair(chance, start)?;
        }
        self.rogues(chance, &mut start.rogues);
        Ok(())
    }

    /// Draws again, each from a substream of its own, what would touch a satellite before anybody could act.
    fn make_fair(&self, chance: &mut impl Chance, start: &mut Start) -> Result<(), ScenarioError> {
        let early = EarlyPaths::of(&start.satellites, self.physics);
        // Bit i: somewhere in block i of eight bodies there is one that touches.
        let mut blocks = early.may_touch(&start.debris);
        while blocks != 0 {
            let first = blocks.trailing_zeros() as usize * BLOCK;
            blocks &= blocks - 1;
            for index in first..(first + BLOCK).min(start.debris.len()) {
                self.make_one_fair(chance, start, &early, index)?;
            }
        }
        Ok(())
    }

    fn make_one_fair(
        &self,
        chance: &mut impl Chance,
        start: &mut Start,
        early: &EarlyPaths,
        index: usize,
    ) -> Result<(), ScenarioError> {
        let mut tries = 0;
        while let Some((satellite, step)) = early.touched_by(start.debris[index]) {
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
            start.debris[index] = self.draw_debris(chance, Stream::Redraw(index as u32));
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

/// The laws of flight, where they do not contradict each other.
fn physics(recipe: &Recipe) -> Result<Physics, ScenarioError> {
    let is = |option: &str, choice: &str| recipe.option(option) == Some(choice);
    let physics = Physics {
        upstream: is("compat", "upstream"),
        gravity: if is("gravity", "j2") { Gravity::J2 } else { Gravity::Point },
        contact: match (is("contact", "swept"), is("risk", "pc")) {
            (_, true) => Contact::Chance(recipe.param("sigma").unwrap_or(0.0)),
            (true, false) => Contact::Swept,
            (false, false) => Contact::EndOfStep,
        },
    };
    let clash = |option: &str, with: &str, why: &str| {
        Err(fault(&format!("physics.{option}"), format!("it cannot be had together with {with}: {why}")))
    };
    if is("contact", "swept") && is("risk", "pc") {
        return clash("contact", "risk: pc", "under it no contact destroys, so there is none to sweep for");
    }
    if physics.upstream {
        let why = "that is the public original's arithmetic, to the bit";
        if physics.gravity == Gravity::J2 {
            return clash("gravity", "compat: upstream", why);
        }
        if is("contact", "swept") {
            return clash("contact", "compat: upstream", why);
        }
        if is("risk", "pc") {
            return clash("risk", "compat: upstream", why);
        }
    }
    Ok(physics)
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
    fn may_touch(&self, bodies: &[Body]) -> u128 {
        if bodies.len() > BLOCK * u128::BITS as usize {
            return u128::MAX;
        }
        let swept = self.physics.contact == Contact::Swept;
        pass::early(self.physics.gravity, swept, bodies, &self.paths)
    }

    /// The first satellite this body touches, and when.
    fn touched_by(&self, mut body: Body) -> Option<(usize, usize)> {
        let swept = self.physics.contact == Contact::Swept;
        for (step, satellites) in self.paths.iter().enumerate() {
            if step > 0 {
                body = body.coasted(self.physics.gravity);
            }
            let touched = satellites.iter().position(|s| {
                let within = distance_2(s.x, s.y, body.x, body.y) < CONTACT_2;
                let crossed = || {
                    let (dx, dy) = (s.x - body.x, s.y - body.y);
                    swept_2(dx, dy, s.vx - body.vx, s.vy - body.vy) < CONTACT_2
                };
                within || (swept && step > 0 && crossed())
            });
            if let Some(satellite) = touched {
                return Some((satellite, step));
            }
        }
        None
    }
}

fn body(field: &str, row: &[f64]) -> Result<Body, ScenarioError> {
    let &[x, y, vx, vy] = row else {
        return Err(fault(field, format!("{} numbers; a body is x, y, vx, vy", row.len())));
    };
    placed(field, 0, Body { x, y, vx, vy })
}

/// A body whose columns start at `first`.
fn placed(field: &str, first: usize, body: Body) -> Result<Body, ScenarioError> {
    let columns =
        [(body.x, MAX_COORDINATE), (body.y, MAX_COORDINATE), (body.vx, MAX_SPEED), (body.vy, MAX_SPEED)];
    for (column, (value, max)) in (first..).zip(columns) {
        within(&format!("{field}.{column}"), value, -max, max)?;
    }
    if body.radius() < EARTH_RADIUS {
        return Err(fault(
            field,
            format!("it starts inside the Earth, {:.1} LU from its centre", body.radius()),
        ));
    }
    Ok(body)
}

fn rogue(field: &str, row: &[f64]) -> Result<(u32, Body), ScenarioError> {
    let &[step, x, y, vx, vy] = row else {
        return Err(fault(field, format!("{} numbers; a rogue is step, x, y, vx, vy", row.len())));
    };
    let at = format!("{field}.0");
    within(&at, step, 1.0, f64::from(HORIZON))?;
    if libm::floor(step) != step {
        let wanted = "a whole number".to_owned();
        return Err(ScenarioError::WrongType { field: at, found: step.to_string(), wanted });
    }
    Ok((step as u32, placed(field, 1, Body { x, y, vx, vy })?))
}

fn within(field: &str, value: f64, min: f64, max: f64) -> Result<(), ScenarioError> {
    if value >= min && value <= max {
        Ok(())
    } else {
        Err(ScenarioError::OutOfRange { field: field.to_owned(), value, min, max })
    }
}

fn fault(field: &str, reason: String) -> ScenarioError {
    ScenarioError::Layout { field: field.to_owned(), reason }
}

fn unfair(field: &str, reason: String) -> ScenarioError {
    ScenarioError::Unfair { field: field.to_owned(), reason }
}
