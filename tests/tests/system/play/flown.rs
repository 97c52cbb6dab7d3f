//! `sparring play` against OpenEnv servers of both kinds, over real sockets: what is flown, what is told of it, and how a model
//! is asked. What endpoints can do wrong is in `faults.rs`.

use serde_json::{Value, json};
use system_tests::flown;

use super::env::{OWN_SEED, Takes, Ways, scenario, serve};
use super::{at, play};
use system_tests::model::{HOLD, endpoint, says, sent};

const THREE: [(&str, &str); 3] = [
    ("survival", "kessler/survival"),
    ("eco_station", "kessler/eco_station"),
    ("rendezvous", "kessler/rendezvous"),
];

#[tokio::test]
async fn three_tasks_are_three_tasks_on_both_kinds_of_servers() {
    for (takes, seed) in [(Takes::TaskAndSeed, 7), (Takes::InTurn, OWN_SEED)] {
        let ways = Ways::new(takes);
        let played = play(&serve(&ways).await, "--policy heuristic --seed 7").await;
        assert_eq!(played.code, Some(0), "{played:?}");
        assert_eq!(ways.flown(), THREE.map(|(_, id)| id));
        let starts = THREE.map(|(name, _)| format!("[START] task={name} env=kessler-env model=heuristic"));
        assert_eq!(played.lines("[START]"), starts);
        // What was flown on the server is what is flown here, to the bit of every reward.
        for ((_, id), end) in THREE.iter().zip(played.records("end")) {
            let scenario = scenario(id, seed);
            let (here, log) = flown(&scenario, "heuristic");
            let mut episode = scenario.task().start(&scenario).unwrap();
            let mut report = env_core::task::StepReport::default();
            let rewards: Vec<Value> = log
                .steps()
                .map(|action| episode.step(action, &mut report).map(|()| json!(report.reward)).unwrap())
                .collect();
            assert_eq!(end["rewards"], json!(rewards), "{id}");
            assert!((end["score"].as_f64().unwrap() - here.score).abs() < 1e-12, "{end}"); // sums in another order
        }
        assert!(played.stderr.contains("3 of 3 episodes were flown to their end."), "{}", played.stderr);
    }
}

/// The same on the server that this project is.
#[tokio::test]
async fn all_tasks_are_flown_on_sparrings_own_server() {
    let server = system_tests::Server::start().await;
    let tasks: Vec<&str> = env_core::tasks().map(env_core::TaskSpec::id).collect();
    let line = tasks.iter().map(|task| format!(" --task {task}")).collect::<String>();
    let played =
        play(server.api().base(), &format!("--policy heuristic --seed 7 --concurrency 3{line}")).await;
    assert_eq!(played.code, Some(0), "{}", played.stderr);
    let ends = played.records("end");
    assert_eq!(ends.len(), tasks.len());
    for end in ends {
        let start =
            played.records("start").into_iter().find(|start| start["episode"] == end["episode"]).unwrap();
        let (here, log) = flown(&scenario(start["task"].as_str().unwrap(), 7), "heuristic");
        assert_eq!(end["steps"], log.len(), "{start}");
        assert!((end["score"].as_f64().unwrap() - here.score).abs() < 1e-9, "{start} {end} {here:?}"); // sums in another order
    }
}

#[tokio::test]
async fn a_task_that_is_not_flown_is_refused_in_a_sentence() {
    let other = serve(&Ways::new(Takes::InTurn)).await;
    let played = play(&other, "--policy hold --task formation").await;
    assert_eq!((played.code, played.stdout.as_str()), (Some(2), ""), "{played:?}");
    assert_eq!(
        played.stderr,
        "sparring: the environment flies no kessler/formation: after 4 resets its goals were SURVIVAL, ECO-STATION, \
         RENDEZVOUS, SURVIVAL\n"
    );
}

