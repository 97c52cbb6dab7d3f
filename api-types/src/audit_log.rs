//! Audit log of the server.

use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

/// Entry of the audit log.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct AuditLogEntry {
    /// Time of the request, RFC 3339.
    pub at: String,
    /// Number of the token; null if the request had no known token.
    pub token: Option<i64>,
    /// Name of the token.
    pub name: Option<String>,
    /// Address of the client.
    pub address: Option<String>,
    /// Operation, by its method and path in this document.
    #[schema(example = "POST /v1/runs/{run}/pause")]
    pub operation: String,
    /// Path of the request.
    pub path: String,
    /// HTTP status of the response.
    pub status: i64,
    /// Id of the request, which the server's logs have too.
    pub request_id: String,
}

/// Page of the audit log.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct AuditLogPage {
    /// Entries of the page, newest first.
    pub entries: Vec<AuditLogEntry>,
    /// Cursor of the next page; null on the last page.
    pub next: Option<String>,
}

/// Query of the audit log.
#[derive(Debug, Clone, Default, Serialize, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct AuditLogQuery {
    /// True for denied requests, false for changes (default false).
    #[serde(default)]
    pub denied: bool,
    /// Largest number of entries on a page, from 1 to 500 (default 50).
    #[param(minimum = 1, maximum = 500, default = 50)]
    #[serde(default, deserialize_with = "crate::integers::optional::<_, 1, 500>")]
    pub limit: Option<u32>,
    /// Field `next` of the previous page.
    pub cursor: Option<String>,
}
