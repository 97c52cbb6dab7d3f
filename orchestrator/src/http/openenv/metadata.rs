//! Metadata of the environment: name, schemas and web manifest.

use axum::extract::Query;
use axum::http::StatusCode;
use serde::Deserialize;
use serde_json::{Value, json};

use super::error_response::ErrorResponse;
use super::tasks::{RESET_ORDER, known_tasks, task_by_name};

/// Get the health of the server in openenv-core's format.
#[utoipa::path(get, path = "/health", tag = "openenv", responses((status = 200, body = Object)))]
pub(super) async fn get_health() -> axum::Json<Value> {
    axum::Json(json!({"status": "healthy"}))
}

/// Get the name, description and version of the environment.
#[utoipa::path(get, path = "/metadata", tag = "openenv", responses((status = 200, body = Object)))]
pub(super) async fn get_environment_metadata() -> axum::Json<Value> {
    axum::Json(metadata_value("SparringEnvironment"))
}

/// Get the same metadata under the name of the web mode.
pub(super) async fn web_metadata() -> axum::Json<Value> {
    axum::Json(metadata_value("sparring"))
}

fn metadata_value(name: &str) -> Value {
    json!({
        "name": name,
        "description": "Sparring: satellites that avoid debris, dock, or observe the Earth; with seeds, a choice of task, and a curriculum",
        "readme_content": null,
        "version": env!("CARGO_PKG_VERSION"),
        "author": null,
        "documentation_url": null,
    })
}

/// Query of the schemas.
#[derive(Deserialize, utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
pub(super) struct SchemaQuery {
    /// Id of the task (default: kessler/survival). Tasks of kessler, and those of docking, share the action and the observation.
    task: Option<String>,
}

/// Get the JSON Schemas of action, observation and state.
#[utoipa::path(
    get, path = "/schema", tag = "openenv", params(SchemaQuery),
    responses((status = 200, body = Object), (status = 404, body = Object))
)]
pub(super) async fn get_environment_schema(
    Query(query): Query<SchemaQuery>,
) -> Result<axum::Json<Value>, ErrorResponse> {
    let id = query.task.as_deref().unwrap_or(RESET_ORDER[0]);
    let unknown =
        || ErrorResponse::new(StatusCode::NOT_FOUND, format!("task: must be one of {}", known_tasks()));
    let wire = openenv_wire::wire_format(task_by_name(id).ok_or_else(unknown)?);
    Ok(axum::Json(json!({
        "action": wire.action_schema(),
        "observation": wire.observation_schema(),
        "reset_observation": wire.observation_schema(),
        "state": state_schema(),
    })))
}

/// Returns the schema of openenv-core's `State`.
fn state_schema() -> Value {
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

/// Get the web app manifest of the page.
#[utoipa::path(get, path = "/manifest.json", tag = "openenv", responses((status = 200, body = Object)))]
pub(super) async fn get_manifest() -> axum::Json<Value> {
    axum::Json(json!({
        "name": "Sparring",
        "short_name": "Sparring",
        "description": "Satellites that avoid debris, dock, or observe the Earth",
        "start_url": "/web",
        "display": "standalone",
        "background_color": "#0f0f1a",
        "theme_color": "#6366f1",
        "icons": []
    }))
}
