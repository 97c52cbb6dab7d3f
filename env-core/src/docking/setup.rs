//! Parameters of an episode, read from a recipe, and sampling of its start.

use super::constants::{
    DOCKING_RADIUS_M, MAX_DEPUTIES, MAX_DISTANCE_M, MIN_SCALED_TIME_S, MIN_START_DISTANCE_M, MIN_START_RATIO,
    SCALED_TIME_S_PER_M, SPEED_SCALE_RATIO, START_AZIMUTH_RAD, START_ELEVATION_RAD, START_SEPARATION_M,
    START_STAGGER_M, START_TRIES, STATE_DIM, TIME_LIMIT_S,
};
use super::relative_motion::{RelativeState, distance, separation, speed_limit};
use crate::episode_rng::{EpisodeRng, RngStream};
use crate::error::ScenarioError;
use crate::space::START_SCALE;
use crate::task::{Layout, LayoutMode, Recipe};
use crate::text::{MAX_QUOTED_CHARS, shorten};

/// Largest speed per axis in a layout, m/s.
pub const MAX_LAYOUT_SPEED_M_S: f64 = 10.0;

/// Parameters of an episode, read from a recipe.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DockingSetup {
    /// Number of deputies, 1 to 5.
    pub deputies: usize,
    /// Largest distance from the chief at the start, m.
    pub start_radius: f64,
    /// Largest speed at the start divided by the speed limit there.
    pub speed_ratio: f64,
    /// Factor of the drawn start distances, at most 1. Below 1, speeds and the time limit shrink, too.
    pub start_scale: f64,
    /// Time limit of the episode in steps of one second, at most that of the recipe.
    pub time_limit: u32,
    /// Time limit of the recipe in steps of one second.
    pub recipe_time_limit: u32,
    /// Largest thrust per axis, N.
    pub thrust_bound: f64,
    /// The start that the layout specifies, if any.
    layout_starts: Option<DeputyStarts>,
}

/// Initial states of all deputies, and the time limit that belongs to them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeputyStarts {
    /// Number of deputies; states from this index on are unused.
    pub deputies: usize,
    /// State of each deputy.
    pub states: [RelativeState; MAX_DEPUTIES],
    /// Time limit of the episode in steps of one second.
    pub time_limit: u32,
}

impl DeputyStarts {
    /// Starts of deputies at the chief, to be filled in.
    #[must_use]
    pub const fn at_chief(deputies: usize, time_limit: u32) -> Self {
        Self { deputies, states: [[0.0; STATE_DIM]; MAX_DEPUTIES], time_limit }
    }
}

impl DockingSetup {
    /// Reads the parameters of a recipe.
    ///
    /// # Errors
    /// Returns an error if the layout is invalid or contradicts the params.
    pub fn read(recipe: &Recipe) -> Result<Self, ScenarioError> {
        let param = |name: &str, or: f64| recipe.param(name).unwrap_or(or);
        let time_limit = param("time_limit_s", TIME_LIMIT_S) as u32;
        let mut setup = Self {
            deputies: (param("deputies", 1.0) as usize).clamp(1, MAX_DEPUTIES),
            start_radius: param("start_radius", 150.0),
            speed_ratio: param("speed_ratio", 0.8),
            start_scale: param(START_SCALE.name, START_SCALE.default),
            time_limit,
            recipe_time_limit: time_limit,
            thrust_bound: param("thrust_bound", 1.0),
            layout_starts: None,
        };
        if let Some(layout) = recipe.layout() {
            setup.layout_starts = setup.read_layout(layout)?;
        }
        Ok(setup)
    }

    fn read_layout(&self, layout: &Layout) -> Result<Option<DeputyStarts>, ScenarioError> {
        if let Some(table) = layout.bodies.keys().find(|table| *table != "deputies") {
            return Err(ScenarioError::UnknownField {
                field: format!("layout.bodies.{}", shorten(table, MAX_QUOTED_CHARS)),
                known: "deputies".to_owned(),
            });
        }
        let Some(rows) = layout.bodies.get("deputies") else { return Ok(None) };
        if layout.mode != LayoutMode::Replace {
            return Err(ScenarioError::layout(
                "layout.mode",
                "must be replace: the task determines the number of deputies",
            ));
        }
        if rows.len() != self.deputies {
            return Err(ScenarioError::layout(
                "layout.bodies.deputies",
                format!("must have {} rows, one for each deputy, got {}", self.deputies, rows.len()),
            ));
        }
        let mut start = DeputyStarts::at_chief(self.deputies, self.recipe_time_limit);
        for (i, row) in rows.iter().enumerate() {
            let field = format!("layout.bodies.deputies.{i}");
            start.states[i] = read_deputy(&field, row)?;
            if let Some((other, apart)) = find_too_close(&start.states[..i], &start.states[i]) {
                return Err(ScenarioError::layout(
                    field,
                    format!(
                        "must start at least {START_SEPARATION_M} m from deputy {other}, got {apart:.2} m"
                    ),
                ));
            }
        }
        Ok(Some(start))
    }

