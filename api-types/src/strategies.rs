//! Strategies of the curriculum and their settings.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;
use utoipa::openapi::schema::{Object, OneOf, Schema, Type};

/// Strategies of the server.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct StrategyList {
    /// Strategies, the default first.
    pub strategies: Vec<Strategy>,
}

/// Strategy of a curriculum.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct Strategy {
    /// Name of the strategy.
    pub name: String,
    /// Description in a few words.
    pub description: String,
    /// True if its episodes can be leased as columns; false if it repeats single scenarios, or reacts to every group.
    pub supports_columns: bool,
    /// Settings of the strategy: `strategy_settings` of a run.
    pub settings: Vec<StrategySetting>,
}

/// Setting of a strategy.
#[derive(Debug, Clone, Serialize, Deserialize, ToSchema)]
pub struct StrategySetting {
    /// Name of the setting.
    pub name: String,
    /// Description of its effect.
    pub description: String,
    /// Description of the accepted values, such as `a number from 0 to 1`.
    pub accepts: String,
    /// Default value of the setting.
    #[schema(schema_with = strategy_setting_schema)]
    pub default: Value,
    /// Source of the default.
    pub source: String,
}

fn number_or_string() -> OneOf {
    let of = |kind| Object::builder().schema_type(kind);
    OneOf::builder().item(of(Type::Number)).item(of(Type::String)).build()
}

/// Schema of the value of a strategy's setting: names and values differ by strategy, so that no type describes them.
#[must_use]
pub fn strategy_setting_schema() -> Schema {
    let mut either = number_or_string();
    either.description = Some("Default value of the setting.".to_owned());
    either.into()
}

/// Schema of all settings of a strategy, by name.
#[must_use]
pub fn strategy_settings_schema() -> Schema {
    let description = "Settings of the strategy, by name; the others have their defaults. A change of a run that keeps its strategy \
                       keeps the others instead. `GET /v1/strategies` lists all settings.";
    let either = Schema::from(number_or_string());
    Object::builder().description(Some(description)).additional_properties(Some(either)).build().into()
}
