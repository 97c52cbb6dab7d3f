//! Permission of each operation, by method and routed path. An operation that is not listed needs the role admin.

use axum::http::Method;

use store::role::Role::{self, Admin, Trainer, Viewer};

use crate::ownership::RunPermission;

/// Permission that an operation requires.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Permission {
    /// No token: the response has nothing of a run.
    Public,
    /// A token of this role or a higher one.
    Token(Role),
    /// A token of this role or a higher one, unless OpenEnv's routes are public.
    OpenEnv(Role),
    /// A trainer's token whose principal has this permission for the run of the path, or an admin's token.
    Run(RunPermission),
}

impl Permission {
    /// Lowest role that the permission requires; `None` if it requires no token.
    pub(crate) const fn role(self) -> Option<Role> {
        match self {
            Self::Public => None,
            Self::Token(role) | Self::OpenEnv(role) => Some(role),
            Self::Run(_) => Some(Trainer),
        }
    }
}

/// Operation of the API with its permission.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Operation {
    /// HTTP method in capitals.
    pub(crate) method: &'static str,
    /// Path pattern of the route.
    pub(crate) path: &'static str,
    /// Permission that a request requires.
    pub(crate) permission: Permission,
    /// True if the audit log records each request.
    pub(crate) audited: bool,
}

const fn public(method: &'static str, path: &'static str) -> Operation {
    Operation { method, path, permission: Permission::Public, audited: false }
}

const fn openenv(method: &'static str, path: &'static str, role: Role) -> Operation {
    Operation { method, path, permission: Permission::OpenEnv(role), audited: false }
}

const fn read(path: &'static str) -> Operation {
    Operation { method: "GET", path, permission: Permission::Token(Viewer), audited: false }
}

const fn train(method: &'static str, path: &'static str) -> Operation {
    Operation { method, path, permission: Permission::Token(Trainer), audited: false }
}

/// Operation for the owner and the members of a run.
const fn take_part(method: &'static str, path: &'static str) -> Operation {
    Operation { method, path, permission: Permission::Run(RunPermission::TakePart), audited: false }
}

/// Operation for the owner of a run; the audit log records it.
const fn change(method: &'static str, path: &'static str) -> Operation {
    Operation { method, path, permission: Permission::Run(RunPermission::Change), audited: true }
}

/// Operation that changes a run permanently; the audit log records it.
const fn audited(method: &'static str, path: &'static str, role: Role) -> Operation {
    Operation { method, path, permission: Permission::Token(role), audited: true }
}

