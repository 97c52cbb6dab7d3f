//! The thread that hands in what was flown, and keeps leases from running out meanwhile.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use env_core::batch::book::Tape;
use serde_json::{Value, json};

use super::fetch::pause;
use super::lease::Lease;
use super::link::{Failure, Link};
use super::stock::{Ledger, Parcel, Shared, Tally};

/// How long to wait before sending the same again, where the server does not say.
const PAUSE: Duration = Duration::from_secs(1);
/// How often a thread that has nothing to do looks up.
const LOOK: Duration = Duration::from_secs(1);
/// The server's word for a lease that ran out before what was flown of it came.
const LEASE_OVER: &str = "lease_over";
/// Results that are sent together, at most, and numbers in them.
const RESULTS: usize = 256;
const NUMBERS: usize = 400_000;

/// Hands in until the curriculum is closed and all is told.
pub(super) fn report(shared: &Shared, link: &Link, run: &str) {
    let mut looked = Instant::now();
    loop {
        let parcels = {
            let mut stock = shared.lock();
            while stock.outbox.is_empty()
                && (!stock.closing || stock.asking)
                && looked.elapsed() < renewal(&stock.active())
            {
                stock = shared.wait(stock, LOOK);
            }
            if stock.outbox.is_empty() && stock.closing && !stock.asking {
                stock.ended = true;
                shared.tell();
                return;
            }
            let parcels = next(&mut stock.outbox);
            stock.sending = !parcels.is_empty();
            parcels
        };
        let active = shared.lock().active();
        if looked.elapsed() >= renewal(&active) {
            looked = Instant::now();
            for lease in active {
                // One that cannot be renewed runs out, and what is handed in of it then says so.
                let _ = link.post(&format!("/v1/runs/{run}/leases/{}/renew", lease.id), &json!({}));
            }
        }
        if parcels.is_empty() {
            continue;
        }
        let count: usize = parcels.iter().map(Parcel::episodes).sum();
        let told = send(shared, link, run, &parcels);
        let mut stock = shared.lock();
        stock.sending = false;
        stock.waiting = stock.waiting.saturating_sub(count);
        for parcel in &parcels {
            if let Parcel::Result { episode, .. } = parcel {
                stock.told(&episode.lease);
            }
        }
        if stock.abandoned && !matches!(told, Err(Untold::Abandoned(_))) {
            // Whoever closed did not wait for it, and it was told after all.
            stock.tally.lost = stock.tally.lost.saturating_sub(count as u64);
        }
        match told {
            Ok(None) => {}
            // Whole logs of a lease that is over are told one by one; of columns none is taken.
            Err(Untold::Late) => stock.tally.late += count as u64,
            Err(Untold::Refused(why)) => {
                stock.tally.refused += count as u64;
                stock.fault = Some(why);
            }
            Ok(Some(why)) | Err(Untold::Abandoned(why)) => stock.fault = Some(why),
        }
        shared.tell();
    }
}

/// Half of the shortest time that any lease holds.
fn renewal(active: &[Arc<Lease>]) -> Duration {
    active.iter().map(|lease| lease.ttl / 2).min().unwrap_or(Duration::MAX)
}

/// What is sent next: results of several episodes together, or one of the others.
fn next(outbox: &mut std::collections::VecDeque<Parcel>) -> Vec<Parcel> {
    let (mut parcels, mut numbers) = (Vec::new(), 0);
    while let Some(parcel) = outbox.front() {
        let weight = match parcel {
            Parcel::Result { tape, .. } => tape.len(),
            Parcel::Columns(_) | Parcel::Release(_) if parcels.is_empty() => {
                return outbox.pop_front().into_iter().collect();
            }
            Parcel::Columns(_) | Parcel::Release(_) => break,
        };
        if parcels.len() == RESULTS || (numbers > 0 && numbers + weight > NUMBERS) {
            break;
        }
        numbers += weight;
        parcels.extend(outbox.pop_front());
    }
    parcels
}

/// Why something was not handed in.
enum Untold {
    /// Its lease was over.
    Late,
    /// The server does not take any of it: why.
    Refused(String),
    /// Nobody waits for it any more: why it took so long.
    Abandoned(String),
}

/// Sends it until it is told, or until nobody waits for that any more. Why the server refuses some of it, if it does.
fn send(shared: &Shared, link: &Link, run: &str, parcels: &[Parcel]) -> Result<Option<String>, Untold> {
    match parcels {
        [Parcel::Columns(ledger)] => claim(shared, link, run, ledger),
        [Parcel::Release(lease)] => {
            let path = format!("/v1/runs/{run}/leases/{}/release", lease.id);
            insist(shared, || link.post(&path, &json!({}))).map(|_| None)
        }
        _ => {
            let results = parcels.iter().filter_map(|parcel| match parcel {
                Parcel::Result { episode, tape, version } => Some(
                    json!({"episode": episode.name(), "actions": actions(tape), "policy_version": version}),
                ),
                _ => None,
            });
            let told = results_of(shared, link, run, &results.collect::<Vec<_>>())?;
            tally_up(&mut shared.lock().tally, &told.statuses);
            Ok(told.refused)
        }
    }
}

