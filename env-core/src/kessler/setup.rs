//! A recipe read into kessler's own terms.

mod start;

use std::fmt::Arguments;

pub(super) use self::start::Draft;
pub use self::start::Start;
use super::constants::{EARTH_RADIUS, HORIZON, RADAR_NONE, SATELLITES};
use super::kernel::{Body, Gravity};
use super::reward::Objective;
use super::spaces::MAX_DEBRIS;
use crate::error::ScenarioError;
use crate::scenario::{LayoutMode, MAX_LAYOUT_ROWS, Recipe};

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

impl Setup {
    /// Reads a recipe.
    ///
    /// # Errors
    /// A layout kessler does not understand, or that contradicts the params.
    pub fn read(recipe: &Recipe) -> Result<Self, ScenarioError> {
        let param = |name: &str| recipe.param(name).unwrap_or(0.0);
        let radar = param("radar_range");
        let mut setup = Self {
            formation: super::objective(recipe.task().id()) == Some(Objective::Formation),
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
            match table.as_str() {
                "satellites" => {
                    let bodies: [Body; SATELLITES] =
                        bodies(table, rows)?.try_into().map_err(|given: Vec<Body>| {
                            fault(
                                "layout.bodies.satellites",
                                format!("{} rows; give all {SATELLITES}", given.len()),
                            )
                        })?;
                    self.satellites = Some(bodies);
                }
                "debris" => {
                    self.layout_debris = bodies(table, rows)?;
                    if replace {
                        if self.debris != rows.len() {
                            return Err(fault(
                                "params.debris",
                                format!(
                                    "it is {}, but the layout replaces debris by {}: say {1}",
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
                        self.layout_rogues.push(rogue(format_args!("layout.bodies.{table}.{i}"), row)?);
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
        let (drawn, given) = (self.debris, self.layout_debris.len());
        if (drawn + given) as f64 > MAX_DEBRIS {
            return Err(fault(
                "layout.bodies.debris",
                format!("{given} beside {drawn} that are drawn; a scenario has at most {MAX_DEBRIS} in all"),
            ));
        }
        Ok(())
    }
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

fn bodies(table: &str, rows: &[Vec<f64>]) -> Result<Vec<Body>, ScenarioError> {
    let numbered = rows.iter().enumerate();
    numbered.map(|(i, row)| body(format_args!("layout.bodies.{table}.{i}"), row)).collect()
}

fn body(field: Arguments<'_>, row: &[f64]) -> Result<Body, ScenarioError> {
    let &[x, y, vx, vy] = row else {
        return Err(fault(&field.to_string(), format!("{} numbers; a body is x, y, vx, vy", row.len())));
    };
    placed(field, 0, Body { x, y, vx, vy })
}

/// A body whose columns start at `first`.
fn placed(field: Arguments<'_>, first: usize, body: Body) -> Result<Body, ScenarioError> {
    let columns =
        [(body.x, MAX_COORDINATE), (body.y, MAX_COORDINATE), (body.vx, MAX_SPEED), (body.vy, MAX_SPEED)];
    for (column, (value, max)) in (first..).zip(columns) {
        within(format_args!("{field}.{column}"), value, -max, max)?;
    }
    if body.radius() < EARTH_RADIUS {
        return Err(fault(
            &field.to_string(),
            format!("it starts inside the Earth, {:.1} LU from its centre", body.radius()),
        ));
    }
    Ok(body)
}

fn rogue(field: Arguments<'_>, row: &[f64]) -> Result<(u32, Body), ScenarioError> {
    let &[step, x, y, vx, vy] = row else {
        return Err(fault(
            &field.to_string(),
            format!("{} numbers; a rogue is step, x, y, vx, vy", row.len()),
        ));
    };
    within(format_args!("{field}.0"), step, 1.0, f64::from(HORIZON))?;
    if libm::floor(step) != step {
        let wanted = "a whole number".to_owned();
        return Err(ScenarioError::WrongType {
            field: format!("{field}.0"),
            found: step.to_string(),
            wanted,
        });
    }
    Ok((step as u32, placed(field, 1, Body { x, y, vx, vy })?))
}

fn within(field: Arguments<'_>, value: f64, min: f64, max: f64) -> Result<(), ScenarioError> {
    if value >= min && value <= max {
        Ok(())
    } else {
        Err(ScenarioError::OutOfRange { field: field.to_string(), value, min, max })
    }
}

fn fault(field: &str, reason: String) -> ScenarioError {
    ScenarioError::Layout { field: field.to_owned(), reason }
}
