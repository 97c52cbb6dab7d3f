//! Event stream of a run.

use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

/// Query of the event stream: where it starts, and which events it has.
#[derive(Debug, Clone, Default, Serialize, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct EventQuery {
    /// Id of the event after which the stream starts; 0 for all kept events (default: new events only). The header
    /// `Last-Event-ID` takes precedence.
    pub after: Option<i64>,
    /// Number of past events to start with if `after` is not set, at most 1 000.
    #[param(minimum = 0, maximum = 1000)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 0, 1000>")]
    pub last: Option<u32>,
    /// Kinds of the wanted events, separated by commas, such as `move,warning` (default: all). `last` counts events of these
    /// kinds. A `gap` and the deletion of the run are always sent.
    pub kind: Option<String>,
}

/// Subject of an event.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum EventKind {
    /// The run itself: created, changed, paused or resumed.
    Run,
    /// A lease that was granted or ended.
    Lease,
    /// A group that closed.
    Group,
    /// A level move of a task.
    Move,
    /// A claim of columns.
    Claim,
    /// Episodes that were criticised.
    Failures,
    /// A design request of the run.
    Design,
    /// A worker on another machine that joined or left.
    Worker,
    /// A new warning of the run.
    Warning,
}
