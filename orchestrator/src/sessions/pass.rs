//! How long whoever holds a connection may: until the service stops, or the token it came in by is worth nothing any more.

use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use tokio::sync::watch;

/// Why a connection is ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// The service stops.
    Stopping,
    /// The token was revoked, or expired.
    Expelled,
}

impl Ending {
    /// In words, for whoever is at the other end.
    #[must_use]
    pub const fn words(self) -> &'static str {
        match self {
            Self::Stopping => "the server is stopping",
            Self::Expelled => "the token was revoked, or expired",
        }
    }
}

/// The tokens by which connections that last came in.
#[derive(Debug, Default)]
pub struct Passes(Mutex<HashMap<i64, watch::Sender<bool>>>);

impl Passes {
    fn hold(&self) -> MutexGuard<'_, HashMap<i64, watch::Sender<bool>>> {
        // Nothing that holds it can panic; if something did, the map is still a map.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn of(&self, token: i64) -> watch::Receiver<bool> {
        self.hold().entry(token).or_default().subscribe()
    }

    /// The tokens that connections hold; those that none holds are forgotten.
    #[must_use]
    pub fn held(&self) -> Vec<i64> {
        let mut passes = self.hold();
        passes.retain(|_, pass| pass.receiver_count() > 0);
        passes.keys().copied().collect()
    }

    /// Ends every connection that came in by this token.
    pub fn end(&self, token: i64) {
        if let Some(pass) = self.hold().get(&token) {
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
    pub(super) fn new(stop: watch::Receiver<bool>, passes: &Passes, token: Option<i64>) -> Self {
        Self { stop, pass: token.map(|token| passes.of(token)) }
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
        let closing = |token| Closing::new(stop.subscribe(), &passes, token);
        let (mut one, mut two, mut nobody) = (closing(Some(1)), closing(Some(2)), closing(None));
        let mut held = passes.held();
        held.sort_unstable();
        assert_eq!(held, [1, 2]);
        passes.end(1);
        passes.end(3); // nobody has it
        assert_eq!(one.closed().await, Ending::Expelled);
        stop.send_replace(true);
        assert_eq!((two.closed().await, nobody.closed().await), (Ending::Stopping, Ending::Stopping));
        drop((one, two));
        assert!(passes.held().is_empty());
    }
}
