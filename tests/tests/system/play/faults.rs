//! Faults of model endpoints and OpenEnv servers. Each ends in time, with an exit code, one sentence and complete lines. No
//! output has the API key, which the helper `play` checks.

use std::time::{Duration, Instant};

use serde_json::json;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpListener;
use wiremock::ResponseTemplate;

use super::openenv_server::{ServerOptions, TaskChoice, serve};
use super::{PlayOutput, endpoint_args, play};
use system_tests::mock_llm::{
    API_KEY, ClosedPort, HOLD_ACTION, chat_completion, chat_response, received_bodies, start_endpoint,
};

/// Options of one episode, with a timeout that no response on a busy machine exceeds.
const ARGS: &str = "--task survival --seed 1 --retries 1 --timeout 120";

/// Runs `play` for one episode with a model that returns the responses in order.
async fn play_with_responses(responses: impl IntoIterator<Item = ResponseTemplate>) -> PlayOutput {
    play_with_args(ARGS, responses).await
}

async fn play_with_args(args: &str, responses: impl IntoIterator<Item = ResponseTemplate>) -> PlayOutput {
    let server = serve(&ServerOptions::new(TaskChoice::OnRequest)).await;
    let model = start_endpoint(responses).await;
    play(&server, &format!("{} {args}", endpoint_args(&model.uri()))).await
}

/// Checks that the command failed before the first step: exit code 2 and one sentence.
#[track_caller]
fn assert_failed_before_the_first_step(output: &PlayOutput, sentence: &str) {
    assert_eq!(output.code, Some(2), "{output:?}");
    assert!(output.stderr.lines().count() == 1 && output.stderr.contains(sentence), "{}", output.stderr);
}

/// Checks that the episode was aborted after `steps` steps: exit code 1 and an `[END]` line.
#[track_caller]
fn assert_aborted(output: &PlayOutput, steps: usize, sentence: &str) {
    assert_eq!(output.code, Some(1), "{output:?}");
    let end = output.stdout.lines().last().unwrap();
    assert!(end.starts_with(&format!("[END] success=false steps={steps} score=")), "{end}");
    assert_eq!(output.lines("[STEP]").len(), steps);
    assert!(output.stderr.contains(sentence), "{}", output.stderr);
    let fault = output.records("end")[0]["fault"].as_str().unwrap();
    assert!(fault.contains(sentence), "{fault}");
}

#[tokio::test]
async fn slow_model_is_abandoned_after_three_timeouts() {
    let args = ARGS.replace("--timeout 120", "--timeout 4");
    let late = || chat_response(HOLD_ACTION).set_delay(Duration::from_secs(300));
    let start = Instant::now();
    let output = play_with_args(&args, [late()]).await;
    assert_aborted(&output, 3, "calls of the model are paused for");
    for step in output.lines("[STEP]") {
        assert!(step.ends_with("error=the model did not answer within 4 s"), "{step}");
    }
    // Three calls of four seconds each. Without the timeout a single call takes 300 s.
    assert!(start.elapsed() < Duration::from_secs(200));
    // One timeout does not break the episode off.
    let responses = [chat_response(HOLD_ACTION), late(), chat_response(HOLD_ACTION)];
    let output = play_with_args(&args, responses).await;
    assert_eq!((output.code, output.lines("[STEP]").len()), (Some(0), 50), "{}", output.stderr);
    assert!(output.stderr.contains("1 steps had no action"), "{}", output.stderr);
}

/// Three failures in a row open the circuit breaker for half a minute. An endpoint that worked before is awaited, and the
/// episode continues. The test takes that half minute.
#[tokio::test]
async fn recovering_endpoint_is_awaited() {
    let html = || ResponseTemplate::new(200).set_body_string("<html>a moment, please</html>");
    let start = Instant::now();
    let output =
        play_with_responses([chat_response(HOLD_ACTION), html(), html(), html(), chat_response(HOLD_ACTION)])
            .await;
    assert_eq!((output.code, output.lines("[STEP]").len()), (Some(0), 50), "{}", output.stderr);
    assert!(start.elapsed() >= Duration::from_secs(29), "{:?}", start.elapsed());
    assert!(output.stderr.contains("3 steps had no action"), "{}", output.stderr);
}

