//! [`NameSet`]: names that a statement selects as a JSON list.

use std::collections::BTreeSet;

/// Names that belong to one run, such as its tags, in alphabetical order.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct NameSet(pub BTreeSet<String>);

impl sqlx::Type<sqlx::Sqlite> for NameSet {
    fn type_info() -> sqlx::sqlite::SqliteTypeInfo {
        <str as sqlx::Type<sqlx::Sqlite>>::type_info()
    }
}

impl<'r> sqlx::Decode<'r, sqlx::Sqlite> for NameSet {
    fn decode(value: sqlx::sqlite::SqliteValueRef<'r>) -> Result<Self, sqlx::error::BoxDynError> {
        let text = <&str as sqlx::Decode<sqlx::Sqlite>>::decode(value)?;
        Ok(Self(serde_json::from_str(text)?))
    }
}
