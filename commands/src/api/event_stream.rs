//! Reads the event stream of a run (Server-Sent Events) and resumes it after a broken connection.

use std::collections::VecDeque;
use std::time::Duration;

use reqwest::Response;
use serde_json::Value;

use super::{ApiClient, with_query};

/// Silence after which all past events have arrived.
const PAST_EVENTS_TIMEOUT: Duration = Duration::from_secs(1);
/// Pause before a broken connection is opened again.
const RECONNECT_PAUSE: Duration = Duration::from_secs(1);
/// Largest number of attempts to open a broken connection again.
const MAX_ATTEMPTS: u32 = 30;

/// Event of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct StreamedEvent {
    /// Id of the event.
    pub id: String,
    /// Kind of the event, such as `move`.
    pub kind: String,
    /// Content of the event.
    pub data: Value,
}

/// Event stream of a run.
pub struct EventStream<'a> {
    api: &'a ApiClient,
    path: String,
    response: Response,
    parser: EventParser,
    ready: VecDeque<StreamedEvent>,
}

impl<'a> EventStream<'a> {
    /// Opens the stream of a run with its last events of these kinds; an empty list means all kinds.
    ///
    /// # Errors
    /// Returns an error if the server cannot be reached or rejects the request.
    pub async fn open(api: &'a ApiClient, run: &str, kinds: &[String], last: u32) -> anyhow::Result<Self> {
        let path = format!("/v1/runs/{run}/events");
        let (kinds, last) = (kinds.join(","), last.to_string());
        let mut query = if kinds.is_empty() { vec![] } else { vec![("kind", kinds.as_str())] };
        // A stream that is opened again starts after the last event.
        let again = with_query(&path, &query);
        query.push(("last", &last));
        let response = api.open_stream(&with_query(&path, &query), None).await?;
        Ok(Self { api, path: again, response, parser: EventParser::default(), ready: VecDeque::new() })
    }

    /// Returns the next past event, or `None` if none arrives for a moment.
    ///
    /// # Errors
    /// Returns the errors of [`EventStream::next`].
    pub async fn next_past(&mut self) -> anyhow::Result<Option<StreamedEvent>> {
        tokio::time::timeout(PAST_EVENTS_TIMEOUT, self.next()).await.ok().transpose()
    }

    /// Returns the next event. A broken connection is opened again after the last event.
    ///
    /// # Errors
    /// Returns an error if the server cannot be reached again.
    pub async fn next(&mut self) -> anyhow::Result<StreamedEvent> {
        loop {
            if let Some(event) = self.ready.pop_front() {
                return Ok(event);
            }
            match self.response.chunk().await {
                Ok(Some(bytes)) => self.ready.extend(self.parser.push(&bytes)),
                Ok(None) | Err(_) => self.reconnect().await?,
            }
        }
    }

    async fn reconnect(&mut self) -> anyhow::Result<()> {
        let id = self.parser.last_id.clone();
        let mut attempt = 1;
        self.response = loop {
            tokio::time::sleep(RECONNECT_PAUSE).await;
            match self.api.open_stream(&self.path, id.as_deref()).await {
                Ok(response) => break response,
                Err(error) if attempt == MAX_ATTEMPTS => return Err(error),
                Err(_) => attempt += 1,
            }
        };
        self.parser = EventParser { last_id: id, ..EventParser::default() };
        Ok(())
    }
}

/// Parser of Server-Sent Events (HTML Living Standard, section 9.2.6). The server ends lines with `\n` only.
#[derive(Debug, Default)]
pub(crate) struct EventParser {
    /// Bytes of a line whose end has not arrived.
    line: Vec<u8>,
    last_id: Option<String>,
    kind: String,
    data: String,
}

impl EventParser {
    /// Adds bytes and returns the events that they complete.
    pub(crate) fn push(&mut self, bytes: &[u8]) -> Vec<StreamedEvent> {
        let mut events = Vec::new();
        for &byte in bytes {
            if byte == b'\n' {
                let line = std::mem::take(&mut self.line);
                events.extend(self.end_line(&String::from_utf8_lossy(&line)));
            } else {
                self.line.push(byte);
            }
        }
        events
    }

    fn end_line(&mut self, line: &str) -> Option<StreamedEvent> {
        if line.is_empty() {
            let (kind, data) = (std::mem::take(&mut self.kind), std::mem::take(&mut self.data));
            // An id without data is only the place from which a client can resume.
            let data = serde_json::from_str(&data).ok()?;
            return Some(StreamedEvent { id: self.last_id.clone().unwrap_or_default(), kind, data });
        }
        let (field, value) = line.split_once(':').unwrap_or((line, ""));
        let value = value.strip_prefix(' ').unwrap_or(value);
        match field {
            "id" => self.last_id = Some(value.to_owned()),
            "event" => value.clone_into(&mut self.kind),
            "data" => {
                if !self.data.is_empty() {
                    self.data.push('\n');
                }
                self.data.push_str(value);
            }
            _ => {} // a comment, or a field of a later version
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn events_are_parsed_from_any_chunks() {
        let text =
            "id: 7\n\n: alive\n\nid: 8\nevent: move\ndata: {\"to\": 3}\n\nevent: gap\ndata: {\ndata: }\n\n";
        let expected = [("8", "move", json!({"to": 3})), ("8", "gap", json!({}))];
        for size in 1..text.len() {
            let mut parser = EventParser::default();
            let events: Vec<_> = text.as_bytes().chunks(size).flat_map(|chunk| parser.push(chunk)).collect();
            let found: Vec<_> =
                events.iter().map(|e| (e.id.as_str(), e.kind.as_str(), e.data.clone())).collect();
            assert_eq!(found, expected, "{size}");
        }
    }
}
