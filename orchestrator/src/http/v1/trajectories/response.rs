//! Response with groups in the requested format. Groups are decompressed one after the other while the client reads, so that a slow
//! client costs no more memory than the stored groups.

use axum::body::{Body, Bytes};
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse, Response};
use futures_util::StreamExt;
use futures_util::stream;
use store::trajectories::{self, FeedGroup};

use crate::http::content_negotiation::{LINES, MESSAGE_PACK, ResponseFormat, json_to_messagepack, negotiate};
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::rollouts::packed_group::unpack;

/// Group of a feed, compressed as it is stored.
pub(super) struct PackedFeedGroup {
    /// Id, deliveries and size of the group.
    pub(super) head: FeedGroup,
    /// Compressed JSON of the group.
    pub(super) body: Vec<u8>,
}

impl PackedFeedGroup {
    /// JSON of the group with its id and its number of deliveries.
    fn json(&self) -> anyhow::Result<Vec<u8>> {
        let json = unpack(&self.body, usize::try_from(self.head.bytes).unwrap_or(0))?;
        let mut out =
            format!(r#"{{"id":{},"deliveries":{},"#, self.head.id, self.head.deliveries).into_bytes();
        out.extend_from_slice(json.strip_prefix(b"{").unwrap_or(&json));
        Ok(out)
    }

    fn encode(&self, format: ResponseFormat, first: bool) -> anyhow::Result<Bytes> {
        let mut json = self.json()?;
        Ok(match format {
            ResponseFormat::MessagePack => json_to_messagepack(&json)?.into(),
            ResponseFormat::Lines => {
                json.push(b'\n');
                json.into()
            }
            ResponseFormat::Json if first => json.into(),
            ResponseFormat::Json => {
                json.insert(0, b',');
                json.into()
            }
        })
    }
}

/// Bytes before and after the groups of a response.
fn envelope(format: ResponseFormat, count: usize, next: Option<i64>) -> (Vec<u8>, Vec<u8>) {
    match format {
        ResponseFormat::Lines => (Vec::new(), Vec::new()),
        ResponseFormat::Json => {
            let next = next.map_or_else(|| "null".to_owned(), |next| next.to_string());
            (br#"{"groups":["#.to_vec(), format!(r#"],"next":{next}}}"#).into_bytes())
        }
        ResponseFormat::MessagePack => {
            // A map with two entries: an array 32 with its length, and `next` as int 64 or nil.
            let count = u32::try_from(count).unwrap_or(u32::MAX).to_be_bytes();
            let open = [b"\x82\xa6groups\xdd".as_slice(), &count].concat();
            let next =
                next.map_or_else(|| vec![0xc0], |next| [&[0xd3], next.to_be_bytes().as_slice()].concat());
            (open, [b"\xa4next".as_slice(), &next].concat())
        }
    }
}

/// Reads the bodies of groups. A group without a body was acknowledged and deleted meanwhile.
pub(super) async fn read_groups(
    app: &AppState,
    heads: Vec<FeedGroup>,
) -> Result<Vec<PackedFeedGroup>, Problem> {
    let mut groups = Vec::with_capacity(heads.len());
    let mut conn = app.readers.acquire().await?;
    for head in heads {
        if let Some(body) = trajectories::body(&mut conn, head.id).await? {
            groups.push(PackedFeedGroup { head, body });
        }
    }
    Ok(groups)
}

/// Builds the response with these groups, in the format that the request accepts.
pub(super) fn groups_response(
    headers: &HeaderMap,
    groups: Vec<PackedFeedGroup>,
    next: Option<i64>,
) -> Response {
    let formats = [ResponseFormat::Json, ResponseFormat::Lines, ResponseFormat::MessagePack];
    feed_response(negotiate(headers, &formats), groups, next)
}

fn feed_response(format: ResponseFormat, groups: Vec<PackedFeedGroup>, next: Option<i64>) -> Response {
    let kind = match format {
        ResponseFormat::Json => "application/json",
        ResponseFormat::Lines => LINES,
        ResponseFormat::MessagePack => MESSAGE_PACK,
    };
    let (open, close) = envelope(format, groups.len(), next);
    let encoded = stream::iter(groups.into_iter().enumerate()).then(move |(at, stored)| async move {
        let bytes = tokio::task::spawn_blocking(move || stored.encode(format, at == 0)).await;
        // The response has started: the only way to report an error is to abort it.
        bytes.map_err(anyhow::Error::from).and_then(|bytes| bytes).inspect_err(|error| {
            tracing::error!(%error, "A group of a feed cannot be encoded; the response is aborted.");
        })
    });
    let edge = |bytes: Vec<u8>| stream::iter([anyhow::Ok(Bytes::from(bytes))]);
    let body = Body::from_stream(edge(open).chain(encoded).chain(edge(close)));
    ([(header::CONTENT_TYPE, kind)], body).into_response()
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;

    #[tokio::test]
    async fn all_formats_have_the_same_content() {
        let stored = |id: i64| {
            let json = json!({"run": "r", "x": [id, 0.1]}).to_string();
            let head = FeedGroup { id, deliveries: 2, bytes: json.len() as i64 };
            PackedFeedGroup { head, body: zstd::bulk::compress(json.as_bytes(), 3).unwrap() }
        };
        let body = |format, ids: &'static [i64], next| async move {
            let response = feed_response(format, ids.iter().copied().map(stored).collect(), next);
            axum::body::to_bytes(response.into_body(), usize::MAX).await.unwrap()
        };
        for (ids, next) in [(&[][..], None), (&[7], Some(7)), (&[7, 8, 300], Some(300))] {
            let group = |id| json!({"id": id, "deliveries": 2, "run": "r", "x": [id, 0.1]});
            let groups: Vec<Value> = ids.iter().copied().map(group).collect();
            let whole = json!({"groups": groups, "next": next});
            let json: Value = serde_json::from_slice(&body(ResponseFormat::Json, ids, next).await).unwrap();
            assert_eq!(json, whole);
            let pack: Value =
                rmp_serde::from_slice(&body(ResponseFormat::MessagePack, ids, next).await).unwrap();
            assert_eq!(pack, whole);
            let lines = String::from_utf8(body(ResponseFormat::Lines, ids, next).await.to_vec()).unwrap();
            let lines: Vec<Value> = lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
            assert_eq!(lines, groups);
        }
    }

    #[tokio::test]
    async fn corrupt_group_aborts_the_response() {
        let head = FeedGroup { id: 1, deliveries: 1, bytes: 10 };
        let response = feed_response(
            ResponseFormat::Json,
            vec![PackedFeedGroup { head, body: b"broken".to_vec() }],
            Some(1),
        );
        assert!(axum::body::to_bytes(response.into_body(), usize::MAX).await.is_err());
    }
}
