//! [`ConfigFile`]: finds and reads `sparring.toml`.

use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use commands::files;
use toml::Table;

/// Name of the file in the working directory and in the user's configuration folder.
const FILE_NAME: &str = "sparring.toml";
/// Environment variable with the path of the file.
pub(super) const CONFIG_VARIABLE: &str = "SPARRING_CONFIG";

/// Configuration file; without a path and empty if there is none.
#[derive(Debug, Clone, Default)]
pub struct ConfigFile {
    path: Option<PathBuf>,
    /// Contents of the file.
    pub(super) settings: Table,
}

impl ConfigFile {
    /// Reads the file that the command line or the environment names, else the first of the standard places that exists.
    ///
    /// # Errors
    /// Returns an error if a named file does not exist, or a file cannot be read or is not TOML.
    pub(super) fn find(line: &[OsString]) -> anyhow::Result<Self> {
        let named =
            named_on(line).or_else(|| std::env::var_os(CONFIG_VARIABLE).filter(|path| !path.is_empty()));
        match named {
            Some(path) => Self::read(PathBuf::from(path)),
            None => match standard_places().into_iter().find(|path| path.is_file()) {
                Some(path) => Self::read(path),
                None => Ok(Self::default()),
            },
        }
    }

    /// Reads a file.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read or is not TOML.
    pub(super) fn read(path: PathBuf) -> anyhow::Result<Self> {
        let text = files::read_text(&path).context("the configuration file")?;
        Self::parse(path, &text)
    }

    /// Parses the text of a file; `path` is its name in errors.
    ///
    /// # Errors
    /// Returns an error if the text is not TOML.
    pub(crate) fn parse(path: PathBuf, text: &str) -> anyhow::Result<Self> {
        let settings = text.parse::<Table>().map_err(|error| {
            let line = error.span().map(|span| text[..span.start].matches('\n').count() + 1);
            let place = line.map_or_else(String::new, |line| format!(", line {line}"));
            anyhow!("{}{place}: {}", path.display(), error.message())
        })?;
        Ok(Self { path: Some(path), settings })
    }

    /// Returns true if there is a file.
    pub(super) const fn exists(&self) -> bool {
        self.path.is_some()
    }

    /// Returns the path of the file, if there is one.
    pub(super) fn path(&self) -> Option<&Path> {
        self.path.as_deref()
    }

    /// Returns the path of the file as text, or its standard name.
    pub(super) fn name(&self) -> String {
        self.path.as_ref().map_or_else(|| FILE_NAME.to_owned(), |path| path.display().to_string())
    }
}

/// Returns the value of `--config` on a command line. The configuration is needed before clap can parse the line.
fn named_on(line: &[OsString]) -> Option<OsString> {
    let mut words = line.iter().skip(1).take_while(|word| *word != OsStr::new("--"));
    while let Some(word) = words.next() {
        if word == "--config" {
            return words.next().cloned();
        }
        if let Some(path) = word.to_str().and_then(|word| word.strip_prefix("--config=")) {
            return Some(path.into());
        }
    }
    None
}

fn standard_places() -> Vec<PathBuf> {
    let absolute = |path: &PathBuf| path.is_absolute();
    let folder = std::env::var_os("XDG_CONFIG_HOME").map(PathBuf::from).filter(absolute).or_else(|| {
        let home = std::env::var_os("HOME").map(PathBuf::from).filter(absolute)?;
        Some(home.join(".config"))
    });
    let mut places = vec![PathBuf::from(FILE_NAME)];
    places.extend(folder.map(|folder| folder.join("sparring").join(FILE_NAME)));
    places
}
