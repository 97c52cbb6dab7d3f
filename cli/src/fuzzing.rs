//! Private parsers, for fuzz tests only. They are not behind a feature, because a feature would compile the crate twice: for the
//! program and for the tests.

use std::path::PathBuf;

use crate::bind_args::literal_text;
use crate::config::ConfigFile;
use crate::token::{TokenLifetime, parse_lifetime};

/// Parses an address to bind without resolving its name, and returns its text.
///
/// # Errors
/// Returns why the text is no address.
pub fn bind_address(text: &str) -> Result<String, String> {
    literal_text(text)
}

/// Parses a configuration file.
///
/// # Errors
/// Returns why the text is no configuration file, with the line.
pub fn config_file(text: &str) -> Result<(), String> {
    ConfigFile::parse(PathBuf::from("sparring.toml"), text).map(drop).map_err(|error| error.to_string())
}

/// Parses the lifetime of a token, and returns it in seconds; none if the token never expires.
///
/// # Errors
/// Returns why the text is no lifetime.
pub fn token_lifetime(text: &str) -> Result<Option<i64>, String> {
    Ok(match parse_lifetime(text)? {
        TokenLifetime::For(time) => Some(time.as_secs()),
        TokenLifetime::Ever => None,
    })
}
