//! Handlers of `/v1`, one file or folder for each resource.
//!
//! A handler parses the request, calls one use case or one read model, and maps the result to a type of the `api-types` crate. The
//! name of a handler is its `operationId`. Rules and SQL are not here. Start reading at `routes`.

mod alerts;
mod archive_runs;
mod audit_log;
pub(super) mod columns;
mod designs;
mod episode_critique;
mod episode_list;
mod episode_neighbours;
mod episode_search;
mod episodes;
mod evaluations;
pub(super) mod events;
mod failure_list;
mod failures;
mod layouts;
mod leases;
mod mastery;
mod numbered_list;
mod overview;
mod policy;
mod policy_versions;
pub(super) mod results;
mod retention;
mod rollout;
mod run_cursor;
mod run_list;
mod run_list_merge;
mod run_members;
mod run_note;
mod run_points;
mod run_settings;
mod run_tags;
mod run_update;
mod runs;
mod sampler;
mod scenarios;
mod series;
mod server_health;
pub(super) mod sessions;
mod strategies;
mod suites;
mod tasks;
pub(super) mod time_window;
mod trainer_metrics;
mod trainers;
mod trajectories;
mod workers;

use axum::Extension;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use crate::http::extract::BodyClass;
use crate::http::state::AppState;

pub(super) fn routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(runs::create_run, run_list::list_runs))
        .routes(routes!(runs::get_run, run_update::update_run, runs::delete_run))
        .routes(routes!(run_list::list_run_groups))
        .routes(routes!(run_tags::set_tags))
        .routes(routes!(run_note::set_note))
        .routes(routes!(run_members::set_members))
        .routes(routes!(runs::pause_run))
        .routes(routes!(runs::archive_run))
        .routes(routes!(runs::resume_run))
        .routes(routes!(runs::set_policy_version))
        .routes(routes!(retention::set_retention))
        .routes(routes!(policy_versions::list_policy_versions))
        .routes(routes!(policy_versions::describe_policy_version))
        .routes(routes!(leases::create::create_lease, leases::list::list_leases))
        .routes(routes!(leases::get::get_lease))
        .routes(routes!(leases::begin::begin_groups))
        .routes(routes!(leases::renew::renew_lease))
        .routes(routes!(leases::release::release_lease))
        .merge(bulk_routes())
        .routes(routes!(columns::get_claimed_columns))
        .routes(routes!(events::stream_events))
        .merge(progress_routes())
        .routes(routes!(run_settings::list_run_settings))
        .routes(routes!(episode_list::list_episodes))
        .routes(routes!(episode_search::search_episodes))
        .routes(routes!(episodes::get_episode))
        .routes(routes!(episodes::replay_episode))
        .routes(routes!(episode_critique::get_episode_critique))
        .routes(routes!(failures::get_failure_profiles))
        .routes(routes!(failure_list::list_failures))
        .routes(routes!(designs::list::list_designs, designs::create_request::create_design_request))
        .routes(routes!(designs::requests::list_design_requests))
        .routes(routes!(designs::requests::get_design_request))
        .routes(routes!(designs::statistics::get_design_statistics))
        .routes(routes!(designs::get::get_design))
        .routes(routes!(designs::retire::retire_design))
        .routes(routes!(designs::retire::revive_design))
        .routes(routes!(layouts::list_layouts))
        .routes(routes!(layouts::get_layout))
        .routes(routes!(scenarios::check_scenario))
        .routes(routes!(rollout::roll_out_scenario))
        .merge(session_routes())
        .routes(routes!(policy::get_policy, policy::set_policy))
        .routes(routes!(trajectories::read::read_trajectories))
        .routes(routes!(trajectories::claim::claim_trajectories))
        .routes(routes!(trajectories::acknowledge::acknowledge_trajectories))
        .routes(routes!(tasks::list_tasks))
        .routes(routes!(strategies::list_strategies))
        .routes(routes!(evaluations::list::list_evaluations, evaluations::create::create_evaluation))
        .routes(routes!(evaluations::compare::compare_evaluations))
        .routes(routes!(evaluations::get::get_evaluation))
        .routes(routes!(evaluations::cancel::cancel_evaluation))
        .routes(routes!(evaluations::scenarios::list_evaluation_scenarios))
        .routes(routes!(suites::list_suites))
        .routes(routes!(archive_runs::archive_many_runs))
        .routes(routes!(alerts::list_alerts))
        .routes(routes!(server_health::get_server_health))
        .routes(routes!(audit_log::list_audit_log))
        .routes(routes!(workers::list_workers))
}

/// Routes of sessions, which are WebSockets.
fn session_routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(sessions::connect_session))
        .routes(routes!(sessions::connect_run_session))
}

/// Routes of the progress of a run: mastery, samplers, series and metrics.
fn progress_routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(mastery::get_mastery))
        .routes(routes!(mastery::list_level_moves))
        .routes(routes!(mastery::get_params))
        .routes(routes!(series::get_series))
        .routes(routes!(sampler::get_sampler))
        .routes(routes!(trainer_metrics::get_trainer_metrics, trainer_metrics::log_trainer_metrics))
        .routes(routes!(trainers::list_trainers))
        .routes(routes!(overview::get_overview))
}

/// Routes whose bodies have the results of many episodes.
fn bulk_routes() -> OpenApiRouter<AppState> {
    OpenApiRouter::new()
        .routes(routes!(results::report_results))
        .routes(routes!(columns::claim_columns, columns::get_column_claim))
        .layer(Extension(BodyClass::Bulk))
}
