//! Messages to the webhook: their bodies, attempts and pauses.

use std::fmt;
use std::time::Duration;

use clock::{Millis, rfc3339};
use llm::{TrustedRoots, http_client_builder};
use reqwest::Url;
use secrecy::{ExposeSecret, SecretString};
use serde_json::{Value, json};
use store::alerts::AlertRow;

/// Longest time in which the receiver must answer.
const TIMEOUT: Duration = Duration::from_secs(10);
/// Pause before the second attempt; each further one is twice as long.
const FIRST_PAUSE_MS: Millis = 2_000;
/// Longest pause between two attempts.
const MAX_PAUSE_MS: Millis = 600_000;
/// Time after which a message is given up.
const GIVE_UP_AFTER_MS: Millis = 24 * 3_600_000;
/// Version of the body in the format `json`.
const VERSION: u32 = 1;

/// Format of the body of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MessageFormat {
    /// All fields of the alert.
    #[default]
    Json,
    /// A text, for an incoming webhook of Slack or of a service that takes its format.
    Slack,
}

/// Receiver of messages about alerts.
#[derive(Clone)]
pub struct Webhook {
    client: reqwest::Client,
    /// The address, which often has a key in its path.
    url: SecretString,
    format: MessageFormat,
}

/// A webhook that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum InvalidWebhook {
    /// The address is no URL of http or https.
    #[error("must be a URL that begins with http:// or https://")]
    Url,
    /// The system's certificates cannot be used.
    #[error("TLS cannot be used: {0}")]
    Tls(String),
}

impl fmt::Debug for Webhook {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Webhook").field("format", &self.format).finish_non_exhaustive()
    }
}

impl Webhook {
    /// A webhook at a URL.
    ///
    /// # Errors
    /// Returns an error if the URL is not one of http or https, or the system has no certificates for https.
    pub fn new(url: &str, format: MessageFormat) -> Result<Self, InvalidWebhook> {
        let parsed = Url::parse(url).map_err(|_| InvalidWebhook::Url)?;
        let roots = match parsed.scheme() {
            "https" => TrustedRoots::System,
            "http" => TrustedRoots::None,
            _ => return Err(InvalidWebhook::Url),
        };
        let builder = http_client_builder(roots).map_err(InvalidWebhook::Tls)?;
        let client =
            builder.timeout(TIMEOUT).build().map_err(|error| InvalidWebhook::Tls(error.to_string()))?;
        Ok(Self { client, url: SecretString::from(url), format })
    }

    /// Sends the message of an alert that is due: its beginning, or its end if the beginning was sent.
    ///
    /// # Errors
    /// Returns a sentence without the address if the receiver does not answer with a status of success.
    pub async fn send(&self, alert: &AlertRow) -> Result<(), String> {
        let body = match self.format {
            MessageFormat::Json => json_body(alert),
            MessageFormat::Slack => slack_body(alert),
        };
        let sent = self.client.post(self.url.expose_secret()).json(&body).send().await;
        let response = sent.map_err(|error| failure_of(&error))?;
        match response.status() {
            status if status.is_success() => Ok(()),
            status => Err(format!("the receiver answered with status {}", status.as_u16())),
        }
    }
}

/// Returns why a request failed, without its address, which may have a key.
fn failure_of(error: &reqwest::Error) -> String {
    match error {
        error if error.is_timeout() => format!("the receiver did not answer within {} s", TIMEOUT.as_secs()),
        error if error.is_connect() => "the receiver cannot be reached".to_owned(),
        _ => "the request failed".to_owned(),
    }
}

/// Returns true if the due message is about the end of the alert.
const fn is_about_end(alert: &AlertRow) -> bool {
    alert.sent_at.is_some()
}

