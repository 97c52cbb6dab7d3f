//! Sessions that outlast their connection: where it drops they wait for who comes back.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use axum::body::Bytes;
use tokio::sync::{OwnedMutexGuard, watch};

use super::{Closing, Session, Vector, Who, Wish};

/// How often a session that is silent looks whether its lease has to be renewed: leases of a second are.
pub const LOOK: Duration = Duration::from_millis(300);

/// What a client steps by.
#[derive(Debug)]
pub enum Craft {
    /// One environment, by text.
    Single(Box<Single>),
    /// Many, by binary frames.
    Vector(Box<Vector>),
}

/// One environment that is stepped by numbered messages.
#[derive(Debug)]
pub struct Single {
    /// The environment.
    pub session: Session,
    /// What was asked for last.
    pub wish: Wish,
    /// The last message that moved anything, and its answer.
    pub last: Option<(u64, Bytes)>,
}

impl Craft {
    /// What it is called: who knows it may come back to it.
    #[must_use]
    pub fn token(&self) -> &str {
        match self {
            Self::Single(single) => single.session.id(),
            Self::Vector(vector) => vector.token(),
        }
    }

    /// Renews its lease where a third of its time is over.
    pub async fn renew(&mut self) {
        match self {
            Self::Single(single) => single.session.renew().await,
            Self::Vector(vector) => vector.renew().await,
        }
    }
}

/// Where a session lies, held by the connection that serves it.
#[derive(Debug)]
struct Berth {
    /// None once it is over.
    craft: Arc<tokio::sync::Mutex<Option<Craft>>>,
    /// Counts who came for it: the last one has it.
    claims: watch::Sender<u64>,
    /// Whose it is: nobody else comes back to it.
    owner: Who,
}

/// All sessions that may be come back to.
#[derive(Debug, Default)]
pub struct Berths(Arc<Mutex<HashMap<String, Arc<Berth>>>>);

/// Why a session cannot be come back to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Lost {
    /// There is none of this name.
    #[error("there is no such session: it was never opened, or it ended")]
    Unknown,
    /// Another connection came for it at the same time, and later.
    #[error("another connection resumed this session")]
    Superseded,
}

fn hold(all: &Mutex<HashMap<String, Arc<Berth>>>) -> MutexGuard<'_, HashMap<String, Arc<Berth>>> {
    // Nothing that holds it can panic; if something did, the map is still a map.
    all.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The hold of one connection on a session. Let go, the session ends, unless another has come for it.
#[derive(Debug)]
pub struct Mooring {
    all: Arc<Mutex<HashMap<String, Arc<Berth>>>>,
    berth: Arc<Berth>,
    craft: OwnedMutexGuard<Option<Craft>>,
    claim: watch::Receiver<u64>,
    mine: u64,
}

impl Berths {
    /// Gives a session that was just opened its place.
    #[must_use]
    pub fn moor(&self, craft: Craft, owner: &Who) -> Option<Mooring> {
        let token = craft.token().to_owned();
        let berth = Arc::new(Berth {
            craft: Arc::new(tokio::sync::Mutex::new(Some(craft))),
            claims: watch::Sender::new(0),
            owner: owner.clone(),
        });
        // Nobody else knows it yet.
        let guard = Arc::clone(&berth.craft).try_lock_owned().ok()?;
        hold(&self.0).insert(token, Arc::clone(&berth));
        let claim = berth.claims.subscribe();
        Some(Mooring { all: Arc::clone(&self.0), berth, craft: guard, claim, mine: 0 })
    }

    /// Takes a session over. Who served it until now is told and lets go, once what it does is done. To be waited for to the
    /// end: nobody else looks after the session then.
    ///
    /// # Errors
    /// No such session of theirs, or another that came later.
    pub async fn claim(&self, token: &str, who: &Who) -> Result<Mooring, Lost> {
        let berth = hold(&self.0).get(token).filter(|berth| berth.owner == *who).cloned();
        let berth = berth.ok_or(Lost::Unknown)?;
        let mut mine = 0;
        berth.claims.send_modify(|claims| {
            *claims += 1;
            mine = *claims;
        });
        let claim = berth.claims.subscribe();
        let craft = Arc::clone(&berth.craft).lock_owned().await;
        if craft.is_none() {
            return Err(Lost::Unknown);
        }
        if *claim.borrow() != mine {
            return Err(Lost::Superseded);
        }
        Ok(Mooring { all: Arc::clone(&self.0), berth, craft, claim, mine })
    }
}

impl Mooring {
    /// The session; none once it is over.
    pub fn craft(&mut self) -> Option<&mut Craft> {
        self.craft.as_mut()
    }

    /// Whether another connection has come for it.
    #[must_use]
    pub fn is_superseded(&self) -> bool {
        *self.claim.borrow() != self.mine
    }

    /// Waits until another connection takes the session over.
    pub async fn superseded(&mut self) {
        let mine = self.mine;
        // It holds the sender itself, which thus does not go away.
        drop(self.claim.wait_for(|claims| *claims != mine).await);
    }

    /// Waits for who comes back, and ends the session where nobody does.
    pub async fn wait(mut self, stay: Duration, mut closing: Closing) {
        let over = tokio::time::sleep(stay);
        tokio::pin!(over);
        loop {
            tokio::select! {
                () = self.superseded() => return,
                _ = closing.closed() => return,
                () = &mut over => return,
                () = tokio::time::sleep(LOOK) => {
                    if let Some(craft) = self.craft() {
                        craft.renew().await;
                    }
                }
            }
        }
    }
}

impl Drop for Mooring {
    fn drop(&mut self) {
        if self.is_superseded() {
            return;
        }
        // Who claims it from here on finds nothing.
        if let Some(craft) = self.craft.take() {
            let mut all = hold(&self.all);
            if all.get(craft.token()).is_some_and(|berth| Arc::ptr_eq(berth, &self.berth)) {
                all.remove(craft.token());
            }
        }
    }
}
