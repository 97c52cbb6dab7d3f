//! The URL of a server: a host, a port and a path.

use reqwest::Url;

/// Parses the URL of a server with one of these schemes.
///
/// # Errors
/// Returns an error if the text is no URL, or if it has another scheme, a user, password, query or fragment.
pub(crate) fn parse_server_url(text: &str, schemes: &[&str]) -> Result<Url, String> {
    let url =
        Url::parse(text).map_err(|_| format!("{text:?} must be an address such as http://127.0.0.1:8700"))?;
    if !schemes.contains(&url.scheme()) {
        return Err(format!("the scheme must be {}, not {}", list(schemes), url.scheme()));
    }
    let is_plain = url.username().is_empty() && url.password().is_none();
    if !is_plain || url.query().is_some() || url.fragment().is_some() || url.host_str().is_none() {
        return Err("it must be only a host, a port and a path: no user, password, query or fragment".into());
    }
    Ok(url)
}

/// Returns words as a list with `or`.
fn list(words: &[&str]) -> String {
    match words {
        [first @ .., last] if !first.is_empty() => format!("{} or {last}", first.join(", ")),
        _ => words.concat(),
    }
}
