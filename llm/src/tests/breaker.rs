//! Retries, the circuit breaker and budgets, under a paused clock.

use super::*;
use std::sync::atomic::{AtomicI64, Ordering};
use tokio::time::{Instant, advance};

fn unavailable() -> Result<ChatResponse, LlmError> {
    Err(LlmError::Refused { status: 503, body: "away".to_owned() })
}

fn rate_limited(seconds: u64) -> Result<ChatResponse, LlmError> {
    Err(LlmError::RateLimited { retry_after: Some(Duration::from_secs(seconds)) })
}

fn without_retries() -> LlmConfig {
    LlmConfig { retries: 0, ..test_config(NO_ENDPOINT) }
}

/// Whole seconds until the next trial call.
fn retry_in(error: &LlmError) -> f64 {
    match error {
        LlmError::CircuitOpen { retry_in, .. } => retry_in.as_secs_f64().round(),
        other => panic!("{other}"),
    }
}

#[tokio::test(start_paused = true)]
async fn breaker_opens_longer_after_each_failed_trial() {
    let results = [unavailable(), unavailable(), unavailable(), unavailable(), Ok(chat_response("well"))];
    let ScriptedModel { client, calls } =
        ScriptedModel::new(without_retries(), Duration::from_millis(10), results);
    for _ in 0..3 {
        assert_eq!(client.health().breaker, BreakerState::Closed);
        assert_eq!(complete(&client, "r").await.unwrap_err().kind(), "refused");
    }
    // Three failures open it for 30 s.
    assert_eq!(retry_in(&complete(&client, "r").await.unwrap_err()), 30.0);
    let health = client.health();
    assert_eq!((health.breaker, health.consecutive_failures, health.calls), (BreakerState::Open, 3, 3));
    assert_eq!(health.breaker_error.unwrap(), "the model's endpoint returned status 503: away");
    assert_eq!(calls.get(), 3);
    // Then it lets one trial call through, and rejects others meanwhile.
    advance(Duration::from_secs(31)).await;
    assert_eq!(client.health().breaker, BreakerState::HalfOpen);
    let (one, other) = tokio::join!(complete(&client, "r"), complete(&client, "r"));
    assert_eq!((one.unwrap_err().kind(), other.unwrap_err().kind()), ("refused", "open"));
    assert_eq!(calls.get(), 4);
    // The trial failed, so the period doubles.
    assert_eq!(retry_in(&complete(&client, "r").await.unwrap_err()), 60.0);
    advance(Duration::from_secs(61)).await;
    assert_eq!(complete(&client, "r").await.unwrap().text, "well");
    assert_eq!((client.health().breaker, client.health().consecutive_failures), (BreakerState::Closed, 0));
    assert_eq!(complete(&client, "r").await.unwrap().text, "well");
}

#[tokio::test(start_paused = true)]
async fn cancelled_trial_allows_another_trial() {
    let results = [unavailable(), unavailable(), unavailable(), Ok(chat_response("well"))];
    let ScriptedModel { client, .. } = ScriptedModel::new(without_retries(), Duration::from_secs(5), results);
    for _ in 0..3 {
        complete(&client, "r").await.unwrap_err();
    }
    advance(Duration::from_secs(31)).await;
    assert!(tokio::time::timeout(Duration::from_secs(1), complete(&client, "r")).await.is_err());
    assert_eq!(complete(&client, "r").await.unwrap().text, "well");
}

#[tokio::test(start_paused = true)]
async fn failed_trial_is_not_retried() {
    let config = LlmConfig { retries: 3, ..without_retries() };
    let ScriptedModel { client, calls } = ScriptedModel::new(config, Duration::ZERO, [unavailable()]);
    for _ in 0..3 {
        complete(&client, "r").await.unwrap_err();
    }
    assert_eq!(calls.get(), 12);
    advance(Duration::from_secs(31)).await;
    complete(&client, "r").await.unwrap_err();
    assert_eq!(calls.get(), 13);
}

