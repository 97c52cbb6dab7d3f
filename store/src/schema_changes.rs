//! Tests of schema changes: a database with an older schema is copied and changed, one with a newer schema is rejected.

use std::path::{Path, PathBuf};

use sqlx::migrate::Migrator;
use sqlx::{Connection, SqliteConnection};

use super::name_set::NameSet;
use super::open::{open_current_readers_with, open_writer_with};
use super::principals::PrincipalId;
use super::run_filter::RunFilter;
use super::run_list::{self, RunOrder, RunSortKey};
use super::runs;
use super::{OpenError, leases, open_current_readers, open_writer, run_deletion, tokens};

/// Schema version of the synthetic migration.
const FUTURE_SCHEMA: i64 = 9000;
/// Statement that inserts a run.
const RUN: &str = "INSERT INTO runs (id, name, seed, status, settings, created_at)
                   VALUES ('run', 'first', 1, 'active', '{}', 0)";

/// Creates the migrations of a future version: those of this version, and a synthetic one.
async fn future_migrations(folder: &Path) -> Migrator {
    let migrations = folder.join("migrations");
    std::fs::create_dir(&migrations).expect("a folder");
    for file in std::fs::read_dir("../migrations").expect("a folder").map(|file| file.expect("a file")) {
        std::fs::copy(file.path(), migrations.join(file.file_name())).expect("a copy");
    }
    let statements =
        "ALTER TABLE runs ADD COLUMN remark TEXT; UPDATE runs SET remark = name || ' (changed)';";
    std::fs::write(migrations.join(format!("{FUTURE_SCHEMA}_synthetic.sql")), statements).expect("a file");
    Migrator::new(migrations).await.expect("migrations")
}

/// Creates a database of this version with one run. Returns its path and its schema version.
async fn current_database(folder: &Path) -> (PathBuf, i64) {
    let path = folder.join("db");
    let mut conn = open_writer(&path).await.expect("a database");
    sqlx::query(RUN).execute(&mut conn).await.expect("a run");
    let schema = schema_of(&mut conn).await;
    conn.close().await.expect("the database closes");
    (path, schema)
}

async fn schema_of(conn: &mut SqliteConnection) -> i64 {
    sqlx::query_scalar("SELECT max(version) FROM _sqlx_migrations").fetch_one(conn).await.expect("a version")
}

fn copy_path(path: &Path, schema: i64, ending: &str) -> PathBuf {
    path.with_file_name(format!("db.schema-{schema}{ending}"))
}

#[tokio::test]
async fn older_database_is_copied_and_changed() {
    let folder = tempfile::tempdir().expect("a folder");
    let future = future_migrations(folder.path()).await;
    let (path, schema) = current_database(folder.path()).await;
    let (copy, unfinished) = (copy_path(&path, schema, ""), copy_path(&path, schema, ".unfinished"));
    // The rest of an interrupted attempt is overwritten.
    std::fs::write(&unfinished, "half").expect("a file");
    let mut conn = open_writer_with(&path, &future).await.expect("the schema is changed");
    assert_eq!(schema_of(&mut conn).await, FUTURE_SCHEMA);
    let remark = sqlx::query_scalar::<_, String>("SELECT remark FROM runs WHERE id = 'run'");
    assert_eq!(remark.fetch_one(&mut conn).await.expect("the run is kept"), "first (changed)");
    conn.close().await.expect("the database closes");
    assert!(!unfinished.exists());

    let mut copied = open_writer(&copy).await.expect("this version opens the copy");
    assert_eq!(schema_of(&mut copied).await, schema);
    let name = sqlx::query_scalar::<_, String>("SELECT name FROM runs WHERE id = 'run'");
    assert_eq!(name.fetch_one(&mut copied).await.expect("the run is copied"), "first");
    copied.close().await.expect("the copy closes");

    // A database with the newest schema is not copied.
    std::fs::remove_file(&copy).expect("the copy exists");
    let conn = open_writer_with(&path, &future).await.expect("the database is opened again");
    conn.close().await.expect("the database closes");
    assert!(!copy.exists());
}

