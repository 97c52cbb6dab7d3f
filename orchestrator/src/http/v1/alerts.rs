//! Alerts of the server and its runs.

use api_types::{ActiveAlertRule, Alert, AlertMessageState, AlertPage, AlertsQuery};
use axum::extract::State;
use store::alerts::{self, AlertFilter, AlertRow};
use store::ids::RunId;

use crate::api_enums::ConvertEnum;
use crate::http::extract::Query;
use crate::http::paging::{PageCursor, next_cursor, number_before, page_limit};
use crate::http::problem::Problem;
use crate::http::state::AppState;
use clock::rfc3339;

/// List the alerts of the server and its runs, newest first.
///
/// The server keeps the newest 10 000 alerts.
#[utoipa::path(
    get, path = "/alerts", tag = "alerts", params(AlertsQuery),
    responses((status = 200, body = AlertPage), (status = 400, body = Problem), (status = 422, body = Problem))
)]
pub(super) async fn list_alerts(
    State(app): State<AppState>,
    Query(query): Query<AlertsQuery>,
) -> Result<axum::Json<AlertPage>, Problem> {
    let limit = page_limit(query.limit)?;
    let before = number_before(query.cursor.as_deref())?;
    let run = query.run.as_deref().map(str::parse::<RunId>).transpose();
    let run = run.map_err(|error| Problem::invalid("run", error.to_string()))?;
    let mut conn = app.readers.begin().await?; // one snapshot of all tables
    let filter = AlertFilter { run: run.as_ref().map(RunId::as_str), lasts: query.lasting };
    let rows = alerts::page(&mut conn, filter, before, limit).await?;
    let lasting = alerts::count_lasting(&mut conn).await?;
    let next = next_cursor(rows.len(), limit, rows.last().map(|row| PageCursor::at(row.id)));
    let active = app.alert_rules.active().into_iter();
    Ok(axum::Json(AlertPage {
        alerts: rows.into_iter().map(alert_of_row).collect(),
        lasting,
        rules: active.map(|(rule, condition)| ActiveAlertRule { rule: rule.convert(), condition }).collect(),
        has_webhook: app.has_alert_webhook,
        next,
    }))
}

fn alert_of_row(row: AlertRow) -> Alert {
    Alert {
        message_state: message_state(&row),
        id: row.id,
        rule: row.rule.convert(),
        run: row.run,
        run_name: row.run_name,
        subject: row.subject,
        message: row.message,
        began_at: rfc3339(row.began_at),
        ended_at: row.ended_at.map(rfc3339),
        message_error: row.send_error,
    }
}

const fn message_state(row: &AlertRow) -> AlertMessageState {
    match (row.next_attempt_at, &row.send_error, row.sent_at) {
        (Some(_), ..) => AlertMessageState::Waiting,
        (None, Some(_), _) => AlertMessageState::GivenUp,
        (None, None, Some(_)) => AlertMessageState::Sent,
        (None, None, None) => AlertMessageState::None,
    }
}
