//! Arguments of the constructor of a batch.

use std::sync::Arc;

use env_core::TaskSpec;
use env_core::batch::episode_assigner::AssignedScenarios;
use env_core::batch::{Autoreset, Batch, BatchConfig, ObservationMode, ScenarioSource};
use env_core::space::Axes;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::errors::invalid;
use crate::scenario_sequence::{ScenarioSequences, SequenceFeed};

/// Parses an autoreset mode.
///
/// # Errors
/// `ValueError` if the mode is unknown.
pub(super) fn parse_autoreset(mode: &str) -> PyResult<Autoreset> {
    match mode {
        "next_step" => Ok(Autoreset::NextStep),
        "same_step" => Ok(Autoreset::SameStep),
        "disabled" => Ok(Autoreset::Disabled),
        _ => Err(invalid("autoreset_mode", "one of next_step, same_step, disabled", format!("{mode:?}"))),
    }
}

/// Parses an observation mode: "all" or "extended", else tracks.
pub(super) fn parse_observe(
    mode: &str,
    bodies: Option<u32>,
    threats: u32,
    look_ahead: u32,
) -> ObservationMode {
    match mode {
        "all" => ObservationMode::All { bodies },
        "extended" => ObservationMode::Extended,
        _ => ObservationMode::Tracks { threats, look_ahead },
    }
}

/// Parses the axes of continuous actions: "agent", else the world's.
pub(super) fn parse_axes(axes: &str) -> Axes {
    match axes {
        "agent" => Axes::Agent,
        _ => Axes::World,
    }
}

/// Makes a batch that runs assigned episodes or, without a curriculum, scenario sequences.
///
/// # Errors
/// `ValueError` if the task rejects the configuration.
pub(super) fn make_batch(
    task: &'static dyn TaskSpec,
    config: BatchConfig,
    assigned: Option<&AssignedScenarios>,
    sequences: &Arc<ScenarioSequences>,
) -> PyResult<Box<dyn Batch>> {
    let feed: Box<dyn ScenarioSource> = match assigned {
        Some(assigned) => Box::new(assigned.clone()),
        None => Box::new(SequenceFeed(Arc::clone(sequences))),
    };
    let batch = task.batch(feed, config).map_err(|error| PyValueError::new_err(error.to_string()))?;
    sequences.rewind();
    Ok(batch)
}