#[tokio::test]
async fn runs_of_the_first_schema_are_kept() {
    let folder = tempfile::tempdir().expect("a folder");
    let first = folder.path().join("first");
    std::fs::create_dir(&first).expect("a folder");
    std::fs::copy("../migrations/0001_initial.sql", first.join("0001_initial.sql")).expect("a copy");
    let first = Migrator::new(first).await.expect("a migration");
    let path = folder.path().join("db");
    let mut conn = open_writer_with(&path, &first).await.expect("a database");
    sqlx::query(RUN).execute(&mut conn).await.expect("a run");
    conn.close().await.expect("the database closes");

    let mut conn = open_writer(&path).await.expect("the schema is changed");
    assert!(copy_path(&path, 1, "").exists());
    let run = runs::get(&mut conn, "run").await.expect("a query").expect("the run");
    assert_eq!((run.name.as_str(), run.tags), ("first", NameSet::default()));
    let order = RunOrder { key: RunSortKey::Created, is_descending: false };
    let listed = run_list::page(&mut conn, &RunFilter::default(), order, None, 10).await.expect("a query");
    assert_eq!(listed.runs.len(), 1);
    run_deletion::mark(&mut conn, "run", 1).await.expect("a change");
    while run_deletion::delete_rows(&mut conn, "run").await.expect("a change") {}
    assert_eq!(run_deletion::oldest_pending(&mut conn).await.expect("a query"), None);
}

/// Tokens owned runs and leases before there were principals.
#[tokio::test]
async fn owners_of_the_first_schema_become_principals() {
    let folder = tempfile::tempdir().expect("a folder");
    let first = folder.path().join("first");
    std::fs::create_dir(&first).expect("a folder");
    std::fs::copy("../migrations/0001_initial.sql", first.join("0001_initial.sql")).expect("a copy");
    let first = Migrator::new(first).await.expect("a migration");
    let path = folder.path().join("db");
    let mut conn = open_writer_with(&path, &first).await.expect("a database");
    for statement in [
        "INSERT INTO tokens (name, role, hash, created_at) VALUES
             ('a', 'admin', x'', 0), ('b', 'trainer', x'', 0), ('a', 'trainer', x'', 0)",
        "INSERT INTO runs (id, name, seed, status, settings, created_at, owner) VALUES
             ('owned', '', 1, 'active', '{}', 0, 3), ('open', '', 1, 'active', '{}', 1, NULL)",
        "INSERT INTO leases (id, id_suffix, run, purpose, status, groups, group_size, policy_version, ttl_ms, created_at,
                             expires_at, owner)
         SELECT value, 'x', 'owned', 'train', 'active', 1, 1, 0, 1, 0, 0, iif(value = 1, 2, NULL) FROM json_each('[1, 2, 3]')",
        "INSERT INTO rollout_leases (lease) VALUES (3)",
    ] {
        sqlx::query(statement).execute(&mut conn).await.expect("rows");
    }
    conn.close().await.expect("the database closes");

    let mut conn = open_writer(&path).await.expect("the schema is changed");
    let tokens = tokens::all(&mut conn).await.expect("a query");
    let names: Vec<&str> = tokens.iter().map(|token| token.principal_name.as_str()).collect();
    assert_eq!(names, ["a", "b", "a"]);
    assert_eq!(tokens[0].principal, tokens[2].principal, "tokens with one name have one principal");
    let owner = async |conn: &mut SqliteConnection, run| {
        runs::get(conn, run).await.expect("a query").expect("the run").owner
    };
    assert_eq!(owner(&mut conn, "owned").await.as_deref(), Some("a"));
    assert_eq!(owner(&mut conn, "open").await, None);
    let rows = leases::page(&mut conn, "owned", 0, 10).await.expect("a query");
    let owners: Vec<_> = rows.iter().map(|lease| lease.owner).collect();
    assert_eq!(owners, [Some(tokens[1].principal), None, Some(PrincipalId::SERVER)]);
}

#[tokio::test]
async fn database_is_unchanged_if_its_copy_fails() {
    let folder = tempfile::tempdir().expect("a folder");
    let future = future_migrations(folder.path()).await;
    let (path, schema) = current_database(folder.path()).await;
    let before = std::fs::read(&path).expect("a file");
    // A folder with the name of the copy makes the copy fail.
    std::fs::create_dir_all(copy_path(&path, schema, "").join("full")).expect("a folder");
    let error = open_writer_with(&path, &future).await.expect_err("an error");
    assert!(matches!(&error, OpenError::NoCopy { schema: found, .. } if *found == schema), "{error:?}");
    let message = format!("has an older schema ({schema}) and was not migrated");
    assert!(error.to_string().contains(&message), "{error}");
    assert_eq!(std::fs::read(&path).expect("a file"), before);
    assert!(!copy_path(&path, schema, ".unfinished").exists());
}