/// The same again until it is answered, or refused for good.
fn insist(shared: &Shared, ask: impl Fn() -> Result<Value, Failure>) -> Result<Value, Untold> {
    loop {
        match ask() {
            Ok(answer) => {
                shared.lock().answered();
                return Ok(answer);
            }
            Err(Failure::Refused { kind: Some(kind), .. }) if kind == LEASE_OVER => return Err(Untold::Late),
            Err(Failure::Refused { status, why, .. }) => {
                return Err(Untold::Refused(format!("the server refuses what was flown ({status}): {why}")));
            }
            Err(Failure::Away { why, after, .. }) => {
                let closing = {
                    let mut stock = shared.lock();
                    if stock.abandoned {
                        return Err(Untold::Abandoned(format!(
                            "what was flown could not be handed in: {why}"
                        )));
                    }
                    stock.away.get_or_insert((Instant::now(), why));
                    stock.closing
                };
                shared.tell();
                if closing {
                    std::thread::sleep(PAUSE / 5);
                } else {
                    pause(shared, after.unwrap_or(PAUSE));
                }
            }
        }
    }
}

/// An action log, without entries of those who do nothing.
fn actions(tape: &Tape) -> Value {
    let step = |step: &[f32]| -> Vec<Value> {
        let entries = step.chunks_exact(tape.action()).enumerate();
        let acted = entries.filter(|(_, values)| values.iter().any(|value| *value != 0.0));
        acted
            .map(|(agent, values)| {
                let values = values.iter().map(|value| json!(f64::from(*value)));
                Value::Array(std::iter::once(json!(agent)).chain(values).collect())
            })
            .collect()
    };
    json!({"steps": tape.rows().map(step).collect::<Vec<_>>(), "precision": "f32"})
}

/// What a server said to results.
struct Told {
    /// How many have which status.
    statuses: BTreeMap<String, u64>,
    /// Why the first of those was refused that were.
    refused: Option<String>,
}

fn results_of(shared: &Shared, link: &Link, run: &str, results: &[Value]) -> Result<Told, Untold> {
    let path = format!("/v1/runs/{run}/results");
    let body = json!({ "results": results });
    let answer = insist(shared, || link.post(&path, &body))?;
    let mut told = Told { statuses: BTreeMap::new(), refused: None };
    for result in answer["results"].as_array().into_iter().flatten() {
        let status = result["status"].as_str().unwrap_or_default();
        *told.statuses.entry(status.to_owned()).or_default() += 1;
        if matches!(status, "refused" | "conflict") {
            let why = result["detail"].as_str().unwrap_or(status);
            told.refused
                .get_or_insert_with(|| format!("the server refuses an episode that was flown: {why}"));
        }
    }
    Ok(told)
}

fn tally_up(tally: &mut Tally, statuses: &BTreeMap<String, u64>) {
    for (status, count) in statuses {
        match status.as_str() {
            "counted" => tally.counted += count,
            "stored" => tally.stored += count,
            "duplicate" => tally.duplicate += count,
            "late" => tally.late += count,
            "refused" | "conflict" => tally.refused += count,
            _ => {}
        }
    }
}

/// Claims a lease of columns and hands in what is audited of it.
fn claim(shared: &Shared, link: &Link, run: &str, ledger: &Ledger) -> Result<Option<String>, Untold> {
    let path = format!("/v1/runs/{run}/leases/{}/columns", ledger.lease.id);
    let of = |number: &dyn Fn(&super::stock::Line) -> f64| -> Vec<f64> {
        ledger.flown.iter().map(|line| line.as_ref().map_or(0.0, number)).collect()
    };
    let failed: Vec<u8> = ledger.flown.iter().map(|line| u8::from(line.is_none())).collect();
    let body = json!({
        "score": of(&|line| line.score),
        "steps": of(&|line| line.tape.steps() as f64).into_iter().map(|steps| steps as u64).collect::<Vec<_>>(),
        "failed": failed,
        "policy_version": ledger.version,
    });
    let claimed = insist(shared, || link.post(&path, &body))?;
    let mut due = Vec::new();
    for group in claimed["audit"].as_array().into_iter().flatten() {
        let entries = group["entries"].as_array().into_iter().flatten().filter_map(Value::as_u64);
        let names = group["episodes"].as_array().into_iter().flatten().filter_map(Value::as_str);
        for (entry, name) in entries.zip(names) {
            let line = usize::try_from(entry).ok().and_then(|entry| ledger.flown.get(entry)?.as_ref());
            if let Some(line) = line {
                due.push((name.to_owned(), &line.tape));
            }
        }
    }
    let mut due = due.into_iter().peekable();
    while due.peek().is_some() {
        let (mut batch, mut numbers) = (Vec::new(), 0);
        while let Some((name, tape)) = due
            .next_if(|(_, tape)| batch.len() < RESULTS && (numbers == 0 || numbers + tape.len() <= NUMBERS))
        {
            numbers += tape.len();
            batch.push(json!({"episode": name, "actions": actions(tape)}));
        }
        if let Some(why) = results_of(shared, link, run, &batch)?.refused {
            return Err(Untold::Refused(why));
        }
    }
    let state = insist(shared, || link.get(&path))?;
    let episodes = ledger.flown.iter().flatten().count() as u64;
    let mut stock = shared.lock();
    let tally = &mut stock.tally;
    match state["state"].as_str() {
        Some("accepted") => tally.accepted += episodes,
        Some("refused") => tally.refused += episodes,
        _ => tally.unproven += episodes,
    }
    Ok(None)
}
