//! Every way in which a model's endpoint or a server can misbehave: each ends in time, with an exit code, a sentence and
//! whole lines, and nothing tells the key (which `play` itself looks for).

use std::time::{Duration, Instant};

use serde_json::json;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpListener;
use wiremock::ResponseTemplate;

use super::env::{Takes, Ways, serve};
use super::{Played, at, play};
use system_tests::model::{HOLD, KEY, completion, endpoint, says, sent};

const LINE: &str = "--task survival --seed 1 --retries 1 --timeout 1";

/// Flies one episode by an endpoint that answers so in turn.
async fn by(answers: impl IntoIterator<Item = ResponseTemplate>) -> Played {
    let env = serve(&Ways::new(Takes::TaskAndSeed)).await;
    let model = endpoint(answers).await;
    play(&env, &format!("{} {LINE}", at(&model.uri()))).await
}

/// An address at which nobody listens.
async fn nobody() -> String {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    format!("http://{}", listener.local_addr().unwrap())
}

/// Nothing was flown: exit code 2, and one sentence.
#[track_caller]
fn refused(played: &Played, sentence: &str) {
    assert_eq!(played.code, Some(2), "{played:?}");
    assert!(played.stderr.lines().count() == 1 && played.stderr.contains(sentence), "{}", played.stderr);
}

/// It was broken off after so many steps: exit code 1, and an end to the lines.
#[track_caller]
fn broken_off(played: &Played, steps: usize, sentence: &str) {
    assert_eq!(played.code, Some(1), "{played:?}");
    let end = played.stdout.lines().last().unwrap();
    assert!(end.starts_with(&format!("[END] success=false steps={steps} score=")), "{end}");
    assert_eq!(played.lines("[STEP]").len(), steps);
    assert!(played.stderr.contains(sentence), "{}", played.stderr);
    let fault = played.records("end")[0]["fault"].as_str().unwrap();
    assert!(fault.contains(sentence), "{fault}");
}

#[tokio::test]
async fn a_slow_model_does_nothing_and_is_then_left_alone() {
    let late = || says(HOLD).set_delay(Duration::from_secs(30));
    let begun = Instant::now();
    let played = by([late()]).await;
    broken_off(&played, 3, "the model is not asked for another");
    for step in played.lines("[STEP]") {
        assert!(step.ends_with("error=the model did not answer within 1 s"), "{step}");
    }
    // Three calls of a second each; the machine may be busy, and 50 steps would take half an hour.
    assert!(begun.elapsed() < Duration::from_secs(60));
    // Once is no reason to give up.
    let played = by([says(HOLD), late(), says(HOLD)]).await;
    assert_eq!((played.code, played.lines("[STEP]").len()), (Some(0), 50), "{}", played.stderr);
    assert!(played.stderr.contains("1 steps went without one"), "{}", played.stderr);
}

/// Three failures running leave the endpoint alone for half a minute; one that had answered before is waited for, and the episode
/// goes on. This takes that half minute.
#[tokio::test]
async fn an_endpoint_that_recovers_is_waited_for() {
    let html = || ResponseTemplate::new(200).set_body_string("<html>a moment, please</html>");
    let begun = Instant::now();
    let played = by([says(HOLD), html(), html(), html(), says(HOLD)]).await;
    assert_eq!((played.code, played.lines("[STEP]").len()), (Some(0), 50), "{}", played.stderr);
    assert!(begun.elapsed() >= Duration::from_secs(29), "{:?}", begun.elapsed());
    assert!(played.stderr.contains("3 steps went without one"), "{}", played.stderr);
}

#[tokio::test]
async fn limits_are_waited_for_where_that_is_short() {
    let busy =
        |after: &str| ResponseTemplate::new(429).insert_header("retry-after", after).set_body_string(KEY);
    let begun = Instant::now();
    let played = by([busy("1"), says(HOLD)]).await;
    assert_eq!((played.code, played.lines("[STEP]").len()), (Some(0), 50), "{}", played.stderr);
    assert!(begun.elapsed() >= Duration::from_secs(1));
    refused(&by([busy("3600")]).await, "rate limited: it asks to wait 3600 s");
    broken_off(&by([says(HOLD), says(HOLD), busy("3600")]).await, 2, "rate limited");
}

#[tokio::test]
async fn an_endpoint_that_fails_breaks_the_episode_off() {
    let down = || ResponseTemplate::new(503).set_body_string(format!("down, {KEY}"));
    let played = by([down(), says(HOLD)]).await;
    assert_eq!(played.code, Some(0), "in passing: {}", played.stderr);
    refused(&by([down()]).await, "refused with status 503: down, [key]");
    broken_off(&by([says(HOLD), says(HOLD), says(HOLD), down()]).await, 3, "status 503");
    let no =
        ResponseTemplate::new(401).set_body_json(json!({"error": {"message": format!("bad key {KEY}")}}));
    refused(&by([no]).await, "refused with status 401: bad key [key]");
}

