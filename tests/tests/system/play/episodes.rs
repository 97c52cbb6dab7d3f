//! `sparring play` against both kinds of OpenEnv servers: episodes, output lines, transcripts and model requests. Faults of
//! endpoints and servers are in `faults.rs`.

use serde_json::{Value, json};
use system_tests::{PolicyRollout, run_policy};

use super::openenv_server::{DEFAULT_SEED, ServerOptions, TaskChoice, serve, standard_scenario};
use super::{endpoint_args, play};
use system_tests::mock_llm::{HOLD_ACTION, chat_response, received_bodies, start_endpoint};

const TASKS: [(&str, &str); 3] = [
    ("survival", "kessler/survival"),
    ("eco_station", "kessler/eco_station"),
    ("rendezvous", "kessler/rendezvous"),
];

#[tokio::test]
async fn tasks_run_in_order_on_both_kinds_of_servers() {
    for (task_choice, seed) in [(TaskChoice::OnRequest, 7), (TaskChoice::Cycle, DEFAULT_SEED)] {
        let options = ServerOptions::new(task_choice);
        let output = play(&serve(&options).await, "--policy heuristic --seed 7").await;
        assert_eq!(output.code, Some(0), "{output:?}");
        assert_eq!(options.episode_tasks(), TASKS.map(|(_, id)| id));
        let starts = TASKS.map(|(name, _)| format!("[START] task={name} env=kessler-env model=heuristic"));
        assert_eq!(output.lines("[START]"), starts);
        // The server's rewards equal those of the same episode in this process, to the bit.
        for ((_, id), end) in TASKS.iter().zip(output.records("end")) {
            let scenario = standard_scenario(id, seed);
            let PolicyRollout { outcome, log } = run_policy(&scenario, "heuristic");
            let mut episode = scenario.task().start(&scenario).unwrap();
            let mut report = env_core::task::StepReport::default();
            let rewards: Vec<Value> = log
                .steps()
                .map(|action| episode.step(action, &mut report).map(|()| json!(report.reward)).unwrap())
                .collect();
            assert_eq!(end["rewards"], json!(rewards), "{id}");
            assert!((end["score"].as_f64().unwrap() - outcome.score).abs() < 1e-12, "{end}"); // sums in another order
        }
        assert!(output.stderr.contains("3 of 3 episodes were run to their end."), "{}", output.stderr);
    }
}

/// Runs every task on a Sparring server.
#[tokio::test]
async fn all_tasks_run_on_sparrings_server() {
    let server = system_tests::Server::start().await;
    let tasks: Vec<&str> = env_core::tasks().map(env_core::TaskSpec::id).collect();
    let line = tasks.iter().map(|task| format!(" --task {task}")).collect::<String>();
    let output =
        play(server.api().base(), &format!("--policy heuristic --seed 7 --concurrency 3{line}")).await;
    assert_eq!(output.code, Some(0), "{}", output.stderr);
    let ends = output.records("end");
    assert_eq!(ends.len(), tasks.len());
    for end in ends {
        let start =
            output.records("start").into_iter().find(|start| start["episode"] == end["episode"]).unwrap();
        let scenario = standard_scenario(start["task"].as_str().unwrap(), 7);
        let PolicyRollout { outcome, log } = run_policy(&scenario, "heuristic");
        assert_eq!(end["steps"], log.len(), "{start}");
        assert!((end["score"].as_f64().unwrap() - outcome.score).abs() < 1e-9, "{start} {end} {outcome:?}"); // sums in another order
    }
}

#[tokio::test]
async fn missing_task_is_one_error_sentence() {
    let other = serve(&ServerOptions::new(TaskChoice::Cycle)).await;
    let output = play(&other, "--policy hold --task formation").await;
    assert_eq!((output.code, output.stdout.as_str()), (Some(2), ""), "{output:?}");
    assert_eq!(
        output.stderr,
        "sparring: the environment does not offer kessler/formation: in 4 resets its goals were SURVIVAL, ECO-STATION, \
         RENDEZVOUS, SURVIVAL\n"
    );
}