#[tokio::test]
async fn short_rate_limits_are_awaited() {
    let busy =
        |after: &str| ResponseTemplate::new(429).insert_header("retry-after", after).set_body_string(API_KEY);
    let start = Instant::now();
    let output = play_with_responses([busy("1"), chat_response(HOLD_ACTION)]).await;
    assert_eq!((output.code, output.lines("[STEP]").len()), (Some(0), 50), "{}", output.stderr);
    assert!(start.elapsed() >= Duration::from_secs(1));
    assert_failed_before_the_first_step(
        &play_with_responses([busy("3600")]).await,
        "limits the rate of requests; retry after 3600 s",
    );
    assert_aborted(
        &play_with_responses([chat_response(HOLD_ACTION), chat_response(HOLD_ACTION), busy("3600")]).await,
        2,
        "limits the rate of requests",
    );
}

#[tokio::test]
async fn failing_endpoint_breaks_the_episode_off() {
    let down = || ResponseTemplate::new(503).set_body_string(format!("down, {API_KEY}"));
    let output = play_with_responses([down(), chat_response(HOLD_ACTION)]).await;
    assert_eq!(output.code, Some(0), "one failure is retried: {}", output.stderr);
    assert_failed_before_the_first_step(
        &play_with_responses([down()]).await,
        "returned status 503: down, [key]",
    );
    assert_aborted(
        &play_with_responses([
            chat_response(HOLD_ACTION),
            chat_response(HOLD_ACTION),
            chat_response(HOLD_ACTION),
            down(),
        ])
        .await,
        3,
        "status 503",
    );
    let no =
        ResponseTemplate::new(401).set_body_json(json!({"error": {"message": format!("bad key {API_KEY}")}}));
    assert_failed_before_the_first_step(
        &play_with_responses([no]).await,
        "returned status 401: bad key [key]",
    );
}