#[tokio::test(start_paused = true)]
async fn transient_failures_are_retried_after_retry_after() {
    let config = LlmConfig { retries: 3, ..without_retries() };
    let results = [rate_limited(20), unavailable(), Ok(chat_response("well"))];
    let ScriptedModel { client, calls } = ScriptedModel::new(config, Duration::ZERO, results);
    let started = Instant::now();
    complete(&client, "r").await.unwrap();
    let took_s = started.elapsed().as_secs_f64();
    assert!((20.0..21.0).contains(&took_s), "{took_s}");
    assert_eq!((calls.get(), client.health().retries, client.health().calls), (3, 2, 1));
    // A long Retry-After and a permanent error are not retried.
    for error in [rate_limited(3600), Err(LlmError::Refused { status: 401, body: String::new() })] {
        let config = LlmConfig { retries: 3, ..without_retries() };
        let ScriptedModel { client, calls } = ScriptedModel::new(config, Duration::ZERO, [error.clone()]);
        assert_eq!(complete(&client, "r").await.unwrap_err(), error.unwrap_err());
        assert_eq!(calls.get(), 1);
    }
}

#[tokio::test(start_paused = true)]
async fn exhausted_run_budget_rejects_calls() {
    // A request is estimated at 12 tokens and may get 100; it uses 150.
    assert_eq!(request().estimate_tokens(), 12);
    let config = LlmConfig { tokens_per_run: Some(430), max_tokens: 100, ..without_retries() };
    let ScriptedModel { client, calls } =
        ScriptedModel::new(config, Duration::from_secs(1), [Ok(chat_response("well"))]);
    complete(&client, "r").await.unwrap();
    // 150 + 112 + 112 are spent or reserved; another 112 exceed the budget.
    let (a, b, c) = tokio::join!(complete(&client, "r"), complete(&client, "r"), complete(&client, "r"));
    let kinds = [a, b, c].map(|result| result.map_or_else(|error| error.kind(), |_| "ok"));
    // Two calls run at once. The third waits for a slot, and by then the two have used 300 more.
    assert_eq!(kinds, ["ok", "ok", "budget"]);
    assert_eq!(calls.get(), 3);
    assert_eq!(client.spending("r").tokens, 450);
    // Each run has its own budget.
    complete(&client, "s").await.unwrap();
    let error = complete(&client, "r").await.unwrap_err().to_string();
    assert_eq!(
        error,
        "the budget of tokens of this run does not cover another call: 450 of 430 is spent or reserved"
    );
    // A budget error does not count as a failure of the endpoint.
    assert_eq!(client.health().consecutive_failures, 0);
}

#[tokio::test(start_paused = true)]
async fn daily_budget_survives_restarts_and_resets_at_midnight() {
    let now_ms = Arc::new(AtomicI64::new(NEW_YEAR_MS));
    let read = Arc::clone(&now_ms);
    let clock = WallClock::new(move || read.load(Ordering::SeqCst));
    let today = clock.day();
    let config = LlmConfig {
        cost_per_day: Some(1.0),
        price_in: 1000.0,
        price_out: 2000.0,
        max_tokens: 100,
        clock,
        ..without_retries()
    };
    // 100 prompt and 50 completion tokens cost 0.2; at most 0.212 are reserved.
    let ScriptedModel { client, calls } =
        ScriptedModel::new(config, Duration::ZERO, [Ok(chat_response("well"))]);
    client.restore_spending("r", Spending { tokens: 300, cost: 0.5 }, today);
    client.restore_spending("r", Spending { tokens: 9000, cost: 50.0 }, today - 1);
    assert_eq!(client.spending("r"), Spending { tokens: 9300, cost: 50.5 });
    complete(&client, "r").await.unwrap();
    complete(&client, "s").await.unwrap();
    assert_eq!(complete(&client, "s").await.unwrap_err().kind(), "budget");
    assert_eq!(calls.get(), 2);
    assert!((client.health().today.cost - 0.9).abs() < 1e-12); // sum of decimal fractions
    now_ms.fetch_add(86_400_000, Ordering::SeqCst);
    assert_eq!(client.health().today, Spending::default());
    complete(&client, "s").await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn unanswered_calls_cost_their_prompt() {
    let timeout = Err(LlmError::Timeout { after: Duration::from_secs(1) });
    let results = [timeout, unavailable(), Ok(chat_response("well"))];
    let ScriptedModel { client, .. } = ScriptedModel::new(without_retries(), Duration::from_secs(5), results);
    complete(&client, "r").await.unwrap_err();
    assert_eq!(client.spending("r").tokens, 12); // sent, and perhaps answered
    complete(&client, "r").await.unwrap_err();
    assert_eq!(client.spending("r").tokens, 12); // rejected by the endpoint
    assert!(tokio::time::timeout(Duration::from_secs(1), complete(&client, "r")).await.is_err());
    assert_eq!(client.spending("r").tokens, 24); // cancelled by the caller
}