#[tokio::test]
async fn answers_that_make_no_sense_are_no_actions() {
    let whole = completion(HOLD).to_string();
    let body = |text: &str| ResponseTemplate::new(200).set_body_string(text.to_owned());
    for (answer, why) in [
        (body(&whole[..whole.len() / 2]), "it is no chat completion"),
        (body("<html>a captive portal</html>"), "it is no chat completion"),
        (body(r#"{"choices": []}"#), "it has no choices"),
    ] {
        let played = by([answer]).await;
        broken_off(&played, 3, "the model is not asked for another");
        let last = played.lines("[STEP]")[2];
        assert!(last.contains(r#"action={"burns":[]}"#) && last.contains(why), "{last}");
    }
    // A model that says the key, in pieces that only JSON puts together.
    let played = by([says(&format!(r#"{{"burns": "{}"}}"#, KEY.replace('0', "\\u0030")))]).await;
    assert_eq!(played.code, Some(0), "{}", played.stderr);
    assert!(played.lines("[STEP]")[0].contains("burns is a string"), "{}", played.lines("[STEP]")[0]);
}

#[tokio::test]
async fn an_answer_without_end_is_not_read_to_the_end() {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    tokio::spawn(async move {
        while let Ok((mut stream, _)) = listener.accept().await {
            tokio::spawn(async move {
                let mut heard = [0; 65536];
                let _ = stream.read(&mut heard).await;
                let head = b"HTTP/1.1 200 OK\r\ntransfer-encoding: chunked\r\n\r\n";
                let _ = stream.write_all(head).await;
                let piece = [b"10000\r\n".to_vec(), vec![b' '; 65536], b"\r\n".to_vec()].concat();
                while stream.write_all(&piece).await.is_ok() {}
            });
        }
    });
    let env = serve(&Ways::new(Takes::TaskAndSeed)).await;
    // More time than the answer takes to be too long.
    let line = LINE.replace("--timeout 1", "--timeout 20");
    let played = play(&env, &format!("{} {line}", at(&format!("http://{address}")))).await;
    broken_off(&played, 3, "the model is not asked for another");
    assert!(played.lines("[STEP]")[0].contains("it is longer than 1048576 bytes"), "{}", played.stdout);
}

#[tokio::test]
async fn where_nobody_is_there_one_sentence_says_so() {
    let env = serve(&Ways::new(Takes::TaskAndSeed)).await;
    let gone = nobody().await;
    refused(&play(&env, &format!("{} {LINE}", at(&gone))).await, "the model's endpoint cannot be reached");
    let played = play(&gone, "--policy hold --episodes 50 --concurrency 3").await;
    refused(&played, &format!("the environment at {gone} cannot be reached: "));
    assert_eq!(played.stdout, "");
    refused(&play(&env, "").await, "no model is named: give --api-base-url and --model");
    refused(&play(&env, "--policy reference").await, "--policy reference: it plans on the scenario itself");
    refused(
        &play("http://me:secret@h", "--policy hold").await,
        "--env-url: a host, a port and a path are wanted",
    );
}

#[tokio::test]
async fn a_server_that_drops_the_connection_breaks_the_episode_off() {
    let ways = Ways { drops_at: Some(4), ..Ways::new(Takes::TaskAndSeed) };
    let env = serve(&ways).await;
    let played = play(&env, "--policy hold --task survival").await;
    broken_off(&played, 3, "the environment broke the connection off");
    // The other episodes are flown all the same, as far as it goes.
    let played = play(&env, "--policy hold --task survival --episodes 3 --concurrency 2").await;
    assert_eq!(
        (played.code, played.lines("[END] success=false steps=3").len()),
        (Some(1), 3),
        "{}",
        played.stderr
    );
    assert!(
        played.stderr.contains("0 of 3 episodes were flown to their end, 3 were broken off"),
        "{}",
        played.stderr
    );

    let ways = Ways { drops_at: Some(1), ..Ways::new(Takes::TaskAndSeed) };
    refused(&play(&serve(&ways).await, "--policy hold").await, "the environment broke the connection off");

    let model = endpoint([says(HOLD)]).await;
    let ways = Ways { drops_at: Some(2), ..Ways::new(Takes::InTurn) };
    let played = play(&serve(&ways).await, &format!("{} {LINE}", at(&model.uri()))).await;
    broken_off(&played, 1, "the environment broke the connection off");
    assert_eq!(sent(&model).await.len(), 2, "the model is not asked again");
}

/// The command as a child of this process, its output piped.
fn spawned(env: &str, line: &str) -> std::process::Child {
    let mut command = std::process::Command::new(system_tests::binary());
    command.env("HF_TOKEN", KEY).args(["play", "--env-url", env]).args(line.split_whitespace());
    command.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped()).spawn().unwrap()
}

/// `sparring play … | head -1`: flying costs, and ends where nobody reads.
#[tokio::test]
async fn where_nobody_reads_any_more_nothing_more_is_flown() {
    use std::io::{BufRead, BufReader};
    let ways = Ways::new(Takes::TaskAndSeed);
    let mut child = spawned(&serve(&ways).await, "--policy hold --task survival --episodes 200");
    let ended = tokio::task::spawn_blocking(move || {
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        (line, child.wait_with_output().unwrap())
    });
    let (line, output) = ended.await.unwrap();
    assert!(line.starts_with("[START]"), "{line}");
    assert!(String::from_utf8_lossy(&output.stderr).contains("nobody reads stdout any more"), "{output:?}");
    assert!(ways.flown().len() < 10, "{}", ways.flown().len());
}

#[cfg(unix)]
#[tokio::test]
async fn told_to_stop_it_tells_how_far_it_came() {
    use std::io::{BufRead, BufReader, Read};
    let env = serve(&Ways::new(Takes::TaskAndSeed)).await;
    let model = endpoint([says(HOLD).set_delay(Duration::from_millis(100))]).await;
    let mut child = spawned(&env, &format!("{} --task survival --episodes 3", at(&model.uri())));
    let ended = tokio::task::spawn_blocking(move || {
        let mut out = BufReader::new(child.stdout.take().unwrap());
        let mut lines = String::new();
        while !lines.contains("[STEP] step=3 ") {
            assert!(out.read_line(&mut lines).unwrap() > 0, "{lines}");
        }
        let asked =
            std::process::Command::new("kill").arg("-INT").arg(child.id().to_string()).status().unwrap();
        assert!(asked.success());
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
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(words.contains("it was told to stop") && words.contains("0 of 3 episodes"), "{words}");
}
