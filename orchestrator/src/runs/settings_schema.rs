//! How the API's document says what a strategy's settings are: their names and values differ by strategy, so that no type says it.

use utoipa::openapi::schema::{Object, OneOf, Schema, Type};

fn number_or_word() -> OneOf {
    let of = |kind| Object::builder().schema_type(kind);
    OneOf::builder().item(of(Type::Number)).item(of(Type::String)).build()
}

/// The value of one.
pub(crate) fn setting() -> Schema {
    let mut either = number_or_word();
    either.description = Some("What it is unless told.".to_owned());
    either.into()
}

/// All that are told, by name.
pub(crate) fn settings() -> Schema {
    let words = "The strategy's own settings, by name; those left out are at their defaults (in a change of a run that keeps its \
                 strategy: stay). `GET /v1/strategies` lists them.";
    let either = Schema::from(number_or_word());
    let all = Object::builder().description(Some(words)).additional_properties(Some(either));
    all.build().into()
}
