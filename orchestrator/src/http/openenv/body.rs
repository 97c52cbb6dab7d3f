//! Request bodies as FastAPI reads them: JSON where the type says so or nothing is said, else a text that fits no model.

use axum::extract::{FromRequest, Request};
use axum::http::{StatusCode, header};
use openenv_wire::{LocSegment, ValidationError};
use futures_util::StreamExt;
use serde_json::{Map, Value, json};

use super::super::extract::COMING;
use super::refusal::Refusal;

/// A body: nothing, or an object.
pub(super) struct Body(pub(super) Option<Map<String, Value>>);

/// Where faults of a body are.
pub(super) fn place() -> Vec<LocSegment> {
    vec![LocSegment::Field("body".to_owned())]
}

impl<S: Send + Sync> FromRequest<S> for Body {
    type Rejection = Refusal;

    async fn from_request(request: Request, _: &S) -> Result<Self, Refusal> {
        let kind = request.headers().get(header::CONTENT_TYPE).and_then(|v| v.to_str().ok()).unwrap_or("");
        let essence = kind.split(';').next().unwrap_or("").trim().to_ascii_lowercase();
        let is_json = essence.is_empty() || essence == "application/json" || essence.ends_with("+json");
        let bytes = whole(request).await?;
        if bytes.is_empty() {
            return Ok(Self(None));
        }
        let value = if is_json {
            openenv_wire::parse_python_json(&String::from_utf8_lossy(&bytes)).map_err(|error| not_json(&error))?
        } else {
            Value::String(String::from_utf8_lossy(&bytes).into_owned())
        };
        match value {
            Value::Object(fields) => Ok(Self(Some(fields))),
            other => Err(Refusal::fault(
                "model_attributes_type",
                place(),
                "Input should be a valid dictionary or object to extract fields from",
                openenv_wire::echo_input(&other),
            )),
        }
    }
}

/// Bytes of a body at most: a scenario is the largest thing there can be, and whoever comes may be anybody.
const MOST: usize = 1024 * 1024;

/// A body that comes in time, and is no larger than is taken.
pub(super) async fn whole(request: Request) -> Result<Vec<u8>, Refusal> {
    let read = async {
        let (mut bytes, mut body) = (Vec::new(), request.into_body().into_data_stream());
        while let Some(part) = body.next().await {
            let cut_off = |_| Refusal::new(StatusCode::BAD_REQUEST, "The body could not be read to its end.");
            bytes.extend_from_slice(&part.map_err(cut_off)?);
            if bytes.len() > MOST {
                return Err(Refusal::new(
                    StatusCode::PAYLOAD_TOO_LARGE,
                    "The body is larger than 1 MiB; send less.",
                ));
            }
        }
        Ok(bytes)
    };
    let late = |_| Refusal::new(StatusCode::REQUEST_TIMEOUT, "The body did not come to its end in 20 s.");
    tokio::time::timeout(COMING, read).await.map_err(late)?
}

fn not_json(error: &serde_json::Error) -> Refusal {
    let mut loc = place();
    loc.push(LocSegment::Index(error.column().saturating_sub(1)));
    let msg = "JSON decode error".to_owned();
    let ctx = Some(json!({"error": error.to_string()}));
    Refusal::faults(&[ValidationError { kind: "json_invalid", loc, msg, input: json!({}), ctx }])
}
