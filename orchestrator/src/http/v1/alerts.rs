//! Alerts of the server and its runs.

use api_types::{ActiveAlertRule, Alert, AlertMessageState, AlertPage, AlertsQuery};
use axum::extract::State;
use axum::http::HeaderMap;
use store::alerts::{self, AlertFilter, AlertRow};
use store::ids::RunId;
use store::shard::Shard;

use super::numbered_list::{NumberedQuery, list_of_shards, own_number, parse_shard_cursor};
use crate::api_enums::ConvertEnum;
use crate::http::extract::Query;
use crate::http::paging::{PageCursor, next_cursor, number_before, page_limit};
use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::shards::merge::NumberedItem;
use clock::rfc3339;

/// List the alerts of the server and its runs, newest first.
///
/// The server keeps the newest 10 000 alerts. A server with peers lists the alerts of all shards.
#[utoipa::path(
    get, path = "/alerts", tag = "alerts", params(AlertsQuery),
    responses((status = 200, body = AlertPage), (status = 400, body = Problem), (status = 422, body = Problem))
)]
pub(super) async fn list_alerts(
    State(app): State<AppState>,
    headers: HeaderMap,
    Query(query): Query<AlertsQuery>,
) -> Result<axum::Json<AlertPage>, Problem> {
    let limit = page_limit(query.limit)?;
    let run = query.run.as_deref().map(str::parse::<RunId>).transpose();
    let run = run.map_err(|error| Problem::invalid("run", error.to_string()))?;
    let filter = AlertFilter { run: run.as_ref().map(RunId::as_str), lasts: query.lasting };
    if !app.shards.is_merged(&headers) {
        let before = number_before(query.cursor.as_deref())?;
        return Ok(axum::Json(list_own_alerts(&app, filter, before, limit).await?));
    }
    let run = run.as_ref().map(|run| format!("run={run}&")).unwrap_or_default();
    let filters = format!("{run}lasting={}&", query.lasting);
    let cursor = parse_shard_cursor(query.cursor.as_deref())?;
    let own = list_own_alerts(&app, filter, own_number(&app, &cursor), limit).await?;
    let (rules, has_webhook) = (own.rules.clone(), own.has_webhook);
    let mut lasting = 0;
    let numbered = |page: AlertPage| {
        lasting += page.lasting;
        let item = |alert: Alert| NumberedItem { at: alert.began_at.clone(), number: alert.id, item: alert };
        page.alerts.into_iter().map(item).collect()
    };
    let query = NumberedQuery { path: "/v1/alerts", filters, limit, cursor };
    let listed = list_of_shards(&app, &headers, query, own, numbered, |page| page.next.is_some()).await;
    let (alerts, next) = (listed.merged.items, listed.merged.next);
    Ok(axum::Json(AlertPage { alerts, lasting, rules, has_webhook, next, missing_shards: listed.missing }))
}

/// Reads a page of the alerts of this server.
async fn list_own_alerts(
    app: &AppState,
    filter: AlertFilter<'_>,
    before: i64,
    limit: i64,
) -> Result<AlertPage, Problem> {
    let mut conn = app.readers.begin().await?; // one snapshot of all tables
    let rows = alerts::page(&mut conn, filter, before, limit).await?;
    let lasting = alerts::count_lasting(&mut conn).await?;
    let next = next_cursor(rows.len(), limit, rows.last().map(|row| PageCursor::at(row.id)));
    let active = app.alert_rules.active().into_iter();
    Ok(AlertPage {
        alerts: rows.into_iter().map(|row| alert_of_row(row, app.shards.own())).collect(),
        lasting,
        rules: active.map(|(rule, condition)| ActiveAlertRule { rule: rule.convert(), condition }).collect(),
        has_webhook: app.has_alert_webhook,
        next,
        missing_shards: Vec::new(),
    })
}

fn alert_of_row(row: AlertRow, shard: Option<&Shard>) -> Alert {
    Alert {
        message_state: message_state(&row),
        id: row.id,
        shard: shard.map(ToString::to_string),
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
