//! Who publishes a feed: the server of a shard, one of two servers with copies of a database, and a stream that takes no more groups.

use std::path::Path;

use system_tests::{ServerProcess, wait_until};

use super::*;

/// Settings of a policy whose groups NATS delivers.
fn delivered(max_groups: u32) -> Value {
    json!({"policy": "random", "max_unacknowledged_groups": max_groups, "delivery": "nats"})
}

/// Starts a server of a database with a NATS server.
fn start(db: &Path, nats: &NatsServer, options: &[&str]) -> ServerProcess {
    ServerProcess::start_with_options(db, &[&["--nats", &nats.url()][..], options].concat())
}

/// Connects to a NATS server.
async fn context_of(nats: &NatsServer) -> Context {
    jetstream::new(async_nats::connect(nats.url()).await.unwrap())
}

/// Name of the server that publishes a stream.
async fn owner_of(context: &Context, stream: &str) -> Option<String> {
    let stream = context.get_stream(stream).await.ok()?;
    stream.cached_info().config.metadata.get("sparring-server").cloned()
}

/// Name of the server that wrote the state of the run.
async fn server_of_state(context: &Context) -> Option<String> {
    let states = context.get_key_value("SPARRING_default_RUNS").await.ok()?;
    let state: Value = serde_json::from_slice(&states.get("runs.run").await.ok()??).ok()?;
    state["server"].as_str().map(str::to_owned)
}

/// Message of the last error of the run's policy.
async fn last_error(server: &ServerProcess) -> String {
    policy(&server.api(), "run").await["last_error"]["message"].as_str().unwrap_or_default().to_owned()
}

