//! Strategies: what there is to choose from, and how each can be set.

use serde::Serialize;
use serde_json::Value;
use utoipa::ToSchema;

use super::super::extract::NoQuery;
use super::super::problem::Problem;
use curriculum::{Hyperparameter, StrategyKind};

/// All strategies.
#[derive(Serialize, ToSchema)]
pub(super) struct Strategies {
    /// The default first.
    strategies: Vec<Strategy>,
}

/// One strategy.
#[derive(Serialize, ToSchema)]
struct Strategy {
    /// Its name.
    name: &'static str,
    /// What it does, in a few words.
    about: &'static str,
    /// Whether its episodes can be leased as columns: not where it faces single scenarios again.
    columns: bool,
    /// The settings of its own: `strategy_settings` of a run.
    settings: Vec<Setting>,
}

/// A setting of a strategy.
#[derive(Serialize, ToSchema)]
struct Setting {
    /// Its name.
    name: &'static str,
    /// What it does.
    about: &'static str,
    /// What it takes, in words.
    takes: String,
    /// What it is unless told.
    #[schema(schema_with = crate::runs::settings_schema::setting)]
    default: Value,
    /// Where that comes from.
    source: &'static str,
}

impl Setting {
    fn of(hyper: &Hyperparameter) -> Self {
        let Hyperparameter { name, range, description: about, source } = *hyper;
        Self { name, about, takes: range.expectation(), default: range.default_json(), source }
    }
}

/// List the strategies with the settings of each.
#[utoipa::path(
    get, path = "/strategies", tag = "tasks",
    responses((status = 200, body = Strategies), (status = 400, body = Problem))
)]
pub(super) async fn list(_: NoQuery) -> Result<axum::Json<Strategies>, Problem> {
    let of = |kind: StrategyKind| Strategy {
        name: kind.name(),
        about: kind.description(),
        columns: !kind.replays_scenarios(),
        settings: kind.hyperparameters().iter().map(Setting::of).collect(),
    };
    Ok(axum::Json(Strategies { strategies: StrategyKind::ALL.into_iter().map(of).collect() }))
}
