//! [`AccessControl`]: decides whether a client may use an operation.

use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;

use axum::RequestExt;
use axum::extract::{RawPathParams, Request};
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, Uri, header};
use sqlx::SqlitePool;
use store::role::Role;
use store::token_cache::{TokenCache, ValidToken};
use store::tokens::{self, TokenRow, TokenState};

use super::super::problem::Problem;
use super::Caller;
use super::cross_site::check_cross_site;
use super::loopback::check_loopback;
use super::permissions::{Operation, Permission};
use crate::engine::access_log::TouchToken;
use crate::engine::writer::Writer;
use crate::limits::constants::{
    AUDITED_DENIALS_PER_SECOND, AUDITED_DENIALS_PER_SECOND_AND_ADDRESS, TOKEN_LOOKUPS_PER_SECOND,
};
use crate::limits::{ClientLimits, RateLimit};
use crate::ownership::{self, Actor};
use crate::sessions::ClientIdentity;
use crate::tokens::Token;
use clock::{Clock, Millis};

/// Time for which a token is cached. A revoked token may be used for so long.
const TOKEN_CACHE_TTL: Duration = Duration::from_secs(5);
/// Maximum number of cached tokens.
const MAX_CACHED_TOKENS: u64 = 10_000;
/// Minimum time between two updates of a token's last use, in milliseconds.
const TOUCH_INTERVAL_MS: Millis = 10 * 60 * 1000;

/// Configuration and dependencies of [`AccessControl`].
#[derive(Debug)]
pub struct AccessConfig {
    /// Read-only connections to the database.
    pub readers: SqlitePool,
    /// Handle of the database's only writer.
    pub writer: Writer,
    /// Source of the current time.
    pub clock: Clock,
    /// Address that the server listens on.
    pub bind: SocketAddr,
    /// True if OpenEnv's routes need no token.
    pub openenv_public: bool,
    /// Limits for each client.
    pub limits: ClientLimits,
    /// Hash of the only token that is admitted, if this service belongs to one process.
    pub process_token: Option<blake3::Hash>,
}

/// Decides whether a client may use an operation.
#[derive(Debug)]
pub struct AccessControl {
    readers: SqlitePool,
    pub(super) writer: Writer,
    pub(super) clock: Clock,
    /// True if only this machine can reach the server.
    is_loopback: bool,
    /// True if OpenEnv's routes need no token.
    openenv_public: bool,
    token_cache: TokenCache,
    token_rate: RateLimit,
    address_rate: RateLimit,
    /// Limit on database lookups of unknown tokens, so that a client that guesses tokens does not slow down others.
    lookup_rate: RateLimit,
    /// Limit on audited denials of each address, so that a persistent client does not fill the audit log.
    denial_rate: RateLimit,
    /// Limit on audited denials of all addresses together.
    total_denial_rate: RateLimit,
    /// Hash of the only token that is admitted, if this service belongs to one process.
    process_token: Option<blake3::Hash>,
}

/// Reason why a client was denied access.
pub(super) struct AccessDenied {
    pub(super) problem: Problem,
    /// Id of the client's token, if it is valid but not sufficient.
    pub(super) token: Option<i64>,
}

impl From<Problem> for AccessDenied {
    fn from(problem: Problem) -> Self {
        Self { problem, token: None }
    }
}

impl AccessControl {
    /// Creates access control with empty caches.
    #[must_use]
    pub fn new(config: AccessConfig) -> Self {
        let AccessConfig { readers, writer, clock, bind, openenv_public, limits, process_token } = config;
        Self {
            readers,
            writer,
            clock,
            is_loopback: bind.ip().is_loopback(),
            openenv_public,
            token_cache: TokenCache::new(MAX_CACHED_TOKENS, TOKEN_CACHE_TTL),
            token_rate: RateLimit::new(limits.requests),
            address_rate: RateLimit::new(limits.anonymous),
            lookup_rate: RateLimit::new(TOKEN_LOOKUPS_PER_SECOND),
            denial_rate: RateLimit::new(AUDITED_DENIALS_PER_SECOND_AND_ADDRESS),
            total_denial_rate: RateLimit::new(AUDITED_DENIALS_PER_SECOND),
            process_token,
        }
    }

