//! The thread that takes leases ahead.

use std::time::{Duration, Instant};

use serde_json::{Value, json};

use super::lease::Episodes;
use super::link::{Failure, Link};
use super::stock::Shared;

/// How long to wait before asking again, where the server does not say.
const PAUSE: Duration = Duration::from_secs(1);
/// How often a thread that has nothing to do looks up.
const LOOK: Duration = Duration::from_secs(5);

/// What leases are asked for.
#[derive(Debug, Clone)]
pub(super) struct Wish {
    pub(super) run: String,
    pub(super) columns: bool,
    pub(super) groups: u32,
    /// Groups of a lease that is not of columns, where the run's strategy comes not to go with them.
    pub(super) otherwise: Option<u32>,
    pub(super) group_size: Option<u32>,
    pub(super) purpose: String,
    pub(super) evaluation: Option<String>,
    pub(super) ttl: Duration,
}

impl Wish {
    fn body(&self, version: u32) -> Value {
        let mut body = json!({
            "groups": self.groups, "policy_version": version, "ttl_s": self.ttl.as_secs(), "purpose": self.purpose,
            "form": if self.columns { "columns" } else { "groups" },
        });
        if let Some(size) = self.group_size {
            body["group_size"] = size.into();
        }
        if let Some(evaluation) = &self.evaluation {
            body["evaluation"] = evaluation.as_str().into();
        }
        body
    }

    /// Takes a lease.
    pub(super) fn take(&self, link: &Link, version: u32) -> Result<Episodes, Failure> {
        let granted = link.post(&format!("/v1/runs/{}/leases", self.run), &self.body(version))?;
        Episodes::read(granted, self.ttl, self.purpose == "eval").map_err(|why| Failure::Refused {
            status: 201,
            field: None,
            kind: None,
            why,
        })
    }
}

/// Keeps episodes ready until the curriculum is closed.
pub(super) fn fetch(shared: &Shared, link: &Link, wish: &Wish) {
    let mut wish = wish.clone();
    loop {
        let version = {
            let mut stock = shared.lock();
            while !stock.closing
                && (stock.ready() >= stock.wanted || stock.fault.is_some() || stock.exhausted)
            {
                stock = shared.wait(stock, LOOK);
            }
            if stock.closing {
                return;
            }
            stock.asking = true;
            stock.version
        };
        let taken = wish.take(link, version);
        let mut stock = shared.lock();
        stock.asking = false;
        shared.tell(); // whoever closes waits for this
        match taken {
            Ok(episodes) if episodes.left == 0 => stock.exhausted = true,
            Ok(episodes) => {
                stock.answered();
                stock.paused = None;
                stock.add(episodes);
                if stock.closing {
                    // It came too late to be flown, and is given back with the others.
                    stock.give_up();
                }
            }
            // A run that is paused is one that goes on some time.
            Err(Failure::Refused { status: 409, why, .. }) => {
                stock.answered();
                stock.paused = Some(why);
                drop(stock);
                pause(shared, PAUSE);
            }
            // A run's strategy may change while it goes on.
            Err(Failure::Refused { field: Some(field), .. })
                if field == "form"
                    && wish.columns
                    && let Some(groups) = wish.otherwise =>
            {
                (wish.columns, wish.groups) = (false, groups);
            }
            // An evaluation of which nothing is left is flown, once what is leased is; all of that is begun here, or elsewhere.
            Err(Failure::Refused { field: Some(field), .. })
                if field == "evaluation" && stock.tally.leases > 0 =>
            {
                stock.exhausted = true;
            }
            Err(Failure::Refused { status, why, .. }) => {
                stock.fault = Some(format!("the server refuses leases ({status}): {why}"));
            }
            Err(Failure::Away { why, after, .. }) => {
                stock.paused = None; // nobody knows whether it still is
                stock.away.get_or_insert((Instant::now(), why));
                drop(stock);
                pause(shared, after.unwrap_or(PAUSE));
            }
        }
    }
}

/// Waits, but no longer than until the curriculum is closed.
pub(super) fn pause(shared: &Shared, most: Duration) {
    let until = Instant::now() + most;
    let mut stock = shared.lock();
    while !stock.closing && Instant::now() < until {
        stock = shared.wait(stock, until.saturating_duration_since(Instant::now()));
    }
}
