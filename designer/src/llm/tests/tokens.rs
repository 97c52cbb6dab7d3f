//! What an endpoint says a call came to, and what of it is believed.

use super::*;
use crate::llm::Spent;

/// An answer of six bytes (two tokens, as guessed) with this usage; the question is guessed at 12, and 100 may come out.
async fn came_to(usage: Value) -> (u64, u64) {
    let mut body = completion("answer");
    body["usage"] = usage;
    let server = endpoint([ResponseTemplate::new(200).set_body_json(body)]).await;
    let llm = Llm::new(config(&server.uri())).unwrap();
    let (reply, bill) = billed(&llm, "r").await;
    assert_eq!(reply.unwrap().text, "answer");
    assert_eq!(llm.spent("r").tokens, bill.tokens_in + bill.tokens_out);
    (bill.tokens_in, bill.tokens_out)
}

#[tokio::test]
async fn odd_usage_loses_no_answer() {
    let of = |tokens_in: Value, tokens_out: Value| json!({"prompt_tokens": tokens_in, "completion_tokens": tokens_out});
    assert_eq!(came_to(of(json!(40), json!(7))).await, (40, 7));
    assert_eq!(came_to(of(json!(40.0), json!(7.0))).await, (40, 7));
    for odd in [json!(-1), json!(-1.0), json!(1.5), json!("40"), json!(null), json!([]), json!({})] {
        assert_eq!(came_to(of(odd.clone(), odd)).await, (12, 2));
    }
    for odd in [json!(null), json!("free"), json!([]), json!({}), json!(3)] {
        assert_eq!(came_to(odd).await, (12, 2));
    }
}

#[tokio::test]
async fn usage_that_cannot_be_is_not_believed() {
    // Ten times what is guessed and a thousand more, or what is allowed.
    let most = json!({"prompt_tokens": u64::MAX, "completion_tokens": u64::MAX});
    assert_eq!(came_to(most).await, (1_120, 1_020));
    assert_eq!(came_to(json!({"prompt_tokens": 1e300, "completion_tokens": 1e19})).await, (1_120, 1_020));
    // A model that thinks writes more than is seen.
    let huge = Reply { tokens_in: Some(u64::MAX), tokens_out: Some(u64::MAX), ..reply("answer") };
    let puppet = |max_tokens| async move {
        let huge = Ok(huge.clone());
        let (llm, _) = Puppet::llm(config("http://127.0.0.1:1"), Duration::ZERO, [huge]);
        let (ask, mut bill) = (Ask { max_tokens, ..question() }, Bill::default());
        llm.ask(&Call { run: "r", ask: &ask, until: None }, &mut bill).await.unwrap();
        bill.tokens_out
    };
    assert_eq!(puppet.clone()(30_000).await, 30_000);
    assert_eq!(puppet(u32::MAX).await, 10_000_000);
    // Sums stay whole, whatever is in the books already.
    let (llm, _) = Puppet::llm(config("http://127.0.0.1:1"), Duration::ZERO, [Ok(reply("well"))]);
    llm.restore("r", u64::MAX, 0.0, 0);
    asks(&llm, "r").await.unwrap();
    assert_eq!(llm.spent("r"), Spent { tokens: u64::MAX, cost: 0.0 });
}

#[tokio::test]
async fn an_answer_that_makes_no_sense_costs_what_it_says() {
    let usage = json!({"prompt_tokens": 300, "completion_tokens": 90});
    let paid = |usage: Value| json!({"choices": [{"message": {"refusal": "no"}}], "usage": usage});
    for (body, tokens) in [
        (paid(usage.clone()), (300, 90)),
        (json!({"choices": [], "usage": usage}), (300, 90)),
        (json!({"choices": null, "usage": {"prompt_tokens": u64::MAX}}), (1_120, 0)),
        (paid(json!(null)), (12, 0)),
        (json!("what"), (12, 0)),
    ] {
        let server = endpoint([ResponseTemplate::new(200).set_body_json(body)]).await;
        let llm = Llm::new(config(&server.uri())).unwrap();
        let (error, bill) = billed(&llm, "r").await;
        assert_eq!((error.unwrap_err().word(), (bill.tokens_in, bill.tokens_out)), ("nonsense", tokens));
        assert_eq!(llm.spent("r").tokens, tokens.0 + tokens.1);
    }
}

/// What is judged before a call that fails is kept, with what that call came to.
#[tokio::test]
async fn a_failed_round_is_on_the_bill() {
    let mut design = good(1).remove(0);
    design["encounters"][0]["step"] = json!(99);
    let nonsense = json!({"choices": [], "usage": {"prompt_tokens": 300, "completion_tokens": 90}});
    let server = endpoint([says(&list(&[design])), ResponseTemplate::new(200).set_body_json(nonsense)]).await;
    let llm = Llm::new(config(&server.uri())).unwrap();
    let usage = super::design(&llm, 1).await.unwrap().usage;
    assert_eq!((usage.rounds, usage.tokens_in, usage.tokens_out), (1, 400, 140));
    assert_eq!(llm.spent("r").tokens, 540);
}

#[tokio::test(start_paused = true)]
async fn each_try_that_broke_off_costs_its_prompt() {
    let broke = || Err(LlmError::Broken { reason: "reset".to_owned() });
    let answers = || [broke(), broke(), Ok(reply("well"))];
    let (llm, _) = Puppet::llm(config("http://127.0.0.1:1"), Duration::ZERO, answers());
    let (reply, bill) = billed(&llm, "r").await;
    assert!(reply.is_ok());
    assert_eq!((bill.tokens_in, bill.tokens_out), (124, 50));
    assert_eq!(llm.spent("r").tokens, 174);
    // A budget that pays for two tries (12 + 100 are set aside each time) is not overdrawn by a third.
    let config = LlmConfig { tokens_per_run: Some(130), max_tokens: 100, ..config("http://127.0.0.1:1") };
    let (llm, asked) = Puppet::llm(config, Duration::ZERO, answers());
    assert_eq!(asks(&llm, "r").await.unwrap_err(), LlmError::Broken { reason: "reset".to_owned() });
    assert_eq!((*asked.lock().unwrap(), llm.spent("r").tokens), (2, 24));
}