#[tokio::test]
async fn readers_reject_an_older_schema() {
    let folder = tempfile::tempdir().expect("a folder");
    let future = future_migrations(folder.path()).await;
    let (path, schema) = current_database(folder.path()).await;
    let error = open_current_readers_with(&path, &future).await.expect_err("an error");
    let message = format!("was written by an older Sparring (schema {schema}, this one has {FUTURE_SCHEMA})");
    assert!(error.to_string().contains(&message), "{error}");
}

#[tokio::test]
async fn newer_schema_is_rejected() {
    let folder = tempfile::tempdir().expect("a folder");
    let future = future_migrations(folder.path()).await;
    let (path, schema) = current_database(folder.path()).await;
    open_writer_with(&path, &future).await.expect("the schema is changed").close().await.expect("it closes");
    let message =
        format!("was written by a newer Sparring (schema {FUTURE_SCHEMA}, this one knows {schema})");
    for error in [
        open_writer(&path).await.expect_err("an error"),
        open_current_readers(&path).await.expect_err("an error"),
    ] {
        assert!(error.to_string().contains(&message), "{error}");
    }
}

/// Lists of runs read the totals, the strategy and the tasks from columns that earlier schemas do not have.
#[tokio::test]
async fn runs_of_an_earlier_schema_are_listed_with_their_totals() {
    let folder = tempfile::tempdir().expect("a folder");
    let earlier = folder.path().join("earlier");
    std::fs::create_dir(&earlier).expect("a folder");
    for file in std::fs::read_dir("../migrations").expect("a folder").map(|file| file.expect("a file")) {
        if file.file_name().to_string_lossy().as_ref() < "0016" {
            std::fs::copy(file.path(), earlier.join(file.file_name())).expect("a copy");
        }
    }
    let path = folder.path().join("db");
    let earlier = Migrator::new(earlier).await.expect("migrations");
    let mut conn = open_writer_with(&path, &earlier).await.expect("a database");
    let rows = r#"
        INSERT INTO runs (id, name, seed, status, settings, created_at) VALUES
            ('run', 'run', 1, 'active', '{"curriculum": {"strategy": "plr", "tasks": [{"task": "b/b"}, {"task": "a/a"}]}}', 0);
        INSERT INTO task_counters (run, task, level, is_designed, episodes, successes, failed, expired, score_sum, episodes_with_skill,
                                   skill_sum) VALUES ('run', 'a/a', 0, 0, 8, 0, 0, 0, 0, 4, 1.0);
        INSERT INTO task_history (run, task, width, start, episodes, successes, score_sum, episodes_with_skill, skill_sum, failed, expired,
                                  contested_groups, success_rate_sum, panel_groups, panel_success_rate_sum, groups, zero_variance_groups,
                                  claimed_episodes) VALUES ('run', 'a/a', 60000, 120000, 8, 0, 0, 4, 1.0, 0, 0, 0, 0, 0, 0, 0, 0, 0);
        INSERT INTO task_curves (run, task, ordinal, width, first_episode, episodes, first_step, first_at, last_at, results)
            VALUES ('run', 'a/a', 0, 4, 0, 8, 0, 120001, 120009, '{}');"#;
    sqlx::raw_sql(rows).execute(&mut conn).await.expect("rows");
    conn.close().await.expect("the database closes");

    let mut conn = open_writer(&path).await.expect("the schema is changed");
    let filter = RunFilter {
        strategy: Some("plr".to_owned()),
        tasks: Some("a/a,b/b".to_owned()),
        ..RunFilter::default()
    };
    let order = RunOrder { key: RunSortKey::Skill, is_descending: true };
    let listed = run_list::page(&mut conn, &filter, order, None, 10).await.expect("a query").runs;
    let run = listed.first().expect("the run");
    assert_eq!((run.episodes, run.skill, run.note.as_str()), (8, Some(0.25), ""));
    assert_eq!((run.first_results_at, run.last_results_at), (Some(120_001), Some(120_009)));
}
