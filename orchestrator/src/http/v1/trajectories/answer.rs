//! Groups in the form that is asked for, one after the other: a group is unpacked when its turn comes, so that a client
//! that reads slowly costs no more than what is stored.

use axum::body::{Body, Bytes};
use axum::http::header;
use axum::response::{IntoResponse, Response};
use futures_util::StreamExt;
use futures_util::stream;

use super::super::super::answers::{Form, LINES, MESSAGE_PACK, packed};
use crate::store::trajectories::FeedGroup;
use crate::rollouts::trajectory_group::unpack;

/// A group as it is stored.
pub(super) struct Stored {
    pub(super) head: FeedGroup,
    pub(super) body: Vec<u8>,
}

impl Stored {
    /// As JSON, with what is known of it only now.
    fn json(&self) -> anyhow::Result<Vec<u8>> {
        let json = unpack(&self.body, usize::try_from(self.head.bytes).unwrap_or(0))?;
        let mut told =
            format!(r#"{{"id":{},"deliveries":{},"#, self.head.id, self.head.deliveries).into_bytes();
        told.extend_from_slice(json.strip_prefix(b"{").unwrap_or(&json));
        Ok(told)
    }

    fn told(&self, form: Form, first: bool) -> anyhow::Result<Bytes> {
        let mut json = self.json()?;
        Ok(match form {
            Form::MessagePack => packed(&json)?.into(),
            Form::Lines => {
                json.push(b'\n');
                json.into()
            }
            Form::Json if first => json.into(),
            Form::Json => {
                json.insert(0, b',');
                json.into()
            }
        })
    }
}

/// What stands before and after the groups of an answer.
fn frame(form: Form, count: usize, next: Option<i64>) -> (Vec<u8>, Vec<u8>) {
    match form {
        Form::Lines => (Vec::new(), Vec::new()),
        Form::Json => {
            let next = next.map_or_else(|| "null".to_owned(), |next| next.to_string());
            (br#"{"groups":["#.to_vec(), format!(r#"],"next":{next}}}"#).into_bytes())
        }
        Form::MessagePack => {
            // A map of two; the list has its length before it (array 32), `next` is a number (int 64) or nil.
            let count = u32::try_from(count).unwrap_or(u32::MAX).to_be_bytes();
            let open = [b"\x82\xa6groups\xdd".as_slice(), &count].concat();
            let next =
                next.map_or_else(|| vec![0xc0], |next| [&[0xd3], next.to_be_bytes().as_slice()].concat());
            (open, [b"\xa4next".as_slice(), &next].concat())
        }
    }
}

/// An answer with these groups.
pub(super) fn answer(form: Form, groups: Vec<Stored>, next: Option<i64>) -> Response {
    let kind = match form {
        Form::Json => "application/json",
        Form::Lines => LINES,
        Form::MessagePack => MESSAGE_PACK,
    };
    let (open, close) = frame(form, groups.len(), next);
    let told = stream::iter(groups.into_iter().enumerate()).then(move |(at, stored)| async move {
        let told = tokio::task::spawn_blocking(move || stored.told(form, at == 0)).await;
        // The answer has begun: all that can be done is to break it off, and say why in the log.
        told.map_err(anyhow::Error::from).and_then(|told| told).inspect_err(|error| {
            tracing::error!(%error, "A group of a feed cannot be told; the answer is broken off.");
        })
    });
    let edge = |bytes: Vec<u8>| stream::iter([anyhow::Ok(Bytes::from(bytes))]);
    let body = Body::from_stream(edge(open).chain(told).chain(edge(close)));
    ([(header::CONTENT_TYPE, kind)], body).into_response()
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;

    #[tokio::test]
    async fn all_forms_say_the_same() {
        let stored = |id: i64| {
            let json = json!({"run": "r", "x": [id, 0.1]}).to_string();
            let head = FeedGroup { id, deliveries: 2, bytes: json.len() as i64 };
            Stored { head, body: zstd::bulk::compress(json.as_bytes(), 3).unwrap() }
        };
        let told = |form, ids: &'static [i64], next| async move {
            let answer = answer(form, ids.iter().copied().map(stored).collect(), next);
            axum::body::to_bytes(answer.into_body(), usize::MAX).await.unwrap()
        };
        for (ids, next) in [(&[][..], None), (&[7], Some(7)), (&[7, 8, 300], Some(300))] {
            let group = |id| json!({"id": id, "deliveries": 2, "run": "r", "x": [id, 0.1]});
            let groups: Vec<Value> = ids.iter().copied().map(group).collect();
            let whole = json!({"groups": groups, "next": next});
            let json: Value = serde_json::from_slice(&told(Form::Json, ids, next).await).unwrap();
            assert_eq!(json, whole);
            let pack: Value = rmp_serde::from_slice(&told(Form::MessagePack, ids, next).await).unwrap();
            assert_eq!(pack, whole);
            let lines = String::from_utf8(told(Form::Lines, ids, next).await.to_vec()).unwrap();
            let lines: Vec<Value> = lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
            assert_eq!(lines, groups);
        }
    }

    #[tokio::test]
    async fn what_cannot_be_unpacked_breaks_the_answer_off() {
        let head = FeedGroup { id: 1, deliveries: 1, bytes: 10 };
        let answer = answer(Form::Json, vec![Stored { head, body: b"broken".to_vec() }], Some(1));
        assert!(axum::body::to_bytes(answer.into_body(), usize::MAX).await.is_err());
    }
}
