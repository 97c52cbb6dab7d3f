//! Event stream of a run.

use serde::{Deserialize, Serialize};
use utoipa::IntoParams;

/// Query of the event stream: where it starts.
#[derive(Debug, Clone, Default, Serialize, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct EventQuery {
    /// Id of the event after which the stream starts; 0 for all kept events (default: new events only). The header
    /// `Last-Event-ID` takes precedence.
    pub after: Option<i64>,
    /// Number of past events to start with if `after` is not set, at most 1 000.
    #[param(maximum = 1000)]
    pub last: Option<u32>,
}
