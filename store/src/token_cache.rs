//! Cache of the table `tokens`, so that a request does not read the database for its token.

use std::time::Duration;

use moka::sync::Cache;

use crate::Millis;
use crate::principals::PrincipalId;
use crate::role::Role;

/// Valid token of a client.
#[derive(Debug, Clone)]
pub struct ValidToken {
    /// Number of the token, from 1.
    pub id: i64,
    /// Principal that the token acts for.
    pub principal: PrincipalId,
    /// Role that limits what the token may do.
    pub role: Role,
    /// When the token expires; none for never.
    pub expires_at: Option<Millis>,
}

/// Result of lookups in the table `tokens`, for a limited time.
#[derive(Debug)]
pub struct TokenCache {
    /// Tokens by hash; `None` for an invalid token.
    tokens: Cache<[u8; 32], Option<ValidToken>>,
    /// True if the table has tokens, valid or not; empty if unknown.
    tokens_exist: Cache<(), bool>,
}

impl TokenCache {
    /// Creates an empty cache of at most `max_tokens` tokens, each of which is forgotten after `ttl`.
    #[must_use]
    pub fn new(max_tokens: u64, ttl: Duration) -> Self {
        Self {
            tokens: Cache::builder().max_capacity(max_tokens).time_to_live(ttl).build(),
            tokens_exist: Cache::builder().max_capacity(1).time_to_live(ttl).build(),
        }
    }

    /// Returns the cached lookup of a hash: the token, or `Some(None)` for an invalid one.
    #[must_use]
    pub fn get(&self, hash: &[u8; 32]) -> Option<Option<ValidToken>> {
        self.tokens.get(hash)
    }

    /// Caches the lookup of a hash; `None` is an invalid token.
    pub fn insert(&self, hash: [u8; 32], token: Option<ValidToken>) {
        self.tokens.insert(hash, token);
    }

    /// Returns true if the table has tokens, or `None` if that is unknown.
    #[must_use]
    pub fn tokens_exist(&self) -> Option<bool> {
        self.tokens_exist.get(&())
    }

    /// Caches whether the table has tokens.
    pub fn set_tokens_exist(&self, exist: bool) {
        self.tokens_exist.insert((), exist);
    }
}