#[tokio::test]
async fn malformed_responses_are_no_actions() {
    let whole = chat_completion(HOLD_ACTION).to_string();
    let body = |text: &str| ResponseTemplate::new(200).set_body_string(text.to_owned());
    for (response, why) in [
        (body(&whole[..whole.len() / 2]), "it is not a chat completion"),
        (body("<html>a captive portal</html>"), "it is not a chat completion"),
        (body(r#"{"choices": []}"#), "it has no choices"),
    ] {
        let output = play_with_responses([response]).await;
        assert_aborted(&output, 3, "calls of the model are paused for");
        let last = output.lines("[STEP]")[2];
        assert!(last.contains(r#"action={"burns":[]}"#) && last.contains(why), "{last}");
    }
    // A model that returns the key with JSON escapes.
    let output = play_with_responses([chat_response(&format!(
        r#"{{"burns": "{}"}}"#,
        API_KEY.replace('0', "\\u0030")
    ))])
    .await;
    assert_eq!(output.code, Some(0), "{}", output.stderr);
    assert!(output.lines("[STEP]")[0].contains("burns is a string"), "{}", output.lines("[STEP]")[0]);
}

#[tokio::test]
async fn endless_response_is_cut_off() {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    tokio::spawn(async move {
        while let Ok((mut stream, _)) = listener.accept().await {
            tokio::spawn(async move {
                let mut request = [0; 65536];
                let _ = stream.read(&mut request).await;
                let head = b"HTTP/1.1 200 OK\r\ntransfer-encoding: chunked\r\n\r\n";
                let _ = stream.write_all(head).await;
                let piece = [b"10000\r\n".to_vec(), vec![b' '; 65536], b"\r\n".to_vec()].concat();
                while stream.write_all(&piece).await.is_ok() {}
            });
        }
    });
    let server = serve(&ServerOptions::new(TaskChoice::OnRequest)).await;
    // The response exceeds its size limit long before the timeout.
    let output = play(&server, &format!("{} {ARGS}", endpoint_args(&format!("http://{address}")))).await;
    assert_aborted(&output, 3, "calls of the model are paused for");
    assert!(output.lines("[STEP]")[0].contains("it has more than 1048576 bytes"), "{}", output.stdout);
}

#[tokio::test]
async fn unreachable_servers_are_one_error_sentence() {
    let server = serve(&ServerOptions::new(TaskChoice::OnRequest)).await;
    let closed = ClosedPort::reserve();
    let address = closed.url();
    assert_failed_before_the_first_step(
        &play(&server, &format!("{} {ARGS}", endpoint_args(&address))).await,
        "the model's endpoint cannot be reached",
    );
    let output = play(&address, "--policy hold --episodes 50 --concurrency 3").await;
    assert_failed_before_the_first_step(
        &output,
        &format!("the environment at {address} cannot be reached: "),
    );
    assert_eq!(output.stdout, "");
    assert_failed_before_the_first_step(
        &play(&server, "").await,
        "no model is named: give --api-base-url and --model",
    );
    assert_failed_before_the_first_step(
        &play(&server, "--policy reference").await,
        "--policy reference: it needs the scenario itself",
    );
    assert_failed_before_the_first_step(
        &play("http://me:secret@h", "--policy hold").await,
        "--env-url: it must be only a host, a port and a path",
    );
}

#[tokio::test]
async fn dropped_connection_breaks_the_episode_off() {
    let options = ServerOptions { drop_at_step: Some(4), ..ServerOptions::new(TaskChoice::OnRequest) };
    let server = serve(&options).await;
    let output = play(&server, "--policy hold --task survival").await;
    assert_aborted(&output, 3, "the environment closed the connection");
    // The other episodes are run all the same, up to the same step.
    let output = play(&server, "--policy hold --task survival --episodes 3 --concurrency 2").await;
    assert_eq!(
        (output.code, output.lines("[END] success=false steps=3").len()),
        (Some(1), 3),
        "{}",
        output.stderr
    );
    assert!(
        output.stderr.contains("0 of 3 episodes were run to their end, 3 were aborted"),
        "{}",
        output.stderr
    );

    let options = ServerOptions { drop_at_step: Some(1), ..ServerOptions::new(TaskChoice::OnRequest) };
    assert_failed_before_the_first_step(
        &play(&serve(&options).await, "--policy hold").await,
        "the environment closed the connection",
    );

    let model = start_endpoint([chat_response(HOLD_ACTION)]).await;
    let options = ServerOptions { drop_at_step: Some(2), ..ServerOptions::new(TaskChoice::Cycle) };
    let output = play(&serve(&options).await, &format!("{} {ARGS}", endpoint_args(&model.uri()))).await;
    assert_aborted(&output, 1, "the environment closed the connection");
    assert_eq!(received_bodies(&model).await.len(), 2, "the model gets no further request");
}

/// Spawns the command with piped output.
fn spawn_play(server: &str, args: &str) -> std::process::Child {
    let mut command = std::process::Command::new(system_tests::sparring_binary());
    command.env("HF_TOKEN", API_KEY).args(["play", "--env-url", server]).args(args.split_whitespace());
    command.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped()).spawn().unwrap()
}

/// `sparring play … | head -1` stops soon after its output is closed.
#[tokio::test]
async fn closed_stdout_stops_further_episodes() {
    use std::io::{BufRead, BufReader};
    let options = ServerOptions::new(TaskChoice::OnRequest);
    let mut child = spawn_play(&serve(&options).await, "--policy hold --task survival --episodes 200");
    let ended = tokio::task::spawn_blocking(move || {
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        (line, child.wait_with_output().unwrap())
    });
    let (line, output) = ended.await.unwrap();
    assert!(line.starts_with("[START]"), "{line}");
    assert!(String::from_utf8_lossy(&output.stderr).contains("stdout is closed"), "{output:?}");
    // Until the test closes its end of the pipe, the command prints at most what a pipe holds: about 16 episodes.
    assert!(options.episode_tasks().len() < 50, "{}", options.episode_tasks().len());
}

#[cfg(unix)]
#[tokio::test]
async fn interrupt_prints_a_summary() {
    use std::io::{BufRead, BufReader, Read};
    let server = serve(&ServerOptions::new(TaskChoice::OnRequest)).await;
    let model = start_endpoint([chat_response(HOLD_ACTION).set_delay(Duration::from_millis(300))]).await;
    let mut child =
        spawn_play(&server, &format!("{} --task survival --episodes 3", endpoint_args(&model.uri())));
    let ended = tokio::task::spawn_blocking(move || {
        let mut out = BufReader::new(child.stdout.take().unwrap());
        let mut lines = String::new();
        while !lines.contains("[STEP] step=3 ") {
            assert!(out.read_line(&mut lines).unwrap() > 0, "{lines}");
        }
        let signalled =
            std::process::Command::new("kill").arg("-INT").arg(child.id().to_string()).status().unwrap();
        assert!(signalled.success());
        out.read_to_string(&mut lines).unwrap();
        (lines, child.wait_with_output().unwrap())
    });
    let (lines, output) = ended.await.unwrap();
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let last = lines.lines().last().unwrap();
    assert!(
        last.starts_with("[END] success=false steps=") && lines.matches("[START]").count() == 1,
        "{lines}"
    );
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(stderr.contains("it was stopped") && stderr.contains("0 of 3 episodes"), "{stderr}");
}
