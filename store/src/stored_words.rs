//! Tests of the enums that are stored as words: the schema knows the same words, and other words are reported as damage.

use super::StoreError;
use super::columns::ClaimState;
use super::design_requests::{DesignerKind, RequestOrigin, RequestState};
use super::episodes::EpisodeState;
use super::evaluations::EvaluationState;
use super::groups::GroupState;
use super::layouts::{LayoutKind, LayoutState, RetirementReason};
use super::leases::{LeaseForm, LeaseStatus, Purpose};
use super::runs::RunStatus;
use crate::role::Role;

/// Columns that the schema checks, with the words of their enums.
const CHECKED: [(&str, &str, &[&str]); 15] = [
    ("runs", "status", RunStatus::WORDS),
    ("leases", "purpose", Purpose::WORDS),
    ("leases", "form", LeaseForm::WORDS),
    ("leases", "status", LeaseStatus::WORDS),
    ("groups", "state", GroupState::WORDS),
    ("episodes", "state", EpisodeState::WORDS),
    ("column_claims", "state", ClaimState::WORDS),
    ("design_requests", "designer", DesignerKind::WORDS),
    ("design_requests", "requested_by", RequestOrigin::WORDS),
    ("design_requests", "state", RequestState::WORDS),
    ("layouts", "state", LayoutState::WORDS),
    ("layouts", "retirement_reason", RetirementReason::WORDS),
    ("layouts", "kind", LayoutKind::WORDS),
    ("evaluations", "state", EvaluationState::WORDS),
    ("tokens", "role", Role::WORDS),
];

#[tokio::test]
async fn the_schema_checks_the_same_words() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut conn = super::open_writer(&folder.path().join("db")).await.expect("a database");
    for (table, column, words) in CHECKED {
        let schema: String =
            sqlx::query_scalar("SELECT sql FROM sqlite_schema WHERE type = 'table' AND name = ?")
                .bind(table)
                .fetch_one(&mut conn)
                .await
                .expect("a table");
        let words: Vec<String> = words.iter().map(|word| format!("'{word}'")).collect();
        let check = format!("CHECK ({column} IN ({}))", words.join(", "));
        assert!(schema.contains(&check), "{table} has no {check}");
    }
}

#[tokio::test]
async fn an_unknown_word_is_reported_as_damage() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut conn = super::open_writer(&folder.path().join("db")).await.expect("a database");
    let read = sqlx::query_scalar::<_, LeaseStatus>("SELECT 'lost'").fetch_one(&mut conn).await;
    let error = StoreError::from(read.expect_err("an error"));
    let StoreError::Corrupt { item, reason } = &error else { panic!("{error:?}") };
    assert_eq!(*item, "a lease's status");
    assert!(reason.contains("\"lost\" is not one of active, done, released, expired"), "{reason}");
}