    /// Returns the layout's start, or samples one.
    ///
    /// # Errors
    /// Returns [`ScenarioError::Unfair`] if a deputy is too close to another after [`START_TRIES`] redraws.
    pub fn sample_starts(&self, rng: &mut impl EpisodeRng) -> Result<DeputyStarts, ScenarioError> {
        if let Some(given) = self.layout_starts {
            return Ok(given);
        }
        let mut start = DeputyStarts::at_chief(self.deputies, self.recipe_time_limit);
        for i in 0..self.deputies {
            let stagger = START_STAGGER_M * i as f64;
            let mut state = self.sample_state(rng, RngStream::Agents, stagger);
            let mut tries = 0;
            while let Some((other, _)) = find_too_close(&start.states[..i], &state) {
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
                state = self.sample_state(rng, RngStream::Redraw(i as u32), stagger);
            }
            start.states[i] = state;
        }
        start.time_limit = self.scaled_time_limit(&start);
        Ok(start)
    }

    /// Time limit for starts at these distances, in steps of one second.
    ///
    /// A scaled start has ten seconds for each metre of the largest distance, twice what the speed limit at the chief allows, but at
    /// least [`MIN_SCALED_TIME_S`].
    fn scaled_time_limit(&self, start: &DeputyStarts) -> u32 {
        if self.start_scale >= 1.0 {
            return self.recipe_time_limit;
        }
        let farthest = start.states[..start.deputies].iter().map(distance).fold(0.0, f64::max);
        let seconds = libm::ceil(farthest * SCALED_TIME_S_PER_M).max(MIN_SCALED_TIME_S);
        self.recipe_time_limit.min(seconds as u32)
    }

    /// Samples the state of a deputy by six draws: distance, azimuth and elevation of the position; speed, azimuth and
    /// elevation of the velocity. The number is fixed, so that more deputies do not change the first ones, and other params
    /// do not change the directions.
    fn sample_state(&self, rng: &mut impl EpisodeRng, stream: RngStream, stagger: f64) -> RelativeState {
        let drawn = rng.uniform_in(stream, self.start_radius * MIN_START_RATIO, self.start_radius);
        let scaled = (drawn * self.start_scale).max(MIN_START_DISTANCE_M) + stagger;
        // A scale of 1 keeps every bit.
        let radius = scaled.min(drawn);
        let [x, y, z] = sample_direction(rng, stream);
        let ratio = self.speed_ratio * (SPEED_SCALE_RATIO * self.start_scale).min(1.0);
        let speed = rng.uniform_in(stream, 0.0, ratio) * speed_limit(radius);
        let [vx, vy, vz] = sample_direction(rng, stream);
        [radius * x, radius * y, radius * z, speed * vx, speed * vy, speed * vz]
    }
}

/// Samples a unit vector by uniform azimuth and elevation, as in the original, so it is denser towards the poles.
fn sample_direction(rng: &mut impl EpisodeRng, stream: RngStream) -> [f64; 3] {
    let (sin_azimuth, cos_azimuth) = libm::sincos(rng.uniform_in(stream, 0.0, START_AZIMUTH_RAD));
    let elevation = rng.uniform_in(stream, -START_ELEVATION_RAD, START_ELEVATION_RAD);
    let (sin_elevation, cos_elevation) = libm::sincos(elevation);
    [cos_azimuth * cos_elevation, sin_azimuth * cos_elevation, sin_elevation]
}

/// The first of `others` that is too close to `state` for a start: its index and its distance in m.
fn find_too_close(others: &[RelativeState], state: &RelativeState) -> Option<(usize, f64)> {
    let apart = others.iter().map(|other| separation(other, state)).enumerate();
    apart.into_iter().find(|(_, apart)| *apart < START_SEPARATION_M)
}

fn read_deputy(field: &str, row: &[f64]) -> Result<RelativeState, ScenarioError> {
    let Ok(state) = RelativeState::try_from(row) else {
        return Err(ScenarioError::layout(
            field,
            format!("must be a list of x, y, z, vx, vy, vz, got {} numbers", row.len()),
        ));
    };
    for (column, &value) in state.iter().enumerate() {
        let max = if column < 3 { MAX_DISTANCE_M } else { MAX_LAYOUT_SPEED_M_S };
        ScenarioError::check_range(format_args!("{field}.{column}"), value, -max, max)?;
    }
    let away = distance(&state);
    if away <= DOCKING_RADIUS_M {
        return Err(ScenarioError::layout(
            field,
            format!(
                "must start more than {DOCKING_RADIUS_M} m from the chief (the docking radius), got {away:.2} m"
            ),
        ));
    }
    if away > MAX_DISTANCE_M {
        return Err(ScenarioError::layout(
            field,
            format!("must start at most {MAX_DISTANCE_M} m from the chief, got {away:.0} m"),
        ));
    }
    Ok(state)
}