#[tokio::test]
async fn another_world_is_flown_by_its_own_actions() {
    let env = serve(&Ways::new(Takes::TaskAndSeed)).await;
    let played = play(&env, "--policy heuristic --task docking/single --seed 3").await;
    assert_eq!(played.code, Some(0), "{}", played.stderr);
    let (here, _) = flown(&scenario("docking/single", 3), "heuristic");
    let end = played.records("end")[0];
    assert!((end["score"].as_f64().unwrap() - here.score).abs() < 1e-9 && here.score > 0.5, "{end}");
    assert!(played.lines("[STEP]")[0].contains(r#"action={"thrusts":[{"deputy_id":0,"thrust_x":"#));

    let push = r#"{"thrusts": [{"deputy_id": 0, "thrust_x": 1, "thrust_y": 0, "thrust_z": 0}]}"#;
    let model = endpoint([says(push)]).await;
    let played = play(&env, &format!("{} --task docking/single --seed 3", at(&model.uri()))).await;
    assert_eq!(played.code, Some(0), "{}", played.stderr);
    let schema = &sent(&model).await[0]["response_format"]["json_schema"];
    assert_eq!(
        (&schema["name"], &schema["schema"]["properties"]["thrusts"]["type"]),
        (&json!("action"), &json!("array"))
    );
    assert!(schema["schema"]["properties"].get("metadata").is_none(), "{schema}");
}

/// The public kessler-env's lines, to the letter.
#[tokio::test]
async fn the_lines_are_the_originals() {
    let env = serve(&Ways::new(Takes::InTurn)).await;
    let burn = r#"{"burns": [{"satellite_id": 1, "delta_vx": 0.25, "delta_vy": -0.1}]}"#;
    let model = endpoint([says(burn), says("no"), says("no"), says(HOLD)]).await;
    let played = play(&env, &format!("{} --task eco_station", at(&model.uri()))).await;
    assert_eq!(played.code, Some(0), "{}", played.stderr);
    insta::assert_snapshot!(played.stdout);
    // The same episode as a transcript, and nothing else on stdout.
    let model = endpoint([says(burn), says("no"), says("no"), says(HOLD)]).await;
    let again = play(&env, &format!("{} --task eco_station --format jsonl", at(&model.uri()))).await;
    let printed: Vec<Value> = again.stdout.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(printed, again.transcript);
    assert_eq!(again.records("end"), played.records("end"));
}

#[tokio::test]
async fn a_bad_answer_is_repaired_once_and_then_nothing_is_done() {
    let env = serve(&Ways::new(Takes::TaskAndSeed)).await;
    let burn = r#"{"burns": [{"satellite_id": 0, "delta_vx": 0.1, "delta_vy": 0}]}"#;
    let wild = r#"{"burns": [{"satellite_id": 7, "delta_vx": 0.1, "delta_vy": 0}]}"#;
    let model = endpoint([
        says(wild),
        says(&format!("Sorry: {burn}")),
        says("Let me think."),
        says(wild),
        says(HOLD),
    ])
    .await;
    let line = format!(
        "{} --task survival --seed 1 --history 1 --temperature 0.5 --max-tokens 77",
        at(&model.uri())
    );
    let played = play(&env, &line).await;
    assert_eq!(played.code, Some(0), "{}", played.stderr);
    let steps = played.records("step");
    assert_eq!(steps[0]["action"], json!({"burns": [{"satellite_id": 0, "delta_vx": 0.1, "delta_vy": 0.0}]}));
    assert_eq!((&steps[0]["error"], &steps[0]["model"]["invalid"]), (&Value::Null, &json!(1)));
    assert_eq!((&steps[1]["action"], &steps[1]["model"]["invalid"]), (&json!({"burns": []}), &json!(2)));
    let error = "the answer is no action: burns.0.satellite_id: 7 is outside 0 to 2";
    assert_eq!(steps[1]["error"], error);
    assert!(played.lines("[STEP] step=2 ")[0].ends_with(&format!("error={error}")), "{}", played.stdout);

    let asked = sent(&model).await;
    assert_eq!(asked.len(), 2 + 2 + (steps.len() - 2), "one repair each, and no more");
    assert_eq!((&asked[0]["temperature"], &asked[0]["max_tokens"]), (&json!(0.5), &json!(77)));
    let last =
        |at: usize| asked[at]["messages"].as_array().unwrap().last().unwrap()["content"].as_str().unwrap();
    assert!(
        last(1).starts_with("That is no action: burns.0.satellite_id: 7 is outside 0 to 2."),
        "{}",
        last(1)
    );
    // One exchange is told again: with the action that was taken, and not with what had to be repaired.
    let messages = asked[2]["messages"].as_array().unwrap();
    let roles: Vec<&str> = messages.iter().map(|message| message["role"].as_str().unwrap()).collect();
    assert_eq!(roles, ["system", "user", "assistant", "user"]);
    assert_eq!(messages[2]["content"], r#"{"burns":[{"satellite_id":0,"delta_vx":0.1,"delta_vy":0.0}]}"#);
    assert_eq!(asked.last().unwrap()["messages"].as_array().unwrap().len(), 4, "the window does not grow");
    // To the letter what was sent and said.
    let kept = &steps[1]["model"]["completions"][1];
    assert_eq!((&kept["messages"], &kept["text"]), (&asked[3]["messages"], &json!(wild)));
    assert_eq!((&kept["tokens_in"], &kept["tokens_out"]), (&json!(900), &json!(20)));
    let tokens =
        format!("Model: {} calls, {} tokens in, {} out", asked.len(), 900 * asked.len(), 20 * asked.len());
    assert!(
        played.stderr.contains(&tokens) && played.stderr.contains("3 answers were no action, 1 steps"),
        "{}",
        played.stderr
    );
}

#[tokio::test]
async fn an_action_that_the_server_refuses_is_followed_by_none() {
    let ways = Ways { refuses: true, ..Ways::new(Takes::TaskAndSeed) };
    let played = play(&serve(&ways).await, "--policy blind --task survival").await;
    assert_eq!(played.code, Some(0), "{}", played.stderr);
    let steps = played.lines("[STEP]");
    assert!(
        steps[0].starts_with(
            r#"[STEP] step=1 action={"burns":[]} reward=0.02 done=false error=the environment refused: "#
        ) && steps[0].ends_with("burns.0.mood: Field required (VALIDATION_ERROR)"),
        "{}",
        steps[0]
    );
    assert!(steps[1].ends_with("error=null"));
}

#[tokio::test]
async fn lines_of_episodes_flown_at_once_stay_together() {
    let ways = Ways { full_for: 2, ..Ways::new(Takes::TaskAndSeed) };
    let line = "--policy heuristic --task survival --task formation --episodes 6 --concurrency 4 --seed 1";
    let played = play(&serve(&ways).await, line).await;
    assert_eq!(played.code, Some(0), "a server that is full is waited for: {}", played.stderr);
    let mut open = false;
    for line in played.stdout.lines() {
        assert_eq!(line.starts_with("[START]"), !open, "{line}");
        open = !line.starts_with("[END]");
    }
    assert_eq!((played.lines("[END]").len(), open), (12, false));
    let mut seeds: Vec<_> = played
        .records("start")
        .iter()
        .map(|start| (start["task"].as_str(), start["seed"].as_u64()))
        .collect();
    seeds.sort_unstable();
    let wanted = ["formation", "survival"]
        .into_iter()
        .flat_map(|task| (1..=6).map(move |seed| (Some(task), Some(seed))));
    assert_eq!(seeds, wanted.collect::<Vec<_>>());
    assert!(played.stderr.contains("Mean score (of episodes): survival 0."), "{}", played.stderr);
    assert!(played.stderr.contains(" (6), formation 0."), "{}", played.stderr);
}

/// The public kessler-env's variables stand in for the options.
#[tokio::test]
async fn variables_are_the_originals() {
    let env = serve(&Ways::new(Takes::InTurn)).await;
    let model = endpoint([says(HOLD)]).await;
    let mut command = std::process::Command::new(system_tests::binary());
    command
        .env("ENV_URL", &env)
        .env("API_BASE_URL", format!("{}/v1", model.uri()))
        .env("MODEL_NAME", "by-variable");
    command.env_remove("HF_TOKEN").env("API_KEY", system_tests::model::KEY).arg("play");
    let output = tokio::task::spawn_blocking(move || command.output().unwrap()).await.unwrap();
    let stdout = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let starts: Vec<&str> = stdout.lines().filter(|line| line.starts_with("[START]")).collect();
    assert_eq!(
        starts,
        THREE.map(|(name, _)| format!("[START] task={name} env=kessler-env model=by-variable"))
    );
    let asked = sent(&model).await;
    assert!(
        asked.iter().all(|request| request["model"] == "by-variable" && request.get("temperature").is_none())
    );
}
