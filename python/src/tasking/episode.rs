//! An episode that Python composes and steps.

use env_core::tasking::access::{Opportunity, OpportunityKind};
use env_core::tasking::observation::property::Property;
use env_core::tasking::observation::view::Moment;
use env_core::tasking::orbit::GravityModel;
use env_core::tasking::recording::setup::read_setup;
use env_core::tasking::setup::environment::Setup;
use env_core::tasking::simulation::{AgentAction, TaskingSim};
use env_core::tasking::tick::dispatch::InstructionSet;
use numpy::{PyArray1, ToPyArray};
use pyo3::exceptions::{PyIndexError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use super::filter::{RaisedError, access_filter, kind_name};
use super::journal::entry_tuple;
use super::step::NativeTaskingStep;
use crate::errors::invalid;

/// An opportunity: kind, index of its object, opening and close, s.
type OpportunityTuple = (&'static str, usize, f64, f64);

/// An episode of satellite tasking as BSK-RL simulates it.
///
/// Satellites, targets and stations are given by their indices, times in seconds since the start.
#[pyclass(module = "sparring._native")]
#[derive(Debug)]
pub(crate) struct NativeTaskingEpisode {
    sim: TaskingSim,
    set: InstructionSet,
    raised: RaisedError,
    /// Values of the current tick from which the properties of each satellite are computed.
    moments: Vec<Option<TickMoment>>,
}

/// Values of a tick from which properties of a satellite are computed.
#[derive(Debug)]
struct TickMoment {
    tick: u64,
    moment: Moment,
}

#[pymethods]
impl NativeTaskingEpisode {
    /// Starts an episode from a set-up in the format of the recordings of BSK-RL, as JSON. With `journal`, the episode records what
    /// happens to its satellites.
    #[new]
    #[pyo3(signature = (setup, journal=false))]
    fn new(py: Python<'_>, setup: &str, journal: bool) -> PyResult<Self> {
        let setup = read_setup_text(setup).map_err(PyValueError::new_err)?;
        let sim = py.detach(|| TaskingSim::new(setup));
        let mut sim = sim.map_err(|error| PyValueError::new_err(error.to_string()))?;
        if journal {
            sim.keep_journal();
        }
        let moments = (0..sim.len()).map(|_| None).collect();
        Ok(Self { sim, set: InstructionSet::detect(), raised: RaisedError::default(), moments })
    }

    /// Runs a step with the index of an action or of a target to image for each satellite. A satellite with neither goes on.
    #[pyo3(signature = (actions: "list[int | None]", targets: "list[int | None]"))]
    fn step(
        &mut self,
        py: Python<'_>,
        actions: Vec<Option<usize>>,
        targets: Vec<Option<usize>>,
    ) -> PyResult<NativeTaskingStep> {
        if actions.len() != targets.len() {
            return Err(invalid("targets", "as long as `actions`", targets.len()));
        }
        let chosen: Vec<Option<AgentAction>> = actions
            .into_iter()
            .zip(targets)
            .map(|(action, target)| target.map(AgentAction::Target).or(action.map(AgentAction::Index)))
            .collect();
        let (sim, set) = (&mut self.sim, self.set);
        let result = py.detach(|| sim.step(&chosen, set));
        self.raised.check()?;
        result.map(NativeTaskingStep::new).map_err(|error| PyValueError::new_err(error.to_string()))
    }

    /// Time since the start, s.
    #[getter]
    fn time_s(&self) -> f64 {
        self.sim.time_s()
    }

    /// Returns True if a satellite needs a new action.
    fn needs_action(&self, satellite: usize) -> PyResult<bool> {
        self.check(satellite)?;
        Ok(self.sim.needs_action(satellite))
    }

    /// Returns True if a satellite was alive at the end of the last step.
    fn is_alive(&self, satellite: usize) -> PyResult<bool> {
        self.check(satellite)?;
        Ok(self.sim.is_alive(satellite))
    }

    /// Declares a satellite dead: it takes no action any more, and ends no step in a constellation.
    fn set_dead(&mut self, satellite: usize) -> PyResult<()> {
        self.check(satellite)?;
        self.sim.set_dead(satellite);
        Ok(())
    }

    /// Returns the native items of a satellite's observation in order.
    #[pyo3(signature = (satellite) -> "numpy.typing.NDArray[numpy.float64]")]
    fn observe<'py>(&mut self, py: Python<'py>, satellite: usize) -> PyResult<Bound<'py, PyArray1<f64>>> {
        self.check(satellite)?;
        let mut values = Vec::new();
        let result = self.sim.observe(satellite, &mut values);
        self.raised.check()?;
        result.map_err(|error| PyValueError::new_err(error.to_string()))?;
        Ok(values.to_pyarray(py))
    }

    /// Returns the values of a property of a satellite; those of a matrix row by row.
    fn value(&mut self, satellite: usize, property: &str) -> PyResult<Vec<f64>> {
        self.check(satellite)?;
        let property =
            Property::from_name(property).map_err(|error| PyValueError::new_err(error.to_string()))?;
        let tick = self.sim.now();
        let found = match self.moments[satellite].take() {
            Some(found) if found.tick == tick => found,
            _ => TickMoment { tick, moment: self.sim.moment(satellite) },
        };
        let mut values = Vec::with_capacity(property.len());
        property.write(&self.sim.view(satellite, &found.moment), &mut values);
        self.moments[satellite] = Some(found);
        Ok(values)
    }

    /// Returns the stored data of a satellite, bits: of the instrument's partition, and of all others.
    fn stored(&self, satellite: usize) -> PyResult<[f64; 2]> {
        self.check(satellite)?;
        Ok(self.sim.satellite(satellite).stored())
    }

    /// Returns the share of sunlight that the panel of a satellite received in the last tick.
    fn illumination(&self, satellite: usize) -> PyResult<f64> {
        self.check(satellite)?;
        Ok(self.sim.illumination(satellite))
    }

    /// Returns the times at which the next eclipse begins and the next one ends, s; both 1 if there is none within hours.
    fn next_eclipse(&mut self, satellite: usize) -> PyResult<[f64; 2]> {
        self.check(satellite)?;
        Ok(self.sim.next_eclipse(satellite).unwrap_or([1.0; 2]))
    }

    /// Returns all opportunities of a satellite that are computed, in the order of their close.
    fn opportunities(&self, satellite: usize) -> PyResult<Vec<OpportunityTuple>> {
        self.check(satellite)?;
        Ok(self.sim.opportunities(satellite).all().iter().map(opportunity_tuple).collect())
    }

    /// Returns the time up to which the opportunities of a satellite are computed, s.
    fn opportunities_until(&self, satellite: usize) -> PyResult<f64> {
        self.check(satellite)?;
        Ok(self.sim.opportunities(satellite).computed_s())
    }

    /// Computes the opportunities of a satellite for `duration` seconds more, to the end of a block.
    fn compute_opportunities(&mut self, satellite: usize, duration: f64) -> PyResult<()> {
        self.check(satellite)?;
        let result = self.sim.compute_more_opportunities(satellite, duration);
        result.map_err(|error| PyValueError::new_err(error.to_string()))
    }

    /// Returns the next opportunities of a kind, without those that filters hide; fewer than `count` are padded with the last.
    fn next_opportunities(
        &mut self,
        satellite: usize,
        kind: &str,
        count: usize,
    ) -> PyResult<Vec<OpportunityTuple>> {
        self.check(satellite)?;
        let kind = match kind {
            "target" => OpportunityKind::Target,
            "ground_station" => OpportunityKind::GroundStation,
            other => return Err(invalid("kind", "target or ground_station", other)),
        };
        let found = self.sim.next_opportunities(satellite, kind, count);
        self.raised.check()?;
        let found = found.map_err(|error| PyValueError::new_err(error.to_string()))?;
        Ok(found.iter().map(opportunity_tuple).collect())
    }

    /// Sets a condition on the opportunities of a satellite: a function of kind, object, opening and close. None removes it.
    #[pyo3(signature = (satellite, accepts: "collections.abc.Callable[[str, int, float, float], bool] | None"))]
    fn set_access_filter(&mut self, satellite: usize, accepts: Option<Py<PyAny>>) -> PyResult<()> {
        self.check(satellite)?;
        let filter = accepts.map(|accepts| access_filter(accepts, self.raised.clone()));
        self.sim.set_access_filter(satellite, filter);
        Ok(())
    }

    /// Returns the targets that a satellite knows to be imaged.
    fn known_images(&self, satellite: usize) -> PyResult<Vec<usize>> {
        self.check(satellite)?;
        let known = self.sim.known_images(satellite);
        Ok((0..self.sim.targets().len()).filter(|target| known.contains(*target)).collect())
    }

    /// Returns the position of the Sun relative to the Earth in the inertial frame, m.
    fn sun_position(&self) -> [f64; 3] {
        self.sim.sun_position()
    }

    /// Returns the rotation from the inertial to the planet-fixed frame, row by row.
    fn planet_from_inertial(&self) -> Vec<f64> {
        self.sim.planet_from_inertial().concat()
    }

    /// Returns what happened to the satellites since the last call, as tuples of kind, time, satellite and details.
    #[pyo3(signature = () -> "list[tuple[typing.Any, ...]]")]
    fn take_journal<'py>(&mut self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyTuple>>> {
        self.sim.take_journal().iter().map(|entry| entry_tuple(py, entry)).collect()
    }
}

impl NativeTaskingEpisode {
    /// Checks the index of a satellite.
    ///
    /// # Errors
    /// `IndexError` if the episode has no such satellite.
    fn check(&self, satellite: usize) -> PyResult<()> {
        if satellite < self.sim.len() {
            return Ok(());
        }
        Err(PyIndexError::new_err(format!(
            "`satellite` must be less than {}, the number of satellites, got {satellite}",
            self.sim.len()
        )))
    }
}

/// Reads a set-up in the format of the recordings of BSK-RL, JSON text.
///
/// # Errors
/// Says what is wrong with the text or the set-up.
pub(super) fn read_setup_text(setup: &str) -> Result<Setup, String> {
    let value = serde_json::from_str(setup).map_err(|error| format!("`setup`: {error}"))?;
    read_setup(&value, GravityModel::Ggm10)
}

const fn opportunity_tuple(opportunity: &Opportunity) -> OpportunityTuple {
    (kind_name(opportunity.kind), opportunity.object, opportunity.open_s, opportunity.close_s)
}
