//! A recipe read into docking's own terms, and the start of an episode.

use super::constants::{
    DOCKING_RADIUS_M, INNER_RATIO, MAX_DEPUTIES, MAX_DISTANCE_M, START_AZIMUTH_RAD, START_ELEVATION_RAD,
    START_SEPARATION_M, START_TRIES, STATE,
};
use super::relative::{State, distance, separation, speed_limit};
use crate::chance::{Chance, Stream};
use crate::error::ScenarioError;
use crate::scenario::{Layout, LayoutMode, Recipe};

/// Largest speed per axis a layout may give, m/s.
pub const MAX_LAYOUT_SPEED_M_S: f64 = 10.0;

/// A recipe in docking's terms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setup {
    /// Deputies, 1 to 5.
    pub deputies: usize,
    /// Largest distance at the start, m.
    pub start_radius: f64,
    /// Largest speed at the start over the speed limit there.
    pub speed_ratio: f64,
    /// Steps, of one second each, after which time is out.
    pub time_limit: u32,
    /// Largest thrust per axis, N.
    pub thrust_bound: f64,
    /// The start, where the layout gives it.
    given: Option<Start>,
}

/// The deputies at the start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Start {
    /// How many there are; the other states mean nothing.
    pub deputies: usize,
    /// Their states.
    pub states: [State; MAX_DEPUTIES],
}

impl Setup {
    /// Reads a recipe.
    ///
    /// # Errors
    /// A layout docking does not understand, or that contradicts the params.
    pub fn read(recipe: &Recipe) -> Result<Self, ScenarioError> {
        let param = |name: &str, or: f64| recipe.param(name).unwrap_or(or);
        let mut setup = Self {
            deputies: (param("deputies", 1.0) as usize).clamp(1, MAX_DEPUTIES),
            start_radius: param("start_radius", 150.0),
            speed_ratio: param("speed_ratio", 0.8),
            time_limit: param("time_limit_s", 2000.0) as u32,
            thrust_bound: param("thrust_bound", 1.0),
            given: None,
        };
        if let Some(layout) = recipe.layout() {
            setup.given = setup.read_layout(layout)?;
        }
        Ok(setup)
    }

    fn read_layout(&self, layout: &Layout) -> Result<Option<Start>, ScenarioError> {
        if let Some(table) = layout.bodies.keys().find(|table| *table != "deputies") {
            return Err(ScenarioError::UnknownField {
                field: format!("layout.bodies.{}", table.chars().take(60).collect::<String>()),
                known: "deputies".to_owned(),
            });
        }
        let Some(rows) = layout.bodies.get("deputies") else { return Ok(None) };
        if layout.mode != LayoutMode::Replace {
            return Err(fault(
                "layout.mode",
                "it is extend, but the deputies are as many as the task says; use replace".to_owned(),
            ));
        }
        if rows.len() != self.deputies {
            return Err(fault(
                "layout.bodies.deputies",
                format!("{} rows, but there are {} deputies; give all of them", rows.len(), self.deputies),
            ));
        }
        let mut start = Start { deputies: self.deputies, states: [[0.0; STATE]; MAX_DEPUTIES] };
        for (i, row) in rows.iter().enumerate() {
            let field = format!("layout.bodies.deputies.{i}");
            start.states[i] = deputy(&field, row)?;
            if let Some((other, apart)) = too_close(&start.states[..i], &start.states[i]) {
                return Err(fault(
                    &field,
                    format!("it starts {apart:.2} m from deputy {other}, closer than {START_SEPARATION_M} m"),
                ));
            }
        }
        Ok(Some(start))
    }

    /// Draws what the layout does not give.
    ///
    /// # Errors
    /// `Unfair`, where a deputy was drawn too close to another 64 times.
    pub fn start(&self, chance: &mut impl Chance) -> Result<Start, ScenarioError> {
        if let Some(given) = self.given {
            return Ok(given);
        }
        let mut start = Start { deputies: self.deputies, states: [[0.0; STATE]; MAX_DEPUTIES] };
        for i in 0..self.deputies {
            let mut drawn = self.draw(chance, Stream::Agents);
            let mut tries = 0;
            while let Some((other, _)) = too_close(&start.states[..i], &drawn) {
                if tries == START_TRIES {
                    return Err(ScenarioError::Unfair {
                        field: "params.start_radius".to_owned(),
                        reason: format!(
                            "deputy {i} was drawn closer than {START_SEPARATION_M} m to deputy {other} or another in \
                             {START_TRIES} tries"
                        ),
                    });
                }
                tries += 1;
                drawn = self.draw(chance, Stream::Redraw(i as u32));
            }
            start.states[i] = drawn;
        }
        Ok(start)
    }

    /// Six draws a deputy, so that more deputies keep the first and other params keep the directions: distance, azimuth
    /// and elevation; speed, and the same two angles of the velocity.
    fn draw(&self, chance: &mut impl Chance, stream: Stream) -> State {
        let radius = chance.between(stream, self.start_radius * INNER_RATIO, self.start_radius);
        let [x, y, z] = direction(chance, stream);
        let speed = chance.between(stream, 0.0, self.speed_ratio) * speed_limit(radius);
        let [vx, vy, vz] = direction(chance, stream);
        [radius * x, radius * y, radius * z, speed * vx, speed * vy, speed * vz]
    }
}

/// A unit vector by an azimuth and an elevation drawn evenly, as in the original: denser towards the poles.
fn direction(chance: &mut impl Chance, stream: Stream) -> [f64; 3] {
    let (sin_azimuth, cos_azimuth) = libm::sincos(chance.between(stream, 0.0, START_AZIMUTH_RAD));
    let elevation = chance.between(stream, -START_ELEVATION_RAD, START_ELEVATION_RAD);
    let (sin_elevation, cos_elevation) = libm::sincos(elevation);
    [cos_azimuth * cos_elevation, sin_azimuth * cos_elevation, sin_elevation]
}

/// The first of `others` that `state` is too close to start beside, and how far it is.
fn too_close(others: &[State], state: &State) -> Option<(usize, f64)> {
    let apart = others.iter().map(|other| separation(other, state)).enumerate();
    apart.into_iter().find(|(_, apart)| *apart < START_SEPARATION_M)
}

fn deputy(field: &str, row: &[f64]) -> Result<State, ScenarioError> {
    let Ok(state) = State::try_from(row) else {
        return Err(fault(field, format!("{} numbers; a deputy is x, y, z, vx, vy, vz", row.len())));
    };
    for (column, &value) in state.iter().enumerate() {
        let max = if column < 3 { MAX_DISTANCE_M } else { MAX_LAYOUT_SPEED_M_S };
        if value.is_nan() || value.abs() > max {
            return Err(ScenarioError::OutOfRange {
                field: format!("{field}.{column}"),
                value,
                min: -max,
                max,
            });
        }
    }
    let away = distance(&state);
    if away <= DOCKING_RADIUS_M {
        return Err(fault(
            field,
            format!(
                "it starts inside the docking radius, {away:.2} m from the chief; the radius is {DOCKING_RADIUS_M} m"
            ),
        ));
    }
    if away > MAX_DISTANCE_M {
        return Err(fault(field, format!("it starts out of bounds, {away:.0} m from the chief")));
    }
    Ok(state)
}

fn fault(field: &str, reason: String) -> ScenarioError {
    ScenarioError::Layout { field: field.to_owned(), reason }
}