/// All operations, grouped by permission.
const OPERATIONS: &[Operation] = &[
    public("GET", "/livez"),
    public("GET", "/readyz"),
    public("GET", "/openapi.json"),
    public("GET", "/docs"),
    public("GET", "/docs/"),
    public("GET", "/docs/{*rest}"),
    public("GET", "/dashboard"),
    public("GET", "/dashboard/"),
    public("GET", "/dashboard/{*file}"),
    public("GET", "/web"),
    public("GET", "/web/"),
    openenv("GET", "/", Viewer),
    openenv("GET", "/health", Viewer),
    openenv("GET", "/metadata", Viewer),
    openenv("GET", "/manifest.json", Viewer),
    openenv("GET", "/schema", Viewer),
    openenv("GET", "/state", Viewer),
    openenv("GET", "/list_environments", Viewer),
    openenv("GET", "/sparring/splits", Viewer),
    openenv("POST", "/sparring/tasks", Viewer),
    openenv("POST", "/sparring/num_tasks", Viewer),
    openenv("POST", "/sparring/task", Viewer),
    openenv("POST", "/sparring/task_range", Viewer),
    openenv("POST", "/reset", Trainer),
    openenv("POST", "/step", Trainer),
    openenv("POST", "/mcp", Trainer),
    openenv("GET", "/mcp", Trainer),
    openenv("DELETE", "/mcp", Trainer),
    openenv("GET", "/ws", Trainer),
    openenv("GET", "/ws/ui", Viewer),
    openenv("GET", "/web/metadata", Viewer),
    openenv("GET", "/web/state", Viewer),
    openenv("POST", "/web/reset", Trainer),
    openenv("POST", "/web/step", Trainer),
    read("/metrics"),
    read("/v1/tasks"),
    read("/v1/strategies"),
    read("/v1/workers"),
    read("/v1/evaluations"),
    read("/v1/evaluations/compare"),
    read("/v1/evaluations/{evaluation}"),
    read("/v1/evaluations/{evaluation}/scenarios"),
    read("/v1/suites"),
    read("/v1/alerts"),
    read("/v1/health"),
    read("/v1/runs"),
    read("/v1/run_groups"),
    read("/v1/runs/{run}"),
    read("/v1/runs/{run}/mastery"),
    read("/v1/runs/{run}/level_moves"),
    read("/v1/runs/{run}/overview"),
    read("/v1/runs/{run}/series"),
    read("/v1/runs/{run}/sampler"),
    read("/v1/runs/{run}/metrics"),
    read("/v1/runs/{run}/trainers"),
    read("/v1/runs/{run}/settings"),
    read("/v1/runs/{run}/params"),
    read("/v1/runs/{run}/events"),
    read("/v1/runs/{run}/episodes"),
    read("/v1/runs/{run}/episodes/search"),
    read("/v1/runs/{run}/episodes/{episode}"),
    read("/v1/runs/{run}/episodes/{episode}/critique"),
    read("/v1/runs/{run}/episodes/{episode}/replay"),
    read("/v1/runs/{run}/failure_profiles"),
    read("/v1/runs/{run}/failures"),
    read("/v1/runs/{run}/designs"),
    read("/v1/runs/{run}/designs/requests"),
    read("/v1/runs/{run}/designs/requests/{request}"),
    read("/v1/runs/{run}/designs/statistics"),
    read("/v1/runs/{run}/designs/{design}"),
    read("/v1/layouts"),
    read("/v1/layouts/{layout}"),
    read("/v1/runs/{run}/policy"),
    read("/v1/runs/{run}/policy_versions"),
    // A lease shows the bracket of its scenarios, which only trainers may see.
    // Each turn costs calls of the operator's model, so that the route is not public with the others of OpenEnv.
    train("GET", "/harness"),
    take_part("GET", "/v1/runs/{run}/leases"),
    take_part("GET", "/v1/runs/{run}/leases/{lease}"),
    take_part("GET", "/v1/runs/{run}/leases/{lease}/columns"),
    take_part("GET", "/v1/runs/{run}/leases/{lease}/columns/entries"),
    take_part("POST", "/v1/runs/{run}/leases"),
    take_part("POST", "/v1/runs/{run}/leases/{lease}/columns"),
    take_part("POST", "/v1/runs/{run}/leases/{lease}/groups/begin"),
    take_part("POST", "/v1/runs/{run}/leases/{lease}/renew"),
    take_part("POST", "/v1/runs/{run}/leases/{lease}/release"),
    take_part("POST", "/v1/runs/{run}/results"),
    take_part("POST", "/v1/runs/{run}/metrics"),
    take_part("GET", "/v1/runs/{run}/trajectories"),
    take_part("POST", "/v1/runs/{run}/trajectories/claim"),
    take_part("POST", "/v1/runs/{run}/trajectories/ack"),
    take_part("GET", "/v1/runs/{run}/sessions"),
    train("GET", "/v1/sessions"),
    train("POST", "/v1/scenarios"),
    // A rollout stores nothing and shows nothing of a run. A client that may see a layout may see its rollout.
    Operation { method: "POST", path: "/v1/rollouts", permission: Permission::Token(Viewer), audited: false },
    audited("POST", "/v1/runs", Trainer),
    audited("POST", "/v1/evaluations", Trainer),
    audited("POST", "/v1/evaluations/{evaluation}/cancel", Trainer),
    change("PUT", "/v1/runs/{run}/policy"),
    change("PUT", "/v1/runs/{run}/policy_version"),
    change("PUT", "/v1/runs/{run}/policy_versions/{version}"),
    change("PUT", "/v1/runs/{run}/tags"),
    change("PUT", "/v1/runs/{run}/note"),
    change("PUT", "/v1/runs/{run}/members"),
    audited("PUT", "/v1/runs/{run}/retention", Admin),
    audited("DELETE", "/v1/runs/{run}", Admin),
    audited("PATCH", "/v1/runs/{run}", Admin),
    audited("POST", "/v1/runs/{run}/pause", Admin),
    audited("POST", "/v1/runs/{run}/resume", Admin),
    audited("POST", "/v1/runs/{run}/archive", Admin),
    audited("POST", "/v1/archive", Admin),
    audited("POST", "/v1/runs/{run}/designs", Admin),
    audited("POST", "/v1/runs/{run}/designs/{design}/retire", Admin),
    audited("POST", "/v1/runs/{run}/designs/{design}/revive", Admin),
    Operation { method: "GET", path: "/v1/audit", permission: Permission::Token(Admin), audited: false },
];

/// Returns the operation of a method and path, if it is listed.
pub(crate) fn find_operation(method: &Method, path: &str) -> Option<&'static Operation> {
    // A HEAD request has the permission of GET.
    let method = if method == Method::HEAD { "GET" } else { method.as_str() };
    OPERATIONS.iter().find(|operation| operation.method == method && operation.path == path)
}
