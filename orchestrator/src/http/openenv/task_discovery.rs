//! Discovery of tasks as OpenEnv 0.10 has it: the splits are the suites of evaluations, and their scenarios are the tasks.
//!
//! A reset with `split` and `index` begins an episode in such a scenario.

use axum::http::StatusCode;
use evaluation::suite::file::{BUILT_IN_SUITES, built_in, built_in_names};
use evaluation::suite::{Suite, SuiteEntry, SuitePart};
use serde_json::{Map, Value, json};

use super::body::{Body, body_location};
use super::error_response::ErrorResponse;
use super::fields::FieldReader;

/// Name of the environment, also in paths.
const ENVIRONMENT: &str = "sparring";

/// List the names of the environments: one.
#[utoipa::path(get, path = "/list_environments", tag = "openenv", responses((status = 200, body = Vec<String>)))]
pub(super) async fn list_environments() -> axum::Json<Value> {
    axum::Json(json!([ENVIRONMENT]))
}

/// List the splits of the tasks: the suites of evaluations.
#[utoipa::path(
    get, path = "/sparring/splits", tag = "openenv",
    responses((status = 200, body = Vec<Object>))
)]
pub(super) async fn list_splits() -> axum::Json<Value> {
    let splits = BUILT_IN_SUITES.iter().map(|suite| json!({"name": suite.name, "type": "test"}));
    axum::Json(splits.collect())
}

/// List the tasks of a split.
#[utoipa::path(
    post, path = "/sparring/tasks", tag = "openenv",
    request_body(content = Object, content_type = "application/json", description = "`{\"split\": …}`"),
    responses(
        (status = 200, body = Object), (status = 404, body = Object), (status = 408, body = Object),
        (status = 413, body = Object), (status = 415, body = Object), (status = 422, body = Object)
    )
)]
pub(super) async fn list_split_tasks(Body(fields): Body) -> Result<axum::Json<Value>, ErrorResponse> {
    let request = SplitRequest::read(fields, &[])?;
    let tasks =
        with_suite(request, |request, suite| Ok(request.tasks(suite, 0..suite.entries().count()))).await?;
    Ok(axum::Json(json!({"tasks": tasks, "env_name": ENVIRONMENT})))
}

/// Get the number of tasks of a split.
#[utoipa::path(
    post, path = "/sparring/num_tasks", tag = "openenv",
    request_body(content = Object, content_type = "application/json", description = "`{\"split\": …}`"),
    responses(
        (status = 200, body = Object), (status = 404, body = Object), (status = 408, body = Object),
        (status = 413, body = Object), (status = 415, body = Object), (status = 422, body = Object)
    )
)]
pub(super) async fn count_split_tasks(Body(fields): Body) -> Result<axum::Json<Value>, ErrorResponse> {
    let request = SplitRequest::read(fields, &[])?;
    let count = with_suite(request, |_, suite| Ok(suite.entries().count())).await?;
    Ok(axum::Json(json!({"num_tasks": count})))
}

/// Get one task of a split by its index.
#[utoipa::path(
    post, path = "/sparring/task", tag = "openenv",
    request_body(content = Object, content_type = "application/json", description = "`{\"split\": …, \"index\": …}`"),
    responses(
        (status = 200, body = Object), (status = 400, body = Object), (status = 404, body = Object),
        (status = 408, body = Object), (status = 413, body = Object), (status = 415, body = Object),
        (status = 422, body = Object)
    )
)]
pub(super) async fn get_split_task(Body(fields): Body) -> Result<axum::Json<Value>, ErrorResponse> {
    let request = SplitRequest::read(fields, &["index"])?;
    let find = |request: &SplitRequest, suite: &Suite| {
        let index = request.index.unwrap_or_default();
        request.tasks(suite, index..index + 1).pop().ok_or_else(invalid_index)
    };
    Ok(axum::Json(json!({"task": with_suite(request, find).await?})))
}

