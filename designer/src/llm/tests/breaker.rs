//! Retries, the circuit breaker and budgets, under a clock that is paused.

use super::*;
use crate::llm::Spent;
use tokio::time::{Instant, advance};

fn down() -> Result<Reply, LlmError> {
    Err(LlmError::Refused { status: 503, body: "away".to_owned() })
}

fn paused() -> LlmConfig {
    LlmConfig { retries: 0, ..config("http://127.0.0.1:1") }
}

#[tokio::test(start_paused = true)]
async fn the_breaker_opens_waits_longer_each_time_and_closes() {
    let answers = [down(), down(), down(), down(), Ok(reply("well"))];
    let (llm, asked) = Puppet::llm(paused(), Duration::from_millis(10), answers);
    for _ in 0..3 {
        assert_eq!(llm.health().breaker, "closed");
        assert_eq!(asks(&llm, "r").await.unwrap_err().word(), "refused");
    }
    let refuse = |error: LlmError| match error {
        LlmError::Open { retry_in, .. } => retry_in.as_secs_f64().round(),
        other => panic!("{other}"),
    };
    // Three failures open it for 30 s: nobody asks.
    assert_eq!(refuse(asks(&llm, "r").await.unwrap_err()), 30.0);
    let health = llm.health();
    assert_eq!((health.breaker, health.failures_in_a_row, health.calls), ("open", 3, 3));
    assert_eq!(health.why.unwrap(), "the model's endpoint refused with status 503: away");
    assert_eq!(*asked.lock().unwrap(), 3);
    // Then one is let through, and while it is under way nobody else.
    advance(Duration::from_secs(31)).await;
    assert_eq!(llm.health().breaker, "half_open");
    let (one, other) = tokio::join!(asks(&llm, "r"), asks(&llm, "r"));
    assert_eq!((one.unwrap_err().word(), other.unwrap_err().word()), ("refused", "open"));
    assert_eq!(*asked.lock().unwrap(), 4);
    // It failed: twice as long.
    assert_eq!(refuse(asks(&llm, "r").await.unwrap_err()), 60.0);
    advance(Duration::from_secs(61)).await;
    assert_eq!(asks(&llm, "r").await.unwrap().text, "well");
    assert_eq!((llm.health().breaker, llm.health().failures_in_a_row), ("closed", 0));
    assert_eq!(asks(&llm, "r").await.unwrap().text, "well");
}

#[tokio::test(start_paused = true)]
async fn a_trial_that_nobody_waits_for_leaves_the_breaker_to_the_next() {
    let answers = [down(), down(), down(), Ok(reply("well"))];
    let (llm, _) = Puppet::llm(paused(), Duration::from_secs(5), answers);
    for _ in 0..3 {
        asks(&llm, "r").await.unwrap_err();
    }
    advance(Duration::from_secs(31)).await;
    assert!(tokio::time::timeout(Duration::from_secs(1), asks(&llm, "r")).await.is_err());
    assert_eq!(asks(&llm, "r").await.unwrap().text, "well");
}

#[tokio::test(start_paused = true)]
async fn what_passes_is_tried_again_as_long_as_asked() {
    let limited = |s| Err(LlmError::RateLimited { retry_after: Some(Duration::from_secs(s)) });
    let config = LlmConfig { retries: 3, ..paused() };
    let (llm, asked) = Puppet::llm(config, Duration::ZERO, [limited(20), down(), Ok(reply("well"))]);
    let begun = Instant::now();
    asks(&llm, "r").await.unwrap();
    let took = begun.elapsed().as_secs_f64();
    assert!((20.0..21.0).contains(&took), "{took}");
    assert_eq!((*asked.lock().unwrap(), llm.health().retries, llm.health().calls), (3, 2, 1));
    // Who asks for more patience than we have is not waited for; what is wrong is not asked again.
    for error in [limited(3600), Err(LlmError::Refused { status: 401, body: String::new() })] {
        let (llm, asked) = Puppet::llm(LlmConfig { retries: 3, ..paused() }, Duration::ZERO, [error.clone()]);
        assert_eq!(asks(&llm, "r").await.unwrap_err(), error.unwrap_err());
        assert_eq!(*asked.lock().unwrap(), 1);
    }
}

