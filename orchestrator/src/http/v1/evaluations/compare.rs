//! Evaluations compared.

use axum::extract::State;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};

use super::super::super::extract::Query;
use super::super::super::problem::Problem;
use super::super::super::room::aside;
use crate::evaluation::report::ComparisonRow;
use crate::evaluation::seeds::AcrossSeeds;
use crate::ids::{InvalidId, EvaluationId};
use crate::http::state::AppState;
use crate::engine::error::ServiceError;
use crate::evaluation::read::{compare as compared, read, Found, MOST, Sides};

/// Which are compared.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(in crate::http::v1) struct Which {
    /// Evaluations by their ids, separated by commas: trainings of one kind that differ by their seed.
    #[param(example = "eval-1,eval-2")]
    a: String,
    /// The same of what they are compared with.
    #[param(example = "eval-3")]
    b: String,
}

/// One side against the other.
#[derive(Serialize, ToSchema)]
pub(in crate::http::v1) struct Comparison {
    /// The suite of all of them.
    suite: String,
    /// One side.
    a: Side,
    /// The other.
    b: Side,
    /// The first against the other on the same scenarios, trainings of a side taken together: for each task and part `{task, part,
    /// scenarios, score, success, skill, improvement}`, the last four as `{mean, low, high, scenarios}`, 95 % bootstrap intervals over
    /// scenarios. `improvement` is how likely an episode of the first scores higher, ties counting one half.
    #[schema(value_type = Vec<Object>)]
    rows: Vec<ComparisonRow>,
}

/// One side.
#[derive(Serialize, ToSchema)]
struct Side {
    /// Its evaluations.
    evaluations: Vec<String>,
    /// Interquartile means over its trainings of their mean score, success and skill on the suite: `{trainings, score, success, skill}`,
    /// 95 % bootstrap intervals over trainings. Those of fewer than three say little.
    #[schema(value_type = Object)]
    across: AcrossSeeds,
}

/// Compare evaluations of the same suite: paired on scenarios, and across trainings where there are several.
#[utoipa::path(
    get, path = "/evaluations/compare", tag = "evaluations", params(Which),
    responses(
        (status = 200, body = Comparison), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem)
    )
)]
pub(in crate::http::v1) async fn compare(
    State(app): State<AppState>,
    Query(which): Query<Which>,
) -> Result<axum::Json<Comparison>, Problem> {
    let (a, b) = (side(&app, "a", &which.a).await?, side(&app, "b", &which.b).await?);
    let names = |side: &[Found]| side.iter().map(|found| EvaluationId(found.row.id).to_string()).collect();
    let (one, other): (Vec<String>, Vec<String>) = (names(&a), names(&b));
    let Sides { report, one: across_a, other: across_b } =
        aside(move || Ok(compared(&a, &b).map_err(ServiceError::from)?)).await?;
    Ok(axum::Json(Comparison {
        suite: report.suite,
        a: Side { evaluations: one, across: across_a },
        b: Side { evaluations: other, across: across_b },
        rows: report.comparisons,
    }))
}

async fn side(app: &AppState, field: &str, text: &str) -> Result<Vec<Found>, Problem> {
    let ids: Vec<&str> = text.split(',').map(str::trim).collect();
    if ids.len() > MOST {
        return Err(Problem::invalid(field, format!("{} evaluations; at most {MOST} are taken", ids.len())));
    }
    let mut conn = app.readers.acquire().await?;
    let mut all = Vec::with_capacity(ids.len());
    for text in ids {
        let EvaluationId(number) =
            text.parse().map_err(|error: InvalidId| Problem::invalid(field, error.to_string()))?;
        all.push(read(&mut conn, number).await.map_err(ServiceError::from)?);
    }
    Ok(all)
}
