//! Request and response types of the HTTP API `/v1`, one file for each resource.
//!
//! The server, the command line, the benchmarks and the tests share these types, so that the two ends of a request cannot
//! disagree. Their doc comments are the descriptions of the OpenAPI document. Every type implements both `Serialize` and
//! `Deserialize`. A response may gain fields: clients ignore fields that they do not know. A request with an unknown field is
//! rejected.
//!
//! Conversions from database rows, validation and error responses are not here: the `orchestrator` crate has them. Start
//! reading at [`RunSummary`] and [`Lease`].

mod alerts;
mod audit_log;
mod columns;
mod critiques;
mod design_statistics;
mod designs;
mod episodes;
mod evaluation_results;
mod evaluations;
mod events;
mod failures;
mod integers;
mod layouts;
mod leases;
mod mastery;
mod overview;
mod pages;
mod policy;
mod problem;
mod results;
mod retention;
mod run_list;
mod run_settings;
mod runs;
mod sampler;
mod scenarios;
mod series;
mod server_health;
mod server_version;
mod shards;
mod strategies;
mod suites;
mod tasks;
mod trainer_metrics;
mod trainers;
mod trajectories;
mod versions;
mod workers;

pub use self::alerts::*;
pub use self::audit_log::*;
pub use self::columns::*;
pub use self::critiques::*;
pub use self::design_statistics::*;
pub use self::designs::*;
pub use self::episodes::*;
pub use self::evaluation_results::*;
pub use self::evaluations::*;
pub use self::events::*;
pub use self::failures::*;
pub use self::layouts::*;
pub use self::leases::*;
pub use self::mastery::*;
pub use self::overview::*;
pub use self::pages::*;
pub use self::policy::*;
pub use self::problem::*;
pub use self::results::*;
pub use self::retention::*;
pub use self::run_list::*;
pub use self::run_settings::*;
pub use self::runs::*;
pub use self::sampler::*;
pub use self::scenarios::*;
pub use self::series::*;
pub use self::server_health::*;
pub use self::server_version::*;
pub use self::shards::*;
pub use self::strategies::*;
pub use self::suites::*;
pub use self::tasks::*;
pub use self::trainer_metrics::*;
pub use self::trainers::*;
pub use self::trajectories::*;
pub use self::versions::*;
pub use self::workers::*;

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn response_may_gain_fields_and_request_may_not() {
        let receipt = json!({"episode": "ep_1-abcdef_0", "status": "late", "new": 1});
        let receipt: ResultReceipt = serde_json::from_value(receipt).expect("an unknown field is ignored");
        assert_eq!(receipt.status, ReceiptStatus::Late);
        let request = serde_json::from_value::<LeaseRequest>(json!({"groups": 1, "new": 1}));
        assert!(request.is_err(), "{request:?}");
    }

    #[test]
    fn words_of_enums_are_their_json() {
        for status in ReceiptStatus::ALL {
            assert_eq!(json!(status), status.as_str());
        }
        for code in RefusalCode::ALL {
            assert_eq!(json!(code), code.as_str());
        }
        for section in [SuiteSection::Contested, SuiteSection::AsTheyCome, SuiteSection::All] {
            assert_eq!(json!(section), section.as_str());
        }
    }

    #[test]
    fn request_of_defaults_creates_a_run_of_defaults() {
        let sent = serde_json::to_value(RunRequest::default()).expect("a request has a JSON form");
        let read: RunRequest = serde_json::from_value(sent).expect("null is the same as a missing field");
        assert!(
            read.id.is_none() && read.strategy.is_none() && read.retention == RetentionRequest::default()
        );
    }
}
