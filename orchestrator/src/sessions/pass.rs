//! How long whoever holds a connection may: until the service stops, or the token it came in by is worth nothing any more.

use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use tokio::sync::watch;

/// Why a connection is ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// The service stops.
    Stopping,
    /// The token was revoked, or expired; or there was none, and now one is needed.
    Expelled,
}

impl Ending {
    /// In words, for whoever is at the other end.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::Stopping => "the server is stopping",
            Self::Expelled => {
                "the token was revoked or expired, or there are tokens now and this came in without"
            }
        }
    }
}

/// By what a connection came in: a token's number, or none where nobody needed one.
pub type Pass = Option<i64>;

/// By what connections that last came in.
#[derive(Debug, Default)]
pub struct Passes(Mutex<HashMap<Pass, watch::Sender<bool>>>);

impl Passes {
    fn hold(&self) -> MutexGuard<'_, HashMap<Pass, watch::Sender<bool>>> {
        // Nothing that holds it can panic; if something did, the map is still a map.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn of(&self, pass: Pass) -> watch::Receiver<bool> {
        self.hold().entry(pass).or_default().subscribe()
    }

    /// What connections hold; what none holds is forgotten.
    #[must_use]
    pub fn held(&self) -> Vec<Pass> {
        let mut passes = self.hold();
        passes.retain(|_, pass| pass.receiver_count() > 0);
        passes.keys().copied().collect()
    }

    /// Ends every connection that came in by this.
    pub fn end(&self, pass: Pass) {
        if let Some(pass) = self.hold().get(&pass) {
            pass.send_replace(true);
        }
    }
}

/// Tells whoever serves a connection that it is to end.
#[derive(Debug)]
pub struct Closing {
    stop: watch::Receiver<bool>,
    pass: Option<watch::Receiver<bool>>,
}

impl Closing {
    /// `pass` is none for whoever may come in without a token whether there are any or not.
    pub(super) fn new(stop: watch::Receiver<bool>, passes: &Passes, pass: Option<Pass>) -> Self {
        Self { stop, pass: pass.map(|pass| passes.of(pass)) }
    }

    /// Whether it is to end already; why. To be asked by whoever has always something to do and never waits.
    #[must_use]
    pub fn over(&self) -> Option<Ending> {
        let expelled = self.pass.as_ref().is_some_and(|pass| *pass.borrow());
        let stopping = *self.stop.borrow();
        stopping.then_some(Ending::Stopping).or(expelled.then_some(Ending::Expelled))
    }

    /// Waits until it is; why.
    pub async fn closed(&mut self) -> Ending {
        let Self { stop, pass } = self;
        let expelled = async {
            match pass {
                // A sender that goes away goes with the service.
                Some(pass) => drop(pass.wait_for(|ended| *ended).await),
                None => std::future::pending().await,
            }
        };
        tokio::select! {
            biased;
            _ = stop.wait_for(|closing| *closing) => Ending::Stopping,
            () = expelled => Ending::Expelled,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn the_connections_of_a_token_end_with_it_and_no_others() {
        let (stop, passes) = (watch::Sender::new(false), Passes::default());
        let closing = |pass| Closing::new(stop.subscribe(), &passes, pass);
        let (mut one, mut two) = (closing(Some(Some(1))), closing(Some(Some(2))));
        let (mut without, mut always) = (closing(Some(None)), closing(None));
        let mut held = passes.held();
        held.sort_unstable();
        assert_eq!(held, [None, Some(1), Some(2)]);
        passes.end(Some(1));
        passes.end(Some(3)); // nobody has it
        assert_eq!((one.over(), one.closed().await), (Some(Ending::Expelled), Ending::Expelled));
        assert_eq!((two.over(), without.over(), always.over()), (None, None, None));
        passes.end(None);
        assert_eq!(without.closed().await, Ending::Expelled);
        stop.send_replace(true);
        assert_eq!((two.closed().await, always.closed().await), (Ending::Stopping, Ending::Stopping));
        drop((one, two, without));
        assert!(passes.held().is_empty());
    }
}
