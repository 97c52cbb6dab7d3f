//! Strategies of the curriculum and their settings.

use api_types::{Strategy, StrategyList, StrategySetting};
use curriculum::{Hyperparameter, StrategyKind};

use crate::http::extract::NoQuery;
use crate::http::problem::Problem;

/// List the strategies with their settings.
#[utoipa::path(
    get, path = "/strategies", tag = "curriculum",
    responses((status = 200, body = StrategyList), (status = 400, body = Problem))
)]
pub(super) async fn list_strategies(_: NoQuery) -> Result<axum::Json<StrategyList>, Problem> {
    let strategy = |kind: StrategyKind| Strategy {
        name: kind.name().to_owned(),
        description: kind.description().to_owned(),
        supports_columns: kind.supports_columns(),
        settings: kind.hyperparameters().iter().map(strategy_setting).collect(),
    };
    Ok(axum::Json(StrategyList { strategies: StrategyKind::ALL.into_iter().map(strategy).collect() }))
}

fn strategy_setting(hyperparameter: &Hyperparameter) -> StrategySetting {
    let Hyperparameter { name, range, description, source } = *hyperparameter;
    StrategySetting {
        name: name.to_owned(),
        description: description.to_owned(),
        accepts: range.expectation(),
        default: range.default_json(),
        source: source.to_owned(),
    }
}