/// Get the tasks of a split from `start` to before `stop`.
#[utoipa::path(
    post, path = "/sparring/task_range", tag = "openenv",
    request_body(content = Object, content_type = "application/json", description = "`{\"split\": …, \"start\": …, \"stop\": …}`"),
    responses(
        (status = 200, body = Object), (status = 400, body = Object), (status = 404, body = Object),
        (status = 408, body = Object), (status = 413, body = Object), (status = 415, body = Object),
        (status = 422, body = Object)
    )
)]
pub(super) async fn list_split_task_range(Body(fields): Body) -> Result<axum::Json<Value>, ErrorResponse> {
    let request = SplitRequest::read(fields, &["start", "stop"])?;
    let find = |request: &SplitRequest, suite: &Suite| {
        let count = suite.entries().count();
        let (start, stop) = (request.start.unwrap_or(0), request.stop.unwrap_or(count));
        if start > stop || stop > count {
            Err(invalid_index())
        } else {
            Ok(request.tasks(suite, start..stop))
        }
    };
    Ok(axum::Json(json!({"tasks": with_suite(request, find).await?})))
}

/// Fields of a request about a split.
struct SplitRequest {
    split: String,
    index: Option<usize>,
    start: Option<usize>,
    stop: Option<usize>,
}

impl SplitRequest {
    /// Reads the fields; `numbers` are the names that the operation has beside `split`.
    fn read(fields: Option<Map<String, Value>>, numbers: &[&str]) -> Result<Self, ErrorResponse> {
        let fields = fields.unwrap_or_default();
        let mut reader = FieldReader::new(&fields, body_location());
        let split = reader.text("split");
        let mut number = |name: &str| {
            let number =
                if numbers.contains(&name) { reader.integer(name, u64::from(u32::MAX)) } else { None };
            number.and_then(|number| usize::try_from(number).ok())
        };
        let (index, start, stop) = (number("index"), number("start"), number("stop"));
        if split.is_none() && reader.get("split").is_none() {
            reader.add_error("split", "missing", "Field required", &Value::Object(fields.clone()));
        }
        if numbers.contains(&"index") && reader.get("index").is_none() {
            reader.add_error("index", "missing", "Field required", &Value::Object(fields.clone()));
        }
        for (name, value) in
            fields.iter().filter(|(name, _)| *name != "split" && !numbers.contains(&name.as_str()))
        {
            reader.add_unknown_field(name, value);
        }
        match split {
            Some(split) if reader.errors.is_empty() => Ok(Self { split, index, start, stop }),
            _ => Err(ErrorResponse::validation(&reader.errors)),
        }
    }

    /// Returns the tasks of a range of the split.
    fn tasks(&self, suite: &Suite, range: std::ops::Range<usize>) -> Vec<Value> {
        let groups = suite.groups.iter();
        let entries = groups.flat_map(|group| group.entries.iter().map(move |entry| (group.level, entry)));
        let selected = entries.enumerate().skip(range.start).take(range.len());
        selected.map(|(index, (level, entry))| self.task(index, level, entry)).collect()
    }

    fn task(&self, index: usize, level: usize, entry: &SuiteEntry) -> Value {
        let part = match entry.part {
            SuitePart::Contested => "contested",
            SuitePart::AsTheyCome => "as_they_come",
        };
        json!({
            "id": entry.scenario.id().to_string(),
            "split": self.split,
            "index": index,
            "task": entry.scenario.task().id(),
            "level": level,
            "part": part,
        })
    }
}

/// Runs `work` on the suite of a request, on a thread for blocking work: the first use of a suite parses it.
async fn with_suite<T: Send + 'static>(
    request: SplitRequest,
    work: impl FnOnce(&SplitRequest, &Suite) -> Result<T, ErrorResponse> + Send + 'static,
) -> Result<T, ErrorResponse> {
    let run = move || {
        let loaded = built_in(&request.split).ok_or_else(|| {
            let detail = format!("unknown split {:?}; the splits are {}", request.split, built_in_names());
            ErrorResponse::new(StatusCode::NOT_FOUND, detail)
        })?;
        work(&request, &loaded.suite)
    };
    let failed = |_| ErrorResponse::new(StatusCode::INTERNAL_SERVER_ERROR, "The suite cannot be read.");
    tokio::task::spawn_blocking(run).await.map_err(failed)?
}

fn invalid_index() -> ErrorResponse {
    ErrorResponse::new(StatusCode::BAD_REQUEST, "Invalid task index")
}
