//! Large request bodies, received under the [`BodyLimit`].

use axum::extract::{FromRequest, Request};
use tokio::sync::SemaphorePermit;

use super::extract::{EncodedBody, declared_length};
use super::problem::Problem;
use crate::limits::BodyLimit;

/// Received body with its permit, which must be held as long as the parsed content exists.
pub(super) struct LargeBody<'a> {
    pub(super) body: EncodedBody,
    pub(super) permit: SemaphorePermit<'a>,
}

/// Receives a body and waits for the permit to parse it.
pub(super) async fn receive_large_body(
    limit: &BodyLimit,
    request: Request,
) -> Result<LargeBody<'_>, Problem> {
    let _read_permit = limit.acquire_read(declared_length(request.headers())).await?;
    let body = EncodedBody::from_request(request, &()).await?;
    Ok(LargeBody { body, permit: limit.acquire_parse().await? })
}
