//! Who may do what: every operation, by method and path as it is routed. What is not here is for admins alone.

use axum::http::Method;

use crate::tokens::Role::{self, Admin, Trainer, Viewer};

/// What an operation needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::http) enum Needs {
    /// Nothing: it says nothing of any run.
    Nothing,
    /// A token of this role or a higher one.
    Token(Role),
    /// The same, but where OpenEnv is shown to anybody.
    OpenEnv(Role),
}

/// An operation.
#[derive(Debug, Clone, Copy)]
pub(in crate::http) struct Operation {
    /// Its method.
    pub(in crate::http) method: &'static str,
    /// Its path, as it is routed.
    pub(in crate::http) path: &'static str,
    /// What it needs.
    pub(in crate::http) needs: Needs,
    /// Whether the audit log has a line of each.
    pub(in crate::http) audited: bool,
}

const fn open(method: &'static str, path: &'static str) -> Operation {
    Operation { method, path, needs: Needs::Nothing, audited: false }
}

const fn openenv(method: &'static str, path: &'static str, role: Role) -> Operation {
    Operation { method, path, needs: Needs::OpenEnv(role), audited: false }
}

const fn read(path: &'static str) -> Operation {
    Operation { method: "GET", path, needs: Needs::Token(Viewer), audited: false }
}

const fn train(method: &'static str, path: &'static str) -> Operation {
    Operation { method, path, needs: Needs::Token(Trainer), audited: false }
}

/// What changes a run for good: the audit log has a line of it.
const fn steer(method: &'static str, path: &'static str, role: Role) -> Operation {
    Operation { method, path, needs: Needs::Token(role), audited: true }
}

/// Every operation.
const OPERATIONS: &[Operation] = &[
    open("GET", "/livez"),
    open("GET", "/readyz"),
    open("GET", "/openapi.json"),
    open("GET", "/docs"),
    open("GET", "/docs/"),
    open("GET", "/docs/{*rest}"),
    open("GET", "/dashboard"),
    open("GET", "/dashboard/"),
    open("GET", "/dashboard/{*file}"),
    open("GET", "/web"),
    open("GET", "/web/"),
    openenv("GET", "/", Viewer),
    openenv("GET", "/health", Viewer),
    openenv("GET", "/metadata", Viewer),
    openenv("GET", "/manifest.json", Viewer),
    openenv("GET", "/schema", Viewer),
    openenv("GET", "/state", Viewer),
    openenv("POST", "/reset", Trainer),
    openenv("POST", "/step", Trainer),
    openenv("POST", "/mcp", Trainer),
    openenv("GET", "/mcp", Trainer),
    openenv("GET", "/ws", Trainer),
    openenv("GET", "/ws/ui", Viewer),
    openenv("GET", "/web/metadata", Viewer),
    openenv("GET", "/web/state", Viewer),
    openenv("POST", "/web/reset", Trainer),
    openenv("POST", "/web/step", Trainer),
    read("/metrics"),
    read("/v1/tasks"),
    read("/v1/strategies"),
    read("/v1/evaluations"),
    read("/v1/evaluations/compare"),
    read("/v1/evaluations/{evaluation}"),
    read("/v1/evaluations/{evaluation}/scenarios"),
    read("/v1/suites"),
    read("/v1/runs"),
    read("/v1/runs/{run}"),
    read("/v1/runs/{run}/mastery"),
    read("/v1/runs/{run}/mastery/history"),
    read("/v1/runs/{run}/overview"),
    read("/v1/runs/{run}/series"),
    read("/v1/runs/{run}/settings"),
    read("/v1/runs/{run}/params"),
    read("/v1/runs/{run}/events"),
    read("/v1/runs/{run}/episodes"),
    read("/v1/runs/{run}/episodes/search"),
    read("/v1/runs/{run}/episodes/{episode}"),
    read("/v1/runs/{run}/episodes/{episode}/critique"),
    read("/v1/runs/{run}/episodes/{episode}/replay"),
    read("/v1/runs/{run}/failures"),
    read("/v1/runs/{run}/failures/list"),
    read("/v1/runs/{run}/designs"),
    read("/v1/runs/{run}/designs/asks"),
    read("/v1/runs/{run}/designs/asks/{ask}"),
    read("/v1/runs/{run}/designs/summary"),
    read("/v1/runs/{run}/designs/{design}"),
    read("/v1/layouts"),
    read("/v1/layouts/{layout}"),
    read("/v1/runs/{run}/policy"),
    read("/v1/runs/{run}/versions"),
    // A lease says what its scenarios are worth: that is for who flies them.
    train("GET", "/v1/runs/{run}/leases"),
    train("GET", "/v1/runs/{run}/leases/{lease}"),
    train("GET", "/v1/runs/{run}/leases/{lease}/columns"),
    train("GET", "/v1/runs/{run}/leases/{lease}/columns/entries"),
    train("POST", "/v1/runs/{run}/leases"),
    train("POST", "/v1/runs/{run}/leases/{lease}/columns"),
    train("POST", "/v1/runs/{run}/leases/{lease}/renew"),
    train("POST", "/v1/runs/{run}/leases/{lease}/release"),
    train("POST", "/v1/runs/{run}/results"),
    train("GET", "/v1/runs/{run}/trajectories"),
    train("POST", "/v1/runs/{run}/trajectories/ack"),
    train("GET", "/v1/sessions"),
    train("POST", "/v1/scenarios"),
    // It stores nothing and tells nothing of a run: who sees a layout may see it flown.
    Operation { method: "POST", path: "/v1/flights", needs: Needs::Token(Viewer), audited: false },
    steer("POST", "/v1/runs", Trainer),
    steer("POST", "/v1/evaluations", Trainer),
    steer("POST", "/v1/evaluations/{evaluation}/cancel", Trainer),
    steer("PUT", "/v1/runs/{run}/policy", Trainer),
    steer("PUT", "/v1/runs/{run}/policy_version", Trainer),
    steer("PUT", "/v1/runs/{run}/versions/{version}", Trainer),
    steer("PUT", "/v1/runs/{run}/retention", Admin),
    steer("PATCH", "/v1/runs/{run}", Admin),
    steer("POST", "/v1/runs/{run}/pause", Admin),
    steer("POST", "/v1/runs/{run}/resume", Admin),
    steer("POST", "/v1/runs/{run}/archive", Admin),
    steer("POST", "/v1/runs/{run}/designs", Admin),
    steer("POST", "/v1/runs/{run}/designs/{design}/retire", Admin),
    steer("POST", "/v1/runs/{run}/designs/{design}/revive", Admin),
    Operation { method: "GET", path: "/v1/audit", needs: Needs::Token(Admin), audited: false },
];

/// An operation by its method and path; none that is not listed.
pub(in crate::http) fn operation(method: &Method, path: &str) -> Option<&'static Operation> {
    // HEAD is answered as GET is.
    let method = if method == Method::HEAD { "GET" } else { method.as_str() };
    OPERATIONS.iter().find(|operation| operation.method == method && operation.path == path)
}
