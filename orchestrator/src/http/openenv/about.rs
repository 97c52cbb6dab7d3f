//! What the environment says of itself.

use axum::extract::Query;
use axum::http::StatusCode;
use serde::Deserialize;
use serde_json::{Value, json};

use super::read::{WALK, known, named};
use super::refusal::Refusal;

/// Whether the server lives, in openenv-core's words.
#[utoipa::path(get, path = "/health", tag = "openenv", responses((status = 200, body = Object)))]
pub(super) async fn health() -> axum::Json<Value> {
    axum::Json(json!({"status": "healthy"}))
}

/// Name, description, version.
#[utoipa::path(get, path = "/metadata", tag = "openenv", responses((status = 200, body = Object)))]
pub(super) async fn metadata() -> axum::Json<Value> {
    axum::Json(card("SparringEnvironment"))
}

/// What the web mode calls the same.
pub(super) async fn web_metadata() -> axum::Json<Value> {
    axum::Json(card("sparring"))
}

fn card(name: &str) -> Value {
    json!({
        "name": name,
        "description": "Sparring: satellites through debris, or to a docking; with seeds, a choice of task, and a curriculum",
        "readme_content": null,
        "version": env!("CARGO_PKG_VERSION"),
        "author": null,
        "documentation_url": null,
    })
}

/// Which task's schemas.
#[derive(Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
pub(super) struct OfTask {
    /// The task (kessler/survival): tasks of one world have the same action and observation.
    task: Option<String>,
}

/// JSON Schemas of action, observation and state.
#[utoipa::path(
    get, path = "/schema", tag = "openenv", params(OfTask),
    responses((status = 200, body = Object), (status = 404, body = Object))
)]
pub(super) async fn schema(Query(of): Query<OfTask>) -> Result<axum::Json<Value>, Refusal> {
    let id = of.task.as_deref().unwrap_or(WALK[0]);
    let none =
        || Refusal::new(StatusCode::NOT_FOUND, format!("task: there is no such task; known are {}", known()));
    let wire = openenv_wire::wire_format(named(id).ok_or_else(none)?);
    Ok(axum::Json(json!({
        "action": wire.action_schema(),
        "observation": wire.observation_schema(),
        "state": state(),
    })))
}

fn state() -> Value {
    json!({
        "additionalProperties": true,
        "description": "Base class for environment state.\n\nRepresents internal environment state, separate from observations.",
        "properties": {
            "episode_id": {
                "anyOf": [{"type": "string"}, {"type": "null"}],
                "default": null,
                "description": "Unique identifier for the current episode",
                "title": "Episode Id"
            },
            "step_count": {
                "default": 0,
                "description": "Number of steps taken in the current episode",
                "minimum": 0,
                "title": "Step Count",
                "type": "integer"
            }
        },
        "title": "State",
        "type": "object"
    })
}

/// What a browser is told when the page is installed as an app.
#[utoipa::path(get, path = "/manifest.json", tag = "openenv", responses((status = 200, body = Object)))]
pub(super) async fn manifest() -> axum::Json<Value> {
    axum::Json(json!({
        "name": "Sparring",
        "short_name": "Sparring",
        "description": "Satellites through debris, or to a docking",
        "start_url": "/web",
        "display": "standalone",
        "background_color": "#0f0f1a",
        "theme_color": "#6366f1",
        "icons": []
    }))
}
