//! Middleware that authorizes requests and writes the audit log.

use std::sync::Arc;
use std::time::Duration;

use axum::body::HttpBody;
use axum::extract::{MatchedPath, Request, State};
use axum::http::{HeaderMap, HeaderValue, Version, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use store::audit_log::AuditRow;
use store::role::Role;
use tracing::Instrument;

use super::super::connections::PeerAddress;
use super::super::problem::Problem;
use super::control::{AccessControl, AccessDenied};
use super::permissions::{Permission, find_operation};
use crate::engine::access_log::WriteAuditLine;
use crate::engine::error::ServiceError;
use crate::engine::writer::Writer;
use crate::tokens::redact;

/// Maximum number of attempts to write a line of the audit log while the writer is busy.
const MAX_AUDIT_ATTEMPTS: u32 = 10;
/// Pause between two attempts to write a line of the audit log.
const AUDIT_RETRY_DELAY: Duration = Duration::from_millis(500);

/// Authorizes a request, passes its caller to the handler, and records audited operations and denials.
pub(crate) async fn authorize(
    State(access): State<Arc<AccessControl>>,
    mut request: Request,
    next: Next,
) -> Response {
    let path = request.extensions().get::<MatchedPath>().map(|path| path.as_str().to_owned());
    let Some(path) = path else { return next.run(request).await }; // no route matches
    let operation = find_operation(request.method(), &path);
    // An unlisted operation needs the highest role. The route itself rejects unknown methods.
    let permission = operation.map_or(Permission::Token(Role::Admin), |operation| operation.permission);
    let peer = request.extensions().get::<PeerAddress>().map(|PeerAddress(address)| address.ip());
    let admitted =
        match access.admit(permission, request.method(), request.headers(), request.uri(), peer).await {
            Ok(caller) => access.check_run(permission, &caller, &mut request).await.map(|()| caller),
            Err(denied) => Err(denied),
        };
    let (token, denial) = match admitted {
        Ok(caller) => {
            let token = caller.identity.token;
            request.extensions_mut().insert(caller);
            (token, None)
        }
        Err(AccessDenied { problem, token }) => (token, Some(problem)),
    };
    let row = access.is_audited(operation, denial.as_ref(), peer).then(|| AuditRow {
        id: 0,
        at: access.clock.now(),
        token,
        name: None,
        address: peer.map(|ip| ip.to_string()),
        operation: format!("{} {path}", request.method()),
        path: redact(request.uri().path()).chars().take(500).collect(),
        status: 0,
        request_id: request_id(request.headers()),
    });
    let is_denied = denial.is_some();
    let respond = async move {
        match denial {
            None => next.run(request).await,
            Some(problem) => close_if_unread(&request, problem.into_response()),
        }
    };
    let Some(row) = row else { return respond.await };
    // The spawned task also records the request of a client that disconnects before the response.
    let audited = async move {
        let response = respond.await;
        let line = AuditRow { status: response.status().as_u16().into(), ..row };
        write_audit_line(&access.writer, WriteAuditLine { line, is_denied }).await;
        response
    };
    let response = tokio::spawn(audited.in_current_span()).await;
    response.unwrap_or_else(|_| Problem::internal().into_response()) // the panic is in the log
}

/// Writes a line of the audit log, and retries while the writer is busy.
async fn write_audit_line(writer: &Writer, command: WriteAuditLine) {
    let line = &command.line;
    tracing::info!(
        token = line.token,
        address = line.address,
        operation = line.operation,
        path = line.path,
        status = line.status,
        "Audited."
    );
    for _ in 0..MAX_AUDIT_ATTEMPTS {
        match writer.change(command.clone()).await {
            Ok(()) => return,
            Err(ServiceError::Busy) => tokio::time::sleep(AUDIT_RETRY_DELAY).await,
            Err(error) => {
                tracing::error!(error = %error, "An entry of the audit log could not be written.");
                return;
            }
        }
    }
    tracing::error!("An entry of the audit log could not be written: the writer was busy for too long.");
}

/// Closes the connection if the request's body was not read: it would be parsed as the next request.
fn close_if_unread(request: &Request, mut response: Response) -> Response {
    if request.version() <= Version::HTTP_11 && !request.body().is_end_stream() {
        response.headers_mut().insert(header::CONNECTION, HeaderValue::from_static("close"));
    }
    response
}

fn request_id(headers: &HeaderMap) -> String {
    let id = headers.get("x-request-id").and_then(|id| id.to_str().ok()).unwrap_or_default();
    id.chars().take(100).collect()
}
