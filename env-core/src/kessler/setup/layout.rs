//! Parses the bodies of a recipe's layout and checks them against their bounds.

use std::fmt::Arguments;

use super::{KesslerSetup, RogueArrival};
use crate::error::ScenarioError;
use crate::kessler::constants::{EARTH_RADIUS, HORIZON, SATELLITES};
use crate::kessler::kernel::Body;
use crate::kessler::spaces::MAX_DEBRIS;
use crate::number_format::format_shortest;
use crate::task::{Layout, LayoutMode, MAX_LAYOUT_ROWS};
use crate::text::{MAX_QUOTED_CHARS, shorten};

/// Largest coordinate of a layout's body, LU: far beyond anything that matters in 50 steps.
const MAX_COORDINATE: f64 = 1000.0;
/// Largest velocity component of a layout's body, LU/TU.
const MAX_SPEED: f64 = 100.0;

impl KesslerSetup {
    /// Adds the bodies of a layout.
    ///
    /// # Errors
    /// Returns [`ScenarioError`] if a table or row is invalid, or if the number of rows contradicts the
    /// params.
    pub(super) fn read_layout(&mut self, layout: &Layout) -> Result<(), ScenarioError> {
        let rows: usize = layout.bodies.values().map(Vec::len).sum();
        if rows > MAX_LAYOUT_ROWS {
            let reason = format!("must have at most {MAX_LAYOUT_ROWS} rows, got {rows}");
            return Err(ScenarioError::layout("layout.bodies", reason));
        }
        let replace = layout.mode == LayoutMode::Replace;
        for (table, rows) in &layout.bodies {
            match table.as_str() {
                "satellites" => self.layout_satellites = Some(parse_satellites(table, rows)?),
                "debris" => {
                    self.layout_debris = parse_bodies(table, rows)?;
                    if replace {
                        self.replace_debris(rows.len())?;
                    }
                }
                "rogues" => {
                    for (i, row) in rows.iter().enumerate() {
                        self.layout_rogues.push(parse_rogue(format_args!("layout.bodies.{table}.{i}"), row)?);
                    }
                    self.layout_rogues.sort_by_key(|rogue| rogue.step);
                    self.replaces_rogues = replace;
                }
                _ => {
                    return Err(ScenarioError::UnknownField {
                        field: format!("layout.bodies.{}", shorten(table, MAX_QUOTED_CHARS)),
                        known: "satellites, debris, rogues".to_owned(),
                    });
                }
            }
        }
        let (drawn, given) = (self.debris, self.layout_debris.len());
        if (drawn + given) as f64 > MAX_DEBRIS {
            return Err(ScenarioError::layout(
                "layout.bodies.debris",
                format!(
                    "must have at most {MAX_DEBRIS} rows together with the {drawn} drawn bodies, got {given}"
                ),
            ));
        }
        Ok(())
    }

    /// Draws no debris, since the layout gives `rows` of it. `params.debris` must say the same number.
    fn replace_debris(&mut self, rows: usize) -> Result<(), ScenarioError> {
        if self.debris != rows {
            return Err(ScenarioError::layout(
                "params.debris",
                format!("must be {rows}, the debris of the layout, got {}", self.debris),
            ));
        }
        self.debris = 0;
        Ok(())
    }
}

fn parse_satellites(table: &str, rows: &[Vec<f64>]) -> Result<[Body; SATELLITES], ScenarioError> {
    parse_bodies(table, rows)?.try_into().map_err(|given: Vec<Body>| {
        let reason = format!("must have {SATELLITES} rows, got {}", given.len());
        ScenarioError::layout("layout.bodies.satellites", reason)
    })
}

fn parse_bodies(table: &str, rows: &[Vec<f64>]) -> Result<Vec<Body>, ScenarioError> {
    let numbered = rows.iter().enumerate();
    numbered.map(|(i, row)| parse_body(format_args!("layout.bodies.{table}.{i}"), row)).collect()
}

fn parse_body(field: Arguments<'_>, row: &[f64]) -> Result<Body, ScenarioError> {
    let &[x, y, vx, vy] = row else {
        let reason = format!("must be a list of x, y, vx, vy, got {} numbers", row.len());
        return Err(ScenarioError::layout(field.to_string(), reason));
    };
    check_body(field, 0, Body { x, y, vx, vy })
}

fn parse_rogue(field: Arguments<'_>, row: &[f64]) -> Result<RogueArrival, ScenarioError> {
    let &[step, x, y, vx, vy] = row else {
        let reason = format!("must be a list of step, x, y, vx, vy, got {} numbers", row.len());
        return Err(ScenarioError::layout(field.to_string(), reason));
    };
    ScenarioError::check_range(format_args!("{field}.0"), step, 1.0, f64::from(HORIZON))?;
    if libm::floor(step) != step {
        let wanted = "an integer".to_owned();
        return Err(ScenarioError::WrongType {
            field: format!("{field}.0"),
            found: format_shortest(step),
            wanted,
        });
    }
    Ok(RogueArrival { step: step as u32, body: check_body(field, 1, Body { x, y, vx, vy })? })
}

/// Checks the bounds of a body whose columns start at `first_column` of its row.
fn check_body(field: Arguments<'_>, first_column: usize, body: Body) -> Result<Body, ScenarioError> {
    let columns =
        [(body.x, MAX_COORDINATE), (body.y, MAX_COORDINATE), (body.vx, MAX_SPEED), (body.vy, MAX_SPEED)];
    for (column, (value, max)) in (first_column..).zip(columns) {
        ScenarioError::check_range(format_args!("{field}.{column}"), value, -max, max)?;
    }
    if body.radius() < EARTH_RADIUS {
        let reason = format!(
            "must start outside the Earth (radius {EARTH_RADIUS} LU), got a distance of {:.1} LU",
            body.radius()
        );
        return Err(ScenarioError::layout(field.to_string(), reason));
    }
    Ok(body)
}
