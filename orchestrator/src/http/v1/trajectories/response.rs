//! Response with groups in the requested format. Groups are read and decompressed one after the other while the client reads, so
//! that a slow client costs the memory of one group.

use axum::body::{Body, Bytes};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use futures_util::StreamExt;
use futures_util::stream;
use store::trajectories::{self, FeedGroup};

use crate::http::content_negotiation::{LINES, MESSAGE_PACK, ResponseFormat, json_to_messagepack, negotiate};
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::limits::QuotaPermit;
use crate::rollouts::packed_group::feed_group_json;
use crate::sessions::ClientIdentity;

/// Group of a feed, compressed as it is stored.
pub(super) struct PackedFeedGroup {
    /// Id, deliveries and size of the group.
    pub(super) head: FeedGroup,
    /// Compressed JSON of the group.
    pub(super) body: Vec<u8>,
}

impl PackedFeedGroup {
    fn encode(&self, format: ResponseFormat, first: bool) -> anyhow::Result<Bytes> {
        let mut json = feed_group_json(self.head, &self.body)?;
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

/// Takes a permit to answer with groups: a client that reads slowly keeps one group and its connection's buffers in memory.
pub(super) fn acquire_answer(app: &AppState, client: &ClientIdentity) -> Result<QuotaPermit, Problem> {
    app.feed_answers.acquire(client.name.as_ref()).map_err(|_| {
        let message = "too many answers with trajectories are being read; retry in a few seconds";
        Problem::new(StatusCode::TOO_MANY_REQUESTS, "too_many_answers", message).with_retry_after(5)
    })
}

/// Builds the response with these groups, in the format that the request accepts. The permit is held until the response ends.
pub(super) fn groups_response(
    app: &AppState,
    headers: &HeaderMap,
    heads: Vec<FeedGroup>,
    next: Option<i64>,
    permit: QuotaPermit,
) -> Response {
    let formats = [ResponseFormat::Json, ResponseFormat::Lines, ResponseFormat::MessagePack];
    let readers = app.readers.clone();
    let read = move |id: i64| {
        let (readers, _held) = (readers.clone(), &permit);
        async move {
            let mut conn = readers.acquire().await?;
            Ok(trajectories::body(&mut conn, id).await?)
        }
    };
    feed_response(negotiate(headers, &formats), heads, next, read)
}

/// Groups that are not sent yet, and the function that reads the body of a group by its id.
struct UnsentGroups<R> {
    heads: std::vec::IntoIter<FeedGroup>,
    format: ResponseFormat,
    is_first: bool,
    read: R,
}

impl<R, F> UnsentGroups<R>
where
    R: Fn(i64) -> F,
    F: Future<Output = anyhow::Result<Option<Vec<u8>>>>,
{
    /// Reads and encodes the next group; `None` after the last. A group without a body was acknowledged and deleted meanwhile.
    async fn next(&mut self) -> anyhow::Result<Option<Bytes>> {
        let format = self.format;
        for head in self.heads.by_ref() {
            let Some(body) = (self.read)(head.id).await? else {
                // MessagePack has announced the number of groups.
                anyhow::ensure!(
                    !matches!(format, ResponseFormat::MessagePack),
                    "a group was deleted meanwhile"
                );
                continue;
            };
            let is_first = std::mem::replace(&mut self.is_first, false);
            let stored = PackedFeedGroup { head, body };
            return Ok(Some(tokio::task::spawn_blocking(move || stored.encode(format, is_first)).await??));
        }
        Ok(None)
    }
}

fn feed_response<R, F>(format: ResponseFormat, heads: Vec<FeedGroup>, next: Option<i64>, read: R) -> Response
where
    R: Fn(i64) -> F + Send + Sync + 'static,
    F: Future<Output = anyhow::Result<Option<Vec<u8>>>> + Send,
{
    let kind = match format {
        ResponseFormat::Json => "application/json",
        ResponseFormat::Lines => LINES,
        ResponseFormat::MessagePack => MESSAGE_PACK,
    };
    let (open, close) = envelope(format, heads.len(), next);
    let unsent = UnsentGroups { heads: heads.into_iter(), format, is_first: true, read };
    let encoded = stream::try_unfold(unsent, |mut unsent| async move {
        let bytes = unsent.next().await.inspect_err(|error| {
            // The response has started: the only way to report an error is to abort it.
            tracing::error!(%error, "A group of a feed cannot be sent; the response is aborted.");
        })?;
        anyhow::Ok(bytes.map(|bytes| (bytes, unsent)))
    });
    let edge = |bytes: Vec<u8>| stream::iter([anyhow::Ok(Bytes::from(bytes))]);
    let body = Body::from_stream(edge(open).chain(encoded).chain(edge(close)));
    ([(header::CONTENT_TYPE, kind)], body).into_response()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};

    use serde_json::{Value, json};

    use super::*;

    #[tokio::test]
    async fn all_formats_have_the_same_content() {
        let json_of = |id: i64| json!({"run": "r", "x": [id, 0.1]}).to_string();
        let head = move |id: i64| FeedGroup { id, deliveries: 2, bytes: json_of(id).len() as i64 };
        let read =
            move |id: i64| async move { Ok(Some(zstd::bulk::compress(json_of(id).as_bytes(), 3).unwrap())) };
        let body = |format, ids: &'static [i64], next| async move {
            let response = feed_response(format, ids.iter().copied().map(head).collect(), next, read);
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
        let read = async |_| Ok(Some(b"broken".to_vec()));
        let response = feed_response(ResponseFormat::Json, vec![head], Some(1), read);
        assert!(axum::body::to_bytes(response.into_body(), usize::MAX).await.is_err());
    }

    #[tokio::test]
    async fn groups_are_read_as_the_client_reads() {
        let reads = Arc::new(AtomicUsize::new(0));
        let counter = Arc::clone(&reads);
        let read = move |_| {
            counter.fetch_add(1, Ordering::Relaxed);
            async { Ok(Some(zstd::bulk::compress(b"{\"x\":1}", 3).unwrap())) }
        };
        let heads = (0..9).map(|id| FeedGroup { id, deliveries: 1, bytes: 7 }).collect();
        let mut body = feed_response(ResponseFormat::Lines, heads, None, read).into_body().into_data_stream();
        for parts in 0..4 {
            assert_eq!(reads.load(Ordering::Relaxed), usize::saturating_sub(parts, 1));
            assert!(body.next().await.unwrap().is_ok());
        }
    }

    #[tokio::test]
    async fn deleted_group_is_left_out() {
        let head = |id: i64| FeedGroup { id, deliveries: 1, bytes: 7 };
        let read = async |id: i64| Ok((id == 2).then(|| zstd::bulk::compress(b"{\"x\":1}", 3).unwrap()));
        let heads = || vec![head(1), head(2), head(3)];
        let response = feed_response(ResponseFormat::Json, heads(), Some(3), read);
        let body = axum::body::to_bytes(response.into_body(), usize::MAX).await.unwrap();
        let body: Value = serde_json::from_slice(&body).unwrap();
        assert_eq!(body, json!({"groups": [{"id": 2, "deliveries": 1, "x": 1}], "next": 3}));
        // The number of groups is sent before them.
        let response = feed_response(ResponseFormat::MessagePack, heads(), Some(3), read);
        assert!(axum::body::to_bytes(response.into_body(), usize::MAX).await.is_err());
    }
}
