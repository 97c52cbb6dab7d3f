//! The version of a server, which its clients compare with their own.

/// Header of every response with the version of the server.
pub const VERSION_HEADER: &str = "sparring-version";
/// Version of this build, which servers send and clients compare.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Checks the version that a server sent. Versions with the same first two numbers work together.
///
/// # Errors
/// Returns a sentence for the user of a client that has another version.
pub fn check_server_version(server: &str) -> Result<(), String> {
    let series = |version: &str| version.split('.').take(2).map(str::to_owned).collect::<Vec<_>>();
    if series(server) == series(VERSION) {
        return Ok(());
    }
    let server: String = server.chars().take(30).collect();
    Err(format!(
        "the server has version {server} and this client {VERSION}; install the same version of both"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patch_releases_work_together() {
        let [major, minor, _] = VERSION.split('.').collect::<Vec<_>>()[..] else { panic!("{VERSION}") };
        for same in [VERSION.to_owned(), format!("{major}.{minor}.99"), format!("{major}.{minor}")] {
            assert_eq!(check_server_version(&same), Ok(()));
        }
        for other in [format!("{major}.99.0"), format!("9{major}.{minor}.0"), "nonsense".to_owned()] {
            let sentence = format!(
                "the server has version {other} and this client {VERSION}; install the same version of both"
            );
            assert_eq!(check_server_version(&other), Err(sentence));
        }
    }
}