#[tokio::test(start_paused = true)]
async fn a_budget_that_is_used_up_ends_calls_before_they_are_made() {
    // A question is guessed at 12 tokens and may be answered by 100; it comes to 150.
    let guessed = question().guess_tokens();
    assert_eq!(guessed, 12);
    let config = LlmConfig { tokens_per_run: Some(430), max_tokens: 100, ..paused() };
    let (llm, asked) = Puppet::llm(config, Duration::from_secs(1), [Ok(reply("well"))]);
    asks(&llm, "r").await.unwrap();
    // What is under way is set aside: 150 + 112 + 112 fit, and 112 more do not, though only 150 are spent.
    let (a, b, c) = tokio::join!(asks(&llm, "r"), asks(&llm, "r"), asks(&llm, "r"));
    let all = [a, b, c].map(|result| result.map_or_else(|error| error.word(), |_| "ok"));
    // Two may ask at once: the third waits for its turn, and by then two have used 300 more.
    assert_eq!(all, ["ok", "ok", "budget"]);
    assert_eq!(*asked.lock().unwrap(), 3);
    assert_eq!(llm.spent("r").tokens, 450);
    // Another run has its own.
    asks(&llm, "s").await.unwrap();
    let error = asks(&llm, "r").await.unwrap_err().to_string();
    assert_eq!(
        error,
        "the budget of tokens of this run does not pay for another call: 450 of 430 is spent or under way"
    );
    // What is no failure of the endpoint does not open the breaker.
    assert_eq!(llm.health().failures_in_a_row, 0);
}

#[tokio::test(start_paused = true)]
async fn a_days_budget_comes_back_with_the_day_and_survives_restarts() {
    let hand = Arc::new(std::sync::atomic::AtomicI64::new(NEW_YEAR_MS));
    let read = Arc::clone(&hand);
    let clock = WallClock::new(move || read.load(std::sync::atomic::Ordering::SeqCst));
    let today = clock.day();
    let config = LlmConfig {
        cost_per_day: Some(1.0),
        price_in: 1000.0,
        price_out: 2000.0,
        max_tokens: 100,
        clock,
        ..paused()
    };
    // 100 in and 50 out cost 0.2; at most 0.212 is set aside.
    let (llm, asked) = Puppet::llm(config, Duration::ZERO, [Ok(reply("well"))]);
    llm.restore("r", 300, 0.5, today);
    llm.restore("r", 9000, 50.0, today - 1);
    assert_eq!(llm.spent("r"), Spent { tokens: 9300, cost: 50.5 });
    asks(&llm, "r").await.unwrap();
    asks(&llm, "s").await.unwrap();
    assert_eq!(asks(&llm, "s").await.unwrap_err().word(), "budget");
    assert_eq!(*asked.lock().unwrap(), 2);
    assert!((llm.health().today.cost - 0.9).abs() < 1e-12); // sums of a few decimals
    hand.fetch_add(86_400_000, std::sync::atomic::Ordering::SeqCst);
    assert_eq!(llm.health().today, Spent::default());
    asks(&llm, "s").await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn what_a_call_came_to_is_counted_even_where_no_answer_came() {
    let timeout = Err(LlmError::Timeout { after: Duration::from_secs(1) });
    let (llm, _) = Puppet::llm(paused(), Duration::from_secs(5), [timeout, down(), Ok(reply("well"))]);
    asks(&llm, "r").await.unwrap_err();
    assert_eq!(llm.spent("r").tokens, 12); // it was sent; whether it was answered nobody knows
    asks(&llm, "r").await.unwrap_err();
    assert_eq!(llm.spent("r").tokens, 12); // it was refused
    assert!(tokio::time::timeout(Duration::from_secs(1), asks(&llm, "r")).await.is_err());
    assert_eq!(llm.spent("r").tokens, 24); // nobody waited for it
}