#[tokio::test]
async fn docking_tasks_use_their_own_actions() {
    let server = serve(&ServerOptions::new(TaskChoice::OnRequest)).await;
    let output = play(&server, "--policy heuristic --task docking/single --seed 3").await;
    assert_eq!(output.code, Some(0), "{}", output.stderr);
    let outcome = run_policy(&standard_scenario("docking/single", 3), "heuristic").outcome;
    let end = output.records("end")[0];
    assert!((end["score"].as_f64().unwrap() - outcome.score).abs() < 1e-9 && outcome.score > 0.5, "{end}");
    assert!(output.lines("[STEP]")[0].contains(r#"action={"thrusts":[{"deputy_id":0,"thrust_x":"#));

    let push = r#"{"thrusts": [{"deputy_id": 0, "thrust_x": 1, "thrust_y": 0, "thrust_z": 0}]}"#;
    let model = start_endpoint([chat_response(push)]).await;
    let output =
        play(&server, &format!("{} --task docking/single --seed 3", endpoint_args(&model.uri()))).await;
    assert_eq!(output.code, Some(0), "{}", output.stderr);
    let schema = &received_bodies(&model).await[0]["response_format"]["json_schema"];
    assert_eq!(
        (&schema["name"], &schema["schema"]["properties"]["thrusts"]["type"]),
        (&json!("action"), &json!("array"))
    );
    assert!(schema["schema"]["properties"].get("metadata").is_none(), "{schema}");
}

/// The output lines equal those of the public kessler-env, character by character.
#[tokio::test]
async fn output_lines_match_kessler_env() {
    let server = serve(&ServerOptions::new(TaskChoice::Cycle)).await;
    let burn = r#"{"burns": [{"satellite_id": 1, "delta_vx": 0.25, "delta_vy": -0.1}]}"#;
    let model = start_endpoint([
        chat_response(burn),
        chat_response("no"),
        chat_response("no"),
        chat_response(HOLD_ACTION),
    ])
    .await;
    let output = play(&server, &format!("{} --task eco_station", endpoint_args(&model.uri()))).await;
    assert_eq!(output.code, Some(0), "{}", output.stderr);
    insta::assert_snapshot!(output.stdout);
    // With `--json` the transcript of the same episode is the only output on stdout.
    let model = start_endpoint([
        chat_response(burn),
        chat_response("no"),
        chat_response("no"),
        chat_response(HOLD_ACTION),
    ])
    .await;
    let jsonl_output =
        play(&server, &format!("{} --task eco_station --json", endpoint_args(&model.uri()))).await;
    let printed: Vec<Value> =
        jsonl_output.stdout.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(printed, jsonl_output.transcript);
    assert_eq!(jsonl_output.records("end"), output.records("end"));
}

#[tokio::test]
async fn invalid_action_is_repaired_once_then_replaced_by_hold() {
    let server = serve(&ServerOptions::new(TaskChoice::OnRequest)).await;
    let burn = r#"{"burns": [{"satellite_id": 0, "delta_vx": 0.1, "delta_vy": 0}]}"#;
    let invalid = r#"{"burns": [{"satellite_id": 7, "delta_vx": 0.1, "delta_vy": 0}]}"#;
    let model = start_endpoint([
        chat_response(invalid),
        chat_response(&format!("Sorry: {burn}")),
        chat_response("Let me think."),
        chat_response(invalid),
        chat_response(HOLD_ACTION),
    ])
    .await;
    let line = format!(
        "{} --task survival --seed 1 --history 1 --temperature 0.5 --max-tokens 77",
        endpoint_args(&model.uri())
    );
    let output = play(&server, &line).await;
    assert_eq!(output.code, Some(0), "{}", output.stderr);
    let steps = output.records("step");
    assert_eq!(steps[0]["action"], json!({"burns": [{"satellite_id": 0, "delta_vx": 0.1, "delta_vy": 0.0}]}));
    assert_eq!((&steps[0]["error"], &steps[0]["model"]["invalid"]), (&Value::Null, &json!(1)));
    assert_eq!((&steps[1]["action"], &steps[1]["model"]["invalid"]), (&json!({"burns": []}), &json!(2)));
    let error = "the reply is not an action: burns.0.satellite_id: must be from 0 to 2, got 7";
    assert_eq!(steps[1]["error"], error);
    assert!(output.lines("[STEP] step=2 ")[0].ends_with(&format!("error={error}")), "{}", output.stdout);

    let requests = received_bodies(&model).await;
    assert_eq!(requests.len(), 2 + 2 + (steps.len() - 2), "one repair for each invalid action");
    assert_eq!((&requests[0]["temperature"], &requests[0]["max_tokens"]), (&json!(0.5), &json!(77)));
    let last = |index: usize| {
        requests[index]["messages"].as_array().unwrap().last().unwrap()["content"].as_str().unwrap()
    };
    assert!(
        last(1).starts_with(
            "Your answer is not a valid action: burns.0.satellite_id: must be from 0 to 2, got 7."
        ),
        "{}",
        last(1)
    );
    // The history has one exchange, with the action that was taken instead of the invalid one.
    let messages = requests[2]["messages"].as_array().unwrap();
    let roles: Vec<&str> = messages.iter().map(|message| message["role"].as_str().unwrap()).collect();
    assert_eq!(roles, ["system", "user", "assistant", "user"]);
    assert_eq!(messages[2]["content"], r#"{"burns":[{"satellite_id":0,"delta_vx":0.1,"delta_vy":0.0}]}"#);
    assert_eq!(
        requests.last().unwrap()["messages"].as_array().unwrap().len(),
        4,
        "the history does not grow"
    );
    // The transcript has requests and responses exactly as they were sent.
    let completion = &steps[1]["model"]["completions"][1];
    assert_eq!((&completion["messages"], &completion["text"]), (&requests[3]["messages"], &json!(invalid)));
    assert_eq!((&completion["tokens_in"], &completion["tokens_out"]), (&json!(900), &json!(20)));
    let tokens = format!(
        "Model: {} calls, {} tokens in, {} out",
        requests.len(),
        900 * requests.len(),
        20 * requests.len()
    );
    assert!(
        output.stderr.contains(&tokens) && output.stderr.contains("3 answers were invalid, 1 steps"),
        "{}",
        output.stderr
    );
}

#[tokio::test]
async fn action_rejected_by_the_server_becomes_hold() {
    let options = ServerOptions { rejects_burns: true, ..ServerOptions::new(TaskChoice::OnRequest) };
    let output = play(&serve(&options).await, "--policy blind --task survival").await;
    assert_eq!(output.code, Some(0), "{}", output.stderr);
    let steps = output.lines("[STEP]");
    assert!(
        steps[0].starts_with(
            r#"[STEP] step=1 action={"burns":[]} reward=0.02 done=false error=the environment rejected the request: "#
        ) && steps[0].ends_with("burns.0.mood: Field required (VALIDATION_ERROR)"),
        "{}",
        steps[0]
    );
    assert!(steps[1].ends_with("error=null"));
}

#[tokio::test]
async fn lines_of_concurrent_episodes_do_not_interleave() {
    let options = ServerOptions { full_connections: 2, ..ServerOptions::new(TaskChoice::OnRequest) };
    let line = "--policy heuristic --task survival --task formation --episodes 6 --concurrency 4 --seed 1";
    let output = play(&serve(&options).await, line).await;
    assert_eq!(output.code, Some(0), "a full server is retried: {}", output.stderr);
    let mut open = false;
    for line in output.stdout.lines() {
        assert_eq!(line.starts_with("[START]"), !open, "{line}");
        open = !line.starts_with("[END]");
    }
    assert_eq!((output.lines("[END]").len(), open), (12, false));
    let mut seeds: Vec<_> = output
        .records("start")
        .iter()
        .map(|start| (start["task"].as_str(), start["seed"].as_u64()))
        .collect();
    seeds.sort_unstable();
    let wanted = ["formation", "survival"]
        .into_iter()
        .flat_map(|task| (1..=6).map(move |seed| (Some(task), Some(seed))));
    assert_eq!(seeds, wanted.collect::<Vec<_>>());
    assert!(output.stderr.contains("Mean score (number of episodes): survival 0."), "{}", output.stderr);
    assert!(output.stderr.contains(" (6), formation 0."), "{}", output.stderr);
}

/// The environment variables of the public kessler-env replace the options.
#[tokio::test]
async fn environment_variables_match_kessler_env() {
    let server = serve(&ServerOptions::new(TaskChoice::Cycle)).await;
    let model = start_endpoint([chat_response(HOLD_ACTION)]).await;
    let mut command = std::process::Command::new(system_tests::sparring_binary());
    command
        .env("ENV_URL", &server)
        .env("API_BASE_URL", format!("{}/v1", model.uri()))
        .env("MODEL_NAME", "by-variable");
    command.env_remove("HF_TOKEN").env("API_KEY", system_tests::mock_llm::API_KEY).arg("play");
    let output = tokio::task::spawn_blocking(move || command.output().unwrap()).await.unwrap();
    let stdout = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let starts: Vec<&str> = stdout.lines().filter(|line| line.starts_with("[START]")).collect();
    assert_eq!(
        starts,
        TASKS.map(|(name, _)| format!("[START] task={name} env=kessler-env model=by-variable"))
    );
    let requests = received_bodies(&model).await;
    assert!(
        requests
            .iter()
            .all(|request| request["model"] == "by-variable" && request.get("temperature").is_none())
    );
}