    /// Identifies the client of a request and checks its permission and rate.
    pub(super) async fn admit(
        &self,
        permission: Permission,
        method: &Method,
        headers: &HeaderMap,
        uri: &Uri,
        peer: Option<IpAddr>,
    ) -> Result<Caller, AccessDenied> {
        check_cross_site(method, headers)?;
        if let Some(expected) = &self.process_token {
            let sent = headers.get(header::AUTHORIZATION).and_then(parse_token);
            let is_own = sent.is_some_and(|token| token.hash() == *expected);
            return if is_own {
                Ok(Caller { identity: ClientIdentity::local(), role: None })
            } else {
                Err(unauthenticated("this server accepts only the command that started it").into())
            };
        }
        let address = address_key(peer);
        if permission == Permission::Public {
            return Ok(anonymous(address));
        }
        if let Some(authorization) = headers.get(header::AUTHORIZATION) {
            return self.admit_token(permission, authorization, &address).await;
        }
        if self.is_loopback && !self.openenv_public && !self.tokens_exist().await? {
            check_loopback(headers, uri)?;
            return Ok(Caller { identity: ClientIdentity::local(), role: None });
        }
        self.address_rate.check(&address).map_err(Problem::from)?;
        match permission {
            Permission::OpenEnv(_) if self.openenv_public => Ok(anonymous(address)),
            _ => Err(unauthenticated(
                "the request needs a token: `Authorization: Bearer sparring_…`; create one with `sparring token create`",
            )
            .into()),
        }
    }

    /// Checks that a client has the permission for the run in the path of its request, if the operation requires one.
    pub(super) async fn check_run(
        &self,
        permission: Permission,
        caller: &Caller,
        request: &mut Request,
    ) -> Result<(), AccessDenied> {
        let Permission::Run(required) = permission else { return Ok(()) };
        if caller.actor().is_admin() {
            return Ok(());
        }
        // The handler rejects an invalid id and an unknown run.
        let params = request.extract_parts::<RawPathParams>().await.ok();
        let run =
            params.iter().flatten().find(|(name, _)| *name == "run").and_then(|(_, id)| id.parse().ok());
        let Some(run) = run else { return Ok(()) };
        let mut conn = self.readers.acquire().await.map_err(Problem::from)?;
        let checked = ownership::check_run(&mut conn, caller.actor(), &run, required).await;
        checked.map_err(|error| AccessDenied { problem: error.into(), token: caller.identity.token })
    }

    /// Identifies a client by its token and checks its role and rate.
    async fn admit_token(
        &self,
        permission: Permission,
        authorization: &HeaderValue,
        address: &Arc<str>,
    ) -> Result<Caller, AccessDenied> {
        let Some(token) = self.find_token(authorization, address).await? else {
            self.address_rate.check(address).map_err(Problem::from)?;
            return Err(unauthenticated(
                "the token is unknown, expired or revoked; `sparring token list` shows the valid ones",
            )
            .into());
        };
        let denied = |problem| AccessDenied { problem, token: Some(token.id) };
        let name: Arc<str> = format!("token {}", token.id).into();
        self.token_rate.check(&name).map_err(|limited| denied(limited.into()))?;
        let is_open = self.openenv_public && matches!(permission, Permission::OpenEnv(_));
        let is_sufficient = is_open || permission.role().is_none_or(|role| token.role >= role);
        if !is_sufficient {
            return Err(denied(forbidden(permission, token.role)));
        }
        let may_use_runs = token.role >= Role::Trainer;
        let actor = match token.role {
            Role::Admin => Actor::Admin(token.principal),
            Role::Trainer | Role::Viewer => Actor::Principal(token.principal),
        };
        let identity = ClientIdentity { name: Some(name), actor, token: Some(token.id), may_use_runs };
        Ok(Caller { identity, role: Some(token.role) })
    }

