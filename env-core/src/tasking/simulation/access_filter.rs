//! A condition on opportunities that the user of an episode sets: `add_access_filter` of BSK-RL.

use std::fmt;
use std::sync::Arc;

use crate::tasking::access::Opportunity;

/// A condition on opportunities. Observations and actions leave out those that do not meet it.
#[derive(Clone)]
pub struct AccessFilter(Arc<dyn Fn(&Opportunity) -> bool + Send + Sync>);

impl AccessFilter {
    /// Creates a filter that accepts the opportunities for which a function returns true.
    pub fn new(accepts: impl Fn(&Opportunity) -> bool + Send + Sync + 'static) -> Self {
        Self(Arc::new(accepts))
    }

    /// True if an opportunity meets the condition.
    #[must_use]
    pub fn accepts(&self, opportunity: &Opportunity) -> bool {
        (self.0)(opportunity)
    }
}

impl fmt::Debug for AccessFilter {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("AccessFilter")
    }
}
