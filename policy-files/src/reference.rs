//! References to policies: names of built-in policies, and files.

use std::fmt;

/// Number of hexadecimal digits of a hash in a reference.
pub(crate) const HASH_DIGITS: usize = 12;

/// Kind of a policy file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum PolicyFileKind {
    /// A neural network in the ONNX format.
    Onnx,
    /// The parameters of a task's reflex, as JSON.
    Reflex,
}

impl PolicyFileKind {
    /// Prefix of references to files of this kind.
    #[must_use]
    pub const fn prefix(self) -> &'static str {
        match self {
            Self::Onnx => "onnx",
            Self::Reflex => "reflex",
        }
    }

    /// Description of the kind, with its article.
    pub(crate) const fn description(self) -> &'static str {
        match self {
            Self::Onnx => "an ONNX policy",
            Self::Reflex => "a reflex policy",
        }
    }
}

/// Reference to a policy: `NAME` of a built-in policy, `onnx:FILE` or `reflex:FILE`, the latter two with or without `@HASH`, the
/// first twelve hexadecimal digits of the BLAKE3 hash of the file.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub enum PolicyReference {
    /// A built-in policy, by its name.
    BuiltIn(String),
    /// A policy in a file.
    File {
        /// Kind of the file.
        kind: PolicyFileKind,
        /// Path of the file, or its name in a [`PolicyFolder`](crate::PolicyFolder).
        file: String,
        /// Beginning of the hash that the file must have.
        hash: Option<String>,
    },
}

impl PolicyReference {
    /// Parses a reference. A text without the prefix of a kind is the name of a built-in policy.
    #[must_use]
    pub fn parse(text: &str) -> Self {
        for kind in [PolicyFileKind::Onnx, PolicyFileKind::Reflex] {
            let Some(file) = text.strip_prefix(kind.prefix()).and_then(|rest| rest.strip_prefix(':')) else {
                continue;
            };
            let is_hash = |text: &str| {
                text.len() == HASH_DIGITS
                    && text.bytes().all(|b| b.is_ascii_digit() || (b'a'..=b'f').contains(&b))
            };
            return match file.rsplit_once('@').filter(|(_, hash)| is_hash(hash)) {
                Some((file, hash)) => Self::File { kind, file: file.to_owned(), hash: Some(hash.to_owned()) },
                None => Self::File { kind, file: file.to_owned(), hash: None },
            };
        }
        Self::BuiltIn(text.to_owned())
    }

    /// True if the policy is in a file.
    #[must_use]
    pub const fn is_file(&self) -> bool {
        matches!(self, Self::File { .. })
    }
}

impl fmt::Display for PolicyReference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::BuiltIn(name) => f.write_str(name),
            Self::File { kind, file, hash: None } => write!(f, "{}:{file}", kind.prefix()),
            Self::File { kind, file, hash: Some(hash) } => write!(f, "{}:{file}@{hash}", kind.prefix()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hash_of_a_file_is_checked_and_devices_are_refused() {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/fixtures/onnx/tracks_continuous.onnx");
        let open = |text: String| crate::open(&PolicyReference::parse(&text)).map(|_| ());
        open(format!("onnx:{file}")).unwrap();
        let changed = open(format!("onnx:{file}@000000000000")).unwrap_err().to_string();
        let found = changed.rsplit(' ').next().unwrap();
        open(format!("onnx:{file}@{found}")).unwrap();
        let device = open("onnx:/dev/zero".to_owned()).unwrap_err().to_string();
        assert!(device.contains("not a regular file"), "{device}");
    }

    #[test]
    fn references_parse_and_print_as_given() {
        for text in [
            "hold",
            "",
            "onnx",
            "onnx:",
            "onnx:model.onnx",
            "onnx:a@b.onnx",
            "onnx:model.onnx@0123456789ab",
            "reflex:folder/demo.json",
            "reflex:demo.json@0123456789AB",
        ] {
            assert_eq!(PolicyReference::parse(text).to_string(), text);
        }
        assert!(!PolicyReference::parse("onnx").is_file());
        let hashed = PolicyReference::parse("onnx:model.onnx@0123456789ab");
        let file = "model.onnx".to_owned();
        let hash = Some("0123456789ab".to_owned());
        assert_eq!(hashed, PolicyReference::File { kind: PolicyFileKind::Onnx, file, hash });
    }
}
