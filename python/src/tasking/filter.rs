//! Conditions on opportunities that are Python functions.

use std::sync::{Arc, Mutex, PoisonError};

use env_core::tasking::access::{Opportunity, OpportunityKind};
use env_core::tasking::simulation::access_filter::AccessFilter;
use pyo3::prelude::*;

/// The first exception that a filter of an episode raised, until the call that ran the filter raises it.
#[derive(Debug, Clone, Default)]
pub(super) struct RaisedError(Arc<Mutex<Option<PyErr>>>);

impl RaisedError {
    /// Keeps an exception, unless there is an earlier one.
    fn keep(&self, error: PyErr) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
    }

    /// Raises the exception that was kept.
    ///
    /// # Errors
    /// The exception of the filter.
    pub(super) fn check(&self) -> PyResult<()> {
        match self.0.lock().unwrap_or_else(PoisonError::into_inner).take() {
            Some(error) => Err(error),
            None => Ok(()),
        }
    }
}

/// Makes a filter of a Python function of kind, object, opening and close. An opportunity for which it raises is not accepted.
pub(super) fn access_filter(accepts: Py<PyAny>, raised: RaisedError) -> AccessFilter {
    AccessFilter::new(move |opportunity: &Opportunity| {
        Python::attach(|py| {
            let Opportunity { kind, object, open_s, close_s } = *opportunity;
            let result = accepts.bind(py).call1((kind_name(kind), object, open_s, close_s));
            result.and_then(|accepted| accepted.is_truthy()).unwrap_or_else(|error| {
                raised.keep(error);
                false
            })
        })
    })
}

/// Name of a kind of opportunity in BSK-RL.
pub(super) const fn kind_name(kind: OpportunityKind) -> &'static str {
    match kind {
        OpportunityKind::Target => "target",
        OpportunityKind::GroundStation => "ground_station",
    }
}