#[tokio::test(flavor = "multi_thread")]
async fn run_of_a_shard_has_a_feed() {
    const SHARD_STREAM: &str = "SPARRING_default_FEED-east_my_run";
    let Some(nats) = NatsServer::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let server = start(&folder.path().join("east.sqlite3"), &nats, &["--shard", "east"]);
    let (api, context) = (server.api(), context_of(&nats).await);
    create_run(&api, "east.my_run", json!({})).await;
    let _ = put_policy(&api, "east.my_run", delivered(3)).await.expect(200);
    wait_until("the groups are published", async || messages_of(&context, SHARD_STREAM).await == Some(3))
        .await;
    let config = pull::Config { durable_name: Some("trainer".to_owned()), ..pull::Config::default() };
    let consumer = context.create_consumer_on_stream(config, SHARD_STREAM).await.unwrap();
    acknowledge(&receive(&consumer, 3).await).await;
    wait_until("the groups are acknowledged", async || {
        policy(&api, "east.my_run").await["feed"]["acknowledged"] == 3
    })
    .await;
    let _ = put_policy(&api, "east.my_run", json!({"policy": "off"})).await.expect(200);
    wait_until("the stream is deleted", async || messages_of(&context, SHARD_STREAM).await.is_none()).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn copy_of_a_database_does_not_publish_beside_it() {
    let Some(nats) = NatsServer::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (original, copy) = (folder.path().join("original.sqlite3"), folder.path().join("copy.sqlite3"));
    let first = start(&original, &nats, &[]);
    let context = context_of(&nats).await;
    create_run(&first.api(), "run", json!({})).await;
    let _ = put_policy(&first.api(), "run", delivered(4)).await.expect(200);
    wait_until("the groups are published", async || messages_of(&context, STREAM).await == Some(4)).await;
    assert_eq!(first.terminate(), Some(0));
    let _ = std::fs::copy(&original, &copy).unwrap();

    let first = start(&original, &nats, &[]);
    let owner = owner_of(&context, STREAM).await.unwrap();
    let second = start(&copy, &nats, &[]);
    wait_until("the copy says that it does not publish", async || {
        last_error(&second).await.contains(&format!("the server {owner} publishes the run from a copy"))
    })
    .await;
    assert_eq!(last_error(&first).await, "");
    assert_eq!(owner_of(&context, STREAM).await.as_ref(), Some(&owner));

    assert_eq!(server_of_state(&context).await.as_ref(), Some(&owner));

    // Without the first server, the copy is the database that moved to another place.
    first.kill();
    wait_until("the copy publishes, and says so", async || {
        let is_owner = owner_of(&context, STREAM).await.is_some_and(|server| server != owner);
        is_owner && last_error(&second).await.is_empty()
    })
    .await;
    let _ = put_policy(&second.api(), "run", delivered(4)).await.expect(200);
    wait_until("the copy writes the state of the run", async || {
        server_of_state(&context).await.is_some_and(|server| server != owner)
    })
    .await;
    let first = start(&original, &nats, &[]);
    wait_until("the first server says why it does not publish", async || {
        last_error(&first).await.contains("from a copy of this database")
    })
    .await;
    assert_eq!(messages_of(&context, STREAM).await, Some(4));
}

#[tokio::test(flavor = "multi_thread")]
async fn policy_says_why_groups_are_not_published() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("nats.conf");
    std::fs::write(&config, "jetstream { max_file_store: 64K }").unwrap();
    let Some(nats) = NatsServer::start_with(Some(config), Vec::new()) else { return };
    let server = start(&folder.path().join("db.sqlite3"), &nats, &[]);
    create_run(&server.api(), "run", json!({"group_size": 8})).await;
    let _ = put_policy(&server.api(), "run", delivered(64)).await.expect(200);
    wait_until("the policy says that NATS has no place", async || {
        let error = last_error(&server).await;
        error.contains("the feed is not published: ") && error.contains("insufficient")
    })
    .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn policy_shows_an_outage_of_nats_until_it_ends() {
    let Some(mut nats) = NatsServer::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    let server = start(&folder.path().join("db.sqlite3"), &nats, &[]);
    let context = context_of(&nats).await;
    create_run(&server.api(), "run", json!({})).await;
    let _ = put_policy(&server.api(), "run", delivered(2)).await.expect(200);
    wait_until("the groups are published", async || messages_of(&context, STREAM).await == Some(2)).await;
    nats.kill();
    wait_until("the policy says that NATS is away", async || {
        last_error(&server).await.contains("the feed is not published: NATS cannot be reached")
    })
    .await;
    nats.resume();
    wait_until("the policy shows no error", async || last_error(&server).await.is_empty()).await;

    nats.kill();
    wait_until("the policy says so again", async || !last_error(&server).await.is_empty()).await;
    let _ =
        put_policy(&server.api(), "run", json!({"policy": "random", "delivery": "http"})).await.expect(200);
    assert_eq!(last_error(&server).await, "", "HTTP needs no NATS");
}

/// The key of the server may not create the stream of the run `a`. Denied requests have no answer.
#[tokio::test(flavor = "multi_thread")]
async fn feed_without_permissions_stops_no_other_feed() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("nats.conf");
    let denied = r#"["$JS.API.STREAM.CREATE.SPARRING_default_FEED_a", "$JS.API.STREAM.UPDATE.SPARRING_default_FEED_a"]"#;
    let user = format!("{{ user: u, password: p, permissions: {{ publish: {{ deny: {denied} }} }} }}");
    std::fs::write(&config, format!("authorization {{ users: [{user}] }}")).unwrap();
    let Some(nats) = NatsServer::start_with(Some(config), Vec::new()) else { return };
    let url = nats.url().replace("//", "//u:p@");
    let server = ServerProcess::start_with_options(&folder.path().join("db.sqlite3"), &["--nats", &url]);
    let api = server.api();
    for run in ["a", "run"] {
        create_run(&api, run, json!({})).await;
        let _ = put_policy(&api, run, delivered(2)).await.expect(200);
    }
    let user = async_nats::ConnectOptions::with_user_and_password("u".to_owned(), "p".to_owned());
    let context = jetstream::new(user.connect(nats.url()).await.unwrap());
    wait_until("the other feed is published", async || messages_of(&context, STREAM).await == Some(2)).await;
    wait_until("the policy says what NATS denies", async || {
        let error = policy(&api, "a").await["last_error"]["message"].to_string();
        error.contains("NATS does not permit this user") && error.contains("FEED_a")
    })
    .await;
    assert_eq!(last_error(&server).await, "");
}
