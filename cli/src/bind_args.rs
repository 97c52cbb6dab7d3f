//! `--bind` and `--port`: the address that a server listens on.

use std::net::{IpAddr, Ipv4Addr, SocketAddr, ToSocketAddrs};

use clap::ArgMatches;
use clap::parser::ValueSource;

/// Host of a bind address without a host.
const DEFAULT_HOST: IpAddr = IpAddr::V4(Ipv4Addr::LOCALHOST);
/// Port of a bind address without a port.
const DEFAULT_PORT: u16 = 8700;

/// Arguments of the address that a server listens on.
#[derive(Debug, Clone, clap::Args)]
pub struct BindArgs {
    /// Address to listen on, as HOST:PORT, HOST or PORT. An address that other machines can reach needs a token
    /// (`sparring token create`) or --openenv-public
    #[arg(long, default_value = "127.0.0.1:8700", value_name = "ADDRESS", env = "SPARRING_BIND", value_parser = parse_bind)]
    bind: BindAddress,
    /// Port to listen on, in place of the port of --bind; 0 means a free port
    #[arg(long, value_name = "PORT", env = "SPARRING_PORT")]
    port: Option<u16>,
}

/// Parsed value of `--bind`.
#[derive(Debug, Clone, Copy)]
struct BindAddress {
    host: IpAddr,
    /// Port, if the value has one.
    port: Option<u16>,
}

impl BindArgs {
    /// Returns the address to listen on.
    pub(super) fn address(&self) -> SocketAddr {
        SocketAddr::new(self.bind.host, self.port.or(self.bind.port).unwrap_or(DEFAULT_PORT))
    }

    /// Drops the value of `--port` if the port of `--bind` has precedence: a flag before a variable, a variable before the
    /// configuration file.
    pub(super) fn apply_precedence(&mut self, matches: &ArgMatches) {
        let rank = |name| match matches.value_source(name) {
            Some(ValueSource::CommandLine) => 2,
            Some(ValueSource::EnvVariable) => 1,
            // Values of the configuration file are defaults for clap.
            _ => 0,
        };
        if self.bind.port.is_some() && rank("bind") > rank("port") {
            self.port = None;
        }
    }
}

/// Parses `HOST:PORT`, `HOST`, `:PORT` or `PORT`. A host is an IP address or a name such as `localhost`.
fn parse_bind(text: &str) -> Result<BindAddress, String> {
    match parse_literal(text)? {
        LiteralAddress::Address(address) => Ok(address),
        LiteralAddress::Name { host, port } => resolve(host, port),
    }
}

/// Text of `--bind` before names are resolved.
#[derive(Debug, Clone, Copy)]
enum LiteralAddress<'a> {
    Address(BindAddress),
    Name { host: &'a str, port: Option<u16> },
}

/// Parses an address, or splits a text into a name and a port.
fn parse_literal(text: &str) -> Result<LiteralAddress<'_>, String> {
    let expected =
        || format!("{text:?} is no address: use HOST:PORT such as localhost:8700, a host, or a port");
    let address = |host, port| Ok(LiteralAddress::Address(BindAddress { host, port }));
    if let Ok(socket) = text.parse::<SocketAddr>() {
        return address(socket.ip(), Some(socket.port()));
    }
    if let Ok(port) = text.strip_prefix(':').unwrap_or(text).parse::<u16>() {
        return address(DEFAULT_HOST, Some(port));
    }
    // The system would resolve a number as an IPv4 address.
    if text.chars().all(|c| c.is_ascii_digit()) {
        return Err(format!("{text:?} is no port: a port is 0 to 65535"));
    }
    if let Ok(host) = text.trim_matches(['[', ']']).parse::<IpAddr>() {
        return address(host, None);
    }
    let (host, port) = match text.rsplit_once(':') {
        Some((host, port)) => (host, Some(port.parse().map_err(|_| expected())?)),
        None => (text, None),
    };
    if host.is_empty() {
        return Err(expected());
    }
    Ok(LiteralAddress::Name { host, port })
}

/// Resolves a name to its first address, an IPv4 address if it has one.
fn resolve(host: &str, port: Option<u16>) -> Result<BindAddress, String> {
    let found = (host, DEFAULT_PORT)
        .to_socket_addrs()
        .map_err(|error| format!("host {host:?} is unknown: {error}"))?;
    // A name such as localhost may have an IPv6 and an IPv4 address. Clients try IPv4 addresses in any case.
    let mut found: Vec<SocketAddr> = found.collect();
    found.sort_by_key(SocketAddr::is_ipv6);
    let first = found.first().ok_or_else(|| format!("host {host:?} has no address"))?;
    Ok(BindAddress { host: first.ip(), port })
}

/// Parses a text for fuzz tests, which must not resolve names. Returns the text of the address, or the name and its port.
pub(crate) fn literal_text(text: &str) -> Result<String, String> {
    Ok(match parse_literal(text)? {
        LiteralAddress::Address(BindAddress { host, port: Some(port) }) => {
            SocketAddr::new(host, port).to_string()
        }
        LiteralAddress::Address(BindAddress { host, port: None }) => host.to_string(),
        LiteralAddress::Name { host, port: Some(port) } => format!("{host}:{port}"),
        LiteralAddress::Name { host, port: None } => host.to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn address(bind: &str, port: Option<u16>) -> String {
        BindArgs { bind: parse_bind(bind).unwrap(), port }.address().to_string()
    }

    #[test]
    fn addresses_are_parsed_in_all_spellings() {
        for text in ["127.0.0.1:8700", "8700", ":8700", "localhost:8700", "localhost", "127.0.0.1"] {
            assert_eq!(address(text, None), "127.0.0.1:8700", "{text}");
        }
        assert_eq!(address("0.0.0.0", None), "0.0.0.0:8700");
        assert_eq!(address("[::1]:9000", None), "[::1]:9000");
        assert_eq!(address("::1", None), "[::1]:8700");
        assert_eq!(address("0", None), "127.0.0.1:0");
        for wrong in ["", ":", "localhost:", "localhost:port", "70000", "127.0.0.1:70000"] {
            assert!(parse_bind(wrong).is_err(), "{wrong}");
        }
        assert_eq!(address("0.0.0.0:1", Some(2)), "0.0.0.0:2");
    }
}