    /// Returns true if the audit log records the request. Denials are recorded at a limited rate.
    pub(super) fn is_audited(
        &self,
        operation: Option<&Operation>,
        denial: Option<&Problem>,
        peer: Option<IpAddr>,
    ) -> bool {
        match denial {
            None => operation.is_some_and(|operation| operation.audited),
            Some(problem) => {
                problem.is_denial()
                    && self.denial_rate.check(&address_key(peer)).is_ok()
                    && self.total_denial_rate.check(&"all".into()).is_ok()
            }
        }
    }

    /// Returns true if the server has tokens, valid or not.
    async fn tokens_exist(&self) -> Result<bool, Problem> {
        if let Some(any) = self.token_cache.tokens_exist() {
            return Ok(any);
        }
        let any = tokens::presence(&mut *self.readers.acquire().await?, self.clock.now()).await?.any;
        self.token_cache.set_tokens_exist(any);
        Ok(any)
    }

    /// Returns the valid token of an `Authorization` header, if it has one.
    async fn find_token(
        &self,
        authorization: &HeaderValue,
        address: &Arc<str>,
    ) -> Result<Option<ValidToken>, Problem> {
        let Some(token) = parse_token(authorization) else { return Ok(None) };
        let hash = token.hash();
        let cached = match self.token_cache.get(hash.as_bytes()) {
            Some(cached) => cached,
            None => {
                self.lookup_rate.check(address)?;
                let row = tokens::get(&mut *self.readers.acquire().await?, token.id).await?;
                let valid = row.as_ref().and_then(|row| self.validate(&hash, row));
                self.token_cache.insert(*hash.as_bytes(), valid.clone());
                valid
            }
        };
        let now = self.clock.now();
        Ok(cached.filter(|token| token.expires_at.is_none_or(|at| at > now)))
    }

    /// Returns the token of a row if it is valid and has the hash, and updates its last use.
    fn validate(&self, hash: &blake3::Hash, row: &TokenRow) -> Option<ValidToken> {
        let stored = blake3::Hash::from_slice(&row.hash).ok()?;
        let now = self.clock.now();
        // `blake3::Hash` compares in constant time.
        if stored != *hash || row.state(now) != TokenState::Valid {
            return None;
        }
        if row.used_at.is_none_or(|used| now - used > TOUCH_INTERVAL_MS) {
            let (writer, id) = (self.writer.clone(), row.id);
            tokio::spawn(async move { writer.change(TouchToken(id)).await });
        }
        Some(ValidToken { id: row.id, principal: row.principal, role: row.role, expires_at: row.expires_at })
    }
}

/// Returns the token of an `Authorization` header, if it has one.
fn parse_token(authorization: &HeaderValue) -> Option<Token> {
    let (scheme, text) = authorization.to_str().ok()?.split_once(' ')?;
    Token::parse(text.trim()).filter(|_| scheme.eq_ignore_ascii_case("bearer"))
}

/// Returns the caller of a request without a token.
fn anonymous(address: Arc<str>) -> Caller {
    let name = Some(address);
    let identity = ClientIdentity { name, actor: Actor::Anonymous, token: None, may_use_runs: false };
    Caller { identity, role: None }
}

/// Returns the key by which an address is limited.
fn address_key(peer: Option<IpAddr>) -> Arc<str> {
    match peer.map(|ip| ip.to_canonical()) {
        None => "nowhere".into(),
        Some(IpAddr::V4(ip)) => ip.to_string().into(),
        // A client with one IPv6 address usually has all addresses of its /64 network.
        Some(IpAddr::V6(ip)) => {
            let [a, b, c, d, ..] = ip.segments();
            format!("{a:x}:{b:x}:{c:x}:{d:x}::/64").into()
        }
    }
}

fn unauthenticated(detail: &str) -> Problem {
    Problem::new(StatusCode::UNAUTHORIZED, "unauthenticated", detail)
}

fn forbidden(permission: Permission, role: Role) -> Problem {
    let Some(required) = permission.role() else { return Problem::internal() };
    let detail =
        format!("the operation needs a token with the role {required}; this token has the role {role}");
    Problem::new(StatusCode::FORBIDDEN, "forbidden", detail)
}
