//! URLs of NATS servers.

use std::fmt;
use std::str::FromStr;

use async_nats::{ConnectOptions, ServerAddr};

/// URLs of the servers of a NATS cluster: one, or several with commas between them.
#[derive(Clone, PartialEq, Eq)]
pub struct NatsUrl(Vec<ServerAddr>);

/// A text that is not the URL of a NATS server.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{reason}; a URL is such as nats://10.0.0.5:4222 or tls://nats.example.com")]
pub struct InvalidNatsUrl {
    reason: String,
}

/// Parses one URL. Without a scheme it is `nats://`.
fn parse_server(text: &str) -> Result<ServerAddr, InvalidNatsUrl> {
    let invalid = |reason: String| InvalidNatsUrl { reason };
    if text.is_empty() {
        return Err(invalid("a URL is missing".to_owned()));
    }
    let scheme = text.split_once("://").map_or("nats", |(scheme, _)| scheme);
    if !matches!(scheme, "nats" | "tls") {
        // Other characters may be those of a password.
        let is_shown = scheme.bytes().all(|byte| byte.is_ascii_alphabetic());
        let shown = if is_shown { format!(", got {scheme:?}") } else { String::new() };
        return Err(invalid(format!("the scheme must be nats or tls{shown}")));
    }
    // The error of the client names itself before the reason.
    let reason = |error: std::io::Error| {
        let text = error.to_string();
        text.rsplit(": ").next().unwrap_or_default().to_owned()
    };
    let server: ServerAddr = text.parse().map_err(|error| invalid(reason(error)))?;
    if server.host().is_empty() {
        return Err(invalid("the URL has no host".to_owned()));
    }
    let has_escapes = |part: Option<&str>| part.is_some_and(|part| part.contains('%'));
    if has_escapes(server.username()) || has_escapes(server.password()) {
        let reason =
            "the user and the password may have letters, digits and `-._~` only; else use --nats-creds";
        return Err(invalid(reason.to_owned()));
    }
    Ok(server)
}

impl FromStr for NatsUrl {
    type Err = InvalidNatsUrl;

    fn from_str(text: &str) -> Result<Self, InvalidNatsUrl> {
        text.split(',').map(|part| parse_server(part.trim())).collect::<Result<_, _>>().map(Self)
    }
}

impl NatsUrl {
    /// Returns the addresses of the servers.
    pub(crate) fn servers(&self) -> &[ServerAddr] {
        &self.0
    }

    /// Returns true if a server must be reached by TLS; the credentials are then sent to no server without it.
    pub(super) fn has_tls(&self) -> bool {
        self.0.iter().any(|server| server.scheme() == "tls")
    }

    /// Adds the user and password, or the token, of the first server that has one.
    pub(super) fn with_user(&self, options: ConnectOptions) -> ConnectOptions {
        let user = self.0.iter().find_map(|server| Some((server.username()?, server.password())));
        match user {
            Some((user, Some(password))) => options.user_and_password(user.to_owned(), password.to_owned()),
            Some((token, None)) => options.token(token.to_owned()),
            None => options,
        }
    }
}

/// Shows the URLs without users, passwords and tokens.
impl fmt::Display for NatsUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, server) in self.0.iter().enumerate() {
            let comma = if index == 0 { "" } else { "," };
            let host = server.host();
            let host = if host.contains(':') { format!("[{host}]") } else { host.to_owned() };
            write!(f, "{comma}{}://{host}:{}", server.scheme(), server.port())?;
        }
        Ok(())
    }
}

impl fmt::Debug for NatsUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "NatsUrl({self})")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn urls_are_shown_without_users_and_passwords() {
        let shown = |url: &str| url.parse::<NatsUrl>().unwrap().to_string();
        assert_eq!(shown("nats://user:secret@host:4222"), "nats://host:4222");
        assert_eq!(shown("user:secret@host,  tls://token@other:1"), "nats://host:4222,tls://other:1");
        assert_eq!(shown("nats://[::1]:4222"), "nats://[::1]:4222");
        let parsed: NatsUrl = "nats://user:secret@host".parse().unwrap();
        assert!(!format!("{parsed:?}").contains("secret"));
    }

    #[test]
    fn invalid_urls_name_the_reason() {
        let cases = [
            ("", "a URL is missing"),
            ("nats://a,", "a URL is missing"),
            ("http://host:4222", "the scheme must be nats or tls, got \"http\""),
            ("ws://host", "the scheme must be nats or tls"),
            ("team:s3cret@nats://host", "the scheme must be nats or tls; a URL"),
            ("nats://", "host"),
            ("nats://host:99999", "port"),
            ("nats://a b", "domain"),
            ("nats://user:p%40ss@host", "else use --nats-creds"),
        ];
        for (url, reason) in cases {
            let error = url.parse::<NatsUrl>().unwrap_err().to_string();
            assert!(error.contains(reason) && error.contains("such as nats://"), "{url}: {error}");
        }
    }
}