/// Returns the body with all fields.
fn json_body(alert: &AlertRow) -> Value {
    let is_end = is_about_end(alert);
    json!({
        "version": VERSION,
        "alert": alert.id,
        "state": if is_end { "ended" } else { "began" },
        "rule": alert.rule,
        "run": alert.run.as_ref().map(|id| json!({"id": id, "name": alert.run_name})),
        "subject": alert.subject,
        "message": alert.message,
        "began_at": rfc3339(alert.began_at),
        "ended_at": alert.ended_at.filter(|_| is_end).map(rfc3339),
    })
}

/// Returns the body for Slack.
fn slack_body(alert: &AlertRow) -> Value {
    let place = alert.run_name.as_ref().map_or_else(|| "server".to_owned(), |name| format!("run {name}"));
    let prefix = if is_about_end(alert) { "Ended: " } else { "" };
    json!({"text": format!("*Sparring, {}*: {prefix}{}", escape(&place), escape(&alert.message))})
}

/// Escapes the characters that Slack's format reserves.
fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

/// Returns when a message is tried again after a failed attempt; `None` if it is given up.
pub(crate) fn next_attempt(alert: &AlertRow, now: Millis) -> Option<Millis> {
    let due_since = alert.ended_at.filter(|_| is_about_end(alert)).unwrap_or(alert.began_at);
    let doublings = u32::try_from(alert.attempts).unwrap_or(u32::MAX).min(16);
    let pause = (FIRST_PAUSE_MS << doublings).min(MAX_PAUSE_MS);
    (now + pause < due_since + GIVE_UP_AFTER_MS).then_some(now + pause)
}

#[cfg(test)]
mod tests {
    use store::alerts::AlertRule;

    use super::*;

    fn alert() -> AlertRow {
        AlertRow {
            id: 3,
            rule: AlertRule::MissingShare,
            run: Some("a".to_owned()),
            run_name: Some("first <try>".to_owned()),
            subject: "kessler/survival".to_owned(),
            message: "23 % are missing.".to_owned(),
            began_at: 1_000,
            ended_at: None,
            sent_at: None,
            end_sent_at: None,
            attempts: 0,
            next_attempt_at: Some(1_000),
            send_error: None,
        }
    }

    #[test]
    fn bodies_say_what_began_and_what_ended() {
        let (began, ended) = (alert(), AlertRow { sent_at: Some(1_500), ended_at: Some(61_000), ..alert() });
        let body = json_body(&began);
        assert_eq!((&body["state"], &body["ended_at"]), (&json!("began"), &Value::Null));
        assert_eq!(body["run"], json!({"id": "a", "name": "first <try>"}));
        assert_eq!(
            (&body["rule"], &body["began_at"]),
            (&json!("missing_share"), &json!("1970-01-01T00:00:01.000Z"))
        );
        let text = "*Sparring, run first &lt;try&gt;*: 23 % are missing.";
        assert_eq!(slack_body(&began), json!({ "text": text }));
        let body = json_body(&ended);
        assert_eq!(
            (&body["state"], &body["ended_at"]),
            (&json!("ended"), &json!("1970-01-01T00:01:01.000Z"))
        );
        let text = "*Sparring, run first &lt;try&gt;*: Ended: 23 % are missing.";
        assert_eq!(slack_body(&ended), json!({ "text": text }));
    }

    #[test]
    fn attempts_pause_longer_each_time_for_a_day() {
        let attempts = |attempts| next_attempt(&AlertRow { attempts, ..alert() }, 10_000);
        assert_eq!([0, 1, 2, 9, 10_000].map(attempts), [12_000, 14_000, 18_000, 610_000, 610_000].map(Some));
        assert_eq!(next_attempt(&alert(), GIVE_UP_AFTER_MS), None);
    }

    #[test]
    fn only_http_urls_are_webhooks() {
        for url in ["", "hooks.example.com/x", "ftp://example.com", "file:///etc/passwd"] {
            assert!(matches!(Webhook::new(url, MessageFormat::Json), Err(InvalidWebhook::Url)), "{url}");
        }
        let shown = format!("{:?}", Webhook::new("http://127.0.0.1/secret", MessageFormat::Json).unwrap());
        assert!(!shown.contains("secret"), "{shown}");
    }
}
