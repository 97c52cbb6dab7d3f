//! Who comes in: tokens, roles, limits, and the audit log of what is changed by hand.

mod here;
mod limits;
mod table;

use std::net::{IpAddr, SocketAddr};
use std::num::NonZeroU32;
use std::sync::Arc;
use std::time::Duration;

use axum::body::HttpBody;
use axum::extract::{MatchedPath, Request, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, Uri, Version, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use moka::future::Cache;
use sqlx::SqlitePool;
use tracing::Instrument;

use self::here::from_here;
use self::limits::Rate;
use self::table::Operation;
pub(super) use self::table::{Needs, operation};
use super::connections::Peer;
use super::problem::Problem;
use crate::clock::{Clock, Millis};
use crate::sessions::ClientIdentity;
use crate::store::StoreError;
use crate::store::audit_log::AuditRow;
use crate::store::tokens::{self, TokenRow, TokenState};
use crate::tokens::{Role, Token, redact};
use crate::engine::access_log::{TouchToken, WriteAuditLine};
use crate::leases::create::OwnerQuota;
use crate::engine::error::ServiceError;
use crate::engine::writer::Writer;

/// How long what is known of a token is believed: so long a revoked one may still be used.
const BELIEVED: Duration = Duration::from_secs(5);
/// Tokens that are known at once.
const KNOWN: u64 = 10_000;
/// Tokens a second that are looked for in the database, of an address: each is then known for some seconds.
const LOOKUPS: NonZeroU32 = NonZeroU32::MIN.saturating_add(199);
/// Lines a second that the audit log has of who was kept out.
const DENIALS: NonZeroU32 = NonZeroU32::MIN.saturating_add(9);
/// How often it is tried to write a line of the audit log, and how long in between, where the writer has too much to do.
const TRIES: u32 = 10;
const PAUSE: Duration = Duration::from_millis(500);
/// A token's last use is noted so seldom.
const NOTED: Millis = 10 * 60 * 1000;

/// What each may do at most.
#[derive(Debug, Clone, Copy)]
pub struct Each {
    /// Requests a second of a token.
    pub requests: NonZeroU32,
    /// Requests a second of an address without one.
    pub anonymous: NonZeroU32,
    /// Runs that a token may create.
    pub runs: u32,
    /// Active leases that a token may have.
    pub leases: u32,
}

impl Default for Each {
    fn default() -> Self {
        const fn positive(n: u32) -> NonZeroU32 {
            NonZeroU32::MIN.saturating_add(n - 1)
        }
        Self { requests: positive(1000), anonymous: positive(50), runs: 1000, leases: 4096 }
    }
}

/// Who asks.
#[derive(Debug, Clone)]
pub(super) struct Caller {
    /// Their token or address, as sessions see them.
    pub(super) who: ClientIdentity,
}

impl Caller {
    /// As the owner of what they make.
    pub(super) fn owns(&self, max: u32) -> Option<OwnerQuota> {
        self.who.token.map(|token| OwnerQuota { token, max })
    }
}

/// Who is kept out, by what they are to be told.
struct Refused {
    problem: Problem,
    /// Their token, where it is one that is known and not enough.
    token: Option<i64>,
}

impl From<Problem> for Refused {
    fn from(problem: Problem) -> Self {
        Self { problem, token: None }
    }
}

/// What is known of a token.
#[derive(Debug, Clone)]
struct Known {
    id: i64,
    role: Role,
    expires_at: Option<Millis>,
}

/// Looks at everybody who comes in.
#[derive(Debug)]
pub struct Gate {
    readers: SqlitePool,
    writer: Writer,
    clock: Clock,
    /// Whether it is this machine alone that can come in.
    loopback: bool,
    /// Whether OpenEnv's routes are for anybody.
    openenv_public: bool,
    known: Cache<[u8; 32], Option<Known>>,
    /// Whether there are tokens.
    any: Cache<(), bool>,
    of_tokens: Rate,
    of_addresses: Rate,
    /// Looks at the database for tokens that are not known: whoever makes them up does not keep others from it.
    of_lookups: Rate,
    /// Lines of the audit log about who was kept out, of an address and of all: whoever tries without end does not fill it.
    of_denials: [Rate; 2],
}

impl Gate {
    /// A gate.
    #[must_use]
    pub fn new(
        (readers, writer, clock): (SqlitePool, Writer, Clock),
        bind: SocketAddr,
        openenv_public: bool,
        each: Each,
    ) -> Self {
        Self {
            readers,
            writer,
            clock,
            loopback: bind.ip().is_loopback(),
            openenv_public,
            known: Cache::builder().max_capacity(KNOWN).time_to_live(BELIEVED).build(),
            any: Cache::builder().max_capacity(1).time_to_live(BELIEVED).build(),
            of_tokens: Rate::new(each.requests),
            of_addresses: Rate::new(each.anonymous),
            of_lookups: Rate::new(LOOKUPS),
            of_denials: [Rate::new(NonZeroU32::MIN), Rate::new(DENIALS)],
        }
    }

    /// Who it is, if they may; what is to be answered otherwise.
    async fn admit(
        &self,
        needs: Needs,
        headers: &HeaderMap,
        uri: &Uri,
        peer: Option<IpAddr>,
    ) -> Result<Caller, Refused> {
        let address = Self::address(peer);
        let anonymous = |runs| Caller { who: ClientIdentity { name: Some(Arc::clone(&address)), token: None, may_use_runs: runs } };
        if needs == Needs::Nothing {
            return Ok(anonymous(false));
        }
        if let Some(shown) = headers.get(header::AUTHORIZATION) {
            let Some(known) = self.known(shown, &address).await? else {
                self.of_addresses.take(&address).map_err(Problem::too_often)?;
                return Err(not_known("the token is not known, expired or revoked").into());
            };
            let name: Arc<str> = format!("token {}", known.id).into();
            let token = Some(known.id);
            let refused = |problem| Refused { problem, token };
            self.of_tokens.take(&name).map_err(|seconds| refused(Problem::too_often(seconds)))?;
            let enough = match needs {
                Needs::Nothing => true,
                Needs::Token(role) => known.role >= role,
                Needs::OpenEnv(role) => self.openenv_public || known.role >= role,
            };
            if !enough {
                return Err(refused(not_enough(needs, known.role)));
            }
            return Ok(Caller { who: ClientIdentity { name: Some(name), token, may_use_runs: known.role >= Role::Trainer } });
        }
        match needs {
            _ if self.loopback && !self.openenv_public && !self.any().await? => {
                from_here(headers, uri)?;
                Ok(Caller { who: ClientIdentity::local() })
            }
            Needs::OpenEnv(_) if self.openenv_public => {
                self.of_addresses.take(&address).map_err(Problem::too_often)?;
                Ok(anonymous(false))
            }
            Needs::Nothing | Needs::OpenEnv(_) | Needs::Token(_) => {
                self.of_addresses.take(&address).map_err(Problem::too_often)?;
                Err(not_known(
                    "send a token: Authorization: Bearer sparring_…; `sparring token create` makes one",
                )
                .into())
            }
        }
    }

    /// Whether the audit log has a line of it.
    fn is_noted(
        &self,
        operation: Option<&Operation>,
        refused: Option<&Problem>,
        peer: Option<IpAddr>,
    ) -> bool {
        let [of_each, of_all] = &self.of_denials;
        match refused {
            None => operation.is_some_and(|operation| operation.audited),
            Some(problem) => {
                problem.is_denial()
                    && of_each.take(&Self::address(peer)).is_ok()
                    && of_all.take(&"all".into()).is_ok()
            }
        }
    }

    fn address(peer: Option<IpAddr>) -> Arc<str> {
        match peer.map(|ip| ip.to_canonical()) {
            None => "nowhere".into(),
            Some(IpAddr::V4(ip)) => ip.to_string().into(),
            // Whoever has one address of a network has all of them.
            Some(IpAddr::V6(ip)) => {
                let [a, b, c, d, ..] = ip.segments();
                format!("{a:x}:{b:x}:{c:x}:{d:x}::/64").into()
            }
        }
    }

    async fn any(&self) -> Result<bool, Problem> {
        if let Some(any) = self.any.get(&()).await {
            return Ok(any);
        }
        let any = tokens::presence(&mut *self.readers.acquire().await?, self.clock.now()).await?.any;
        self.any.insert((), any).await;
        Ok(any)
    }

    /// What is known of what was shown; none of what is no token, or worth nothing any more.
    async fn known(&self, shown: &HeaderValue, address: &Arc<str>) -> Result<Option<Known>, Problem> {
        let text = shown.to_str().ok().and_then(|text| text.split_once(' '));
        let Some((scheme, text)) = text else { return Ok(None) };
        let token = Token::parse(text.trim()).filter(|_| scheme.eq_ignore_ascii_case("bearer"));
        let Some(token) = token else { return Ok(None) };
        let hash = token.hash();
        let known = match self.known.get(hash.as_bytes()).await {
            Some(known) => known,
            None => {
                self.of_lookups.take(address).map_err(Problem::too_often)?;
                let row = tokens::get(&mut *self.readers.acquire().await?, token.id).await?;
                let known = row.as_ref().and_then(|row| self.matching(&hash, row)).transpose()?;
                self.known.insert(*hash.as_bytes(), known.clone()).await;
                known
            }
        };
        let now = self.clock.now();
        Ok(known.filter(|known| known.expires_at.is_none_or(|at| at > now)))
    }

    /// A token's row as what is known of it, where what was shown is that token.
    fn matching(&self, hash: &blake3::Hash, row: &TokenRow) -> Option<Result<Known, StoreError>> {
        let stored = blake3::Hash::from_slice(&row.hash).ok()?;
        let now = self.clock.now();
        // Two hashes are compared in constant time.
        if stored != *hash || row.state(now) != TokenState::Valid {
            return None;
        }
        if row.used_at.is_none_or(|used| now - used > NOTED) {
            let (writer, id) = (self.writer.clone(), row.id);
            tokio::spawn(async move { writer.change(TouchToken(id)).await });
        }
        Some(Ok(Known { id: row.id, role: row.role, expires_at: row.expires_at }))
    }
}

fn not_known(detail: &str) -> Problem {
    Problem::new(StatusCode::UNAUTHORIZED, "unauthenticated", detail)
}

fn not_enough(needs: Needs, role: Role) -> Problem {
    let (Needs::Token(needed) | Needs::OpenEnv(needed)) = needs else { return Problem::internal() };
    let detail = format!("this needs a token of the role {needed}; yours is {role}");
    Problem::new(StatusCode::FORBIDDEN, "forbidden", detail)
}

/// Lets in who may, and writes down what they change by hand.
pub(super) async fn gate(State(gate): State<Arc<Gate>>, mut request: Request, next: Next) -> Response {
    let path = request.extensions().get::<MatchedPath>().map(|path| path.as_str().to_owned());
    let Some(path) = path else { return next.run(request).await }; // there is nothing there
    let operation = operation(request.method(), &path);
    // What nobody wrote down is for those who may do everything; a method that is not there is refused by the route.
    let needs = operation.map_or(Needs::Token(Role::Admin), |operation| operation.needs);
    let peer = request.extensions().get::<Peer>().map(|Peer(address)| address.ip());
    let admitted = gate.admit(needs, request.headers(), request.uri(), peer).await;
    let (token, refused) = match admitted {
        Ok(caller) => {
            let token = caller.who.token;
            request.extensions_mut().insert(caller);
            (token, None)
        }
        Err(Refused { problem, token }) => (token, Some(problem)),
    };
    let line = gate.is_noted(operation, refused.as_ref(), peer).then(|| AuditRow {
        id: 0,
        at: gate.clock.now(),
        token,
        name: None,
        address: peer.map(|ip| ip.to_string()),
        operation: format!("{} {path}", request.method()),
        path: redact(request.uri().path()).chars().take(500).collect(),
        status: 0,
        request_id: request_id(request.headers()),
    });
    let denied = refused.is_some();
    let answered = async move {
        match refused {
            None => next.run(request).await,
            Some(problem) => unread(&request, problem.into_response()),
        }
    };
    let Some(line) = line else { return answered.await };
    // Whoever goes away before the answer leaves a line all the same.
    let noted = async move {
        let response = answered.await;
        let line = AuditRow { status: response.status().as_u16().into(), ..line };
        note(&gate.writer, WriteAuditLine { line, is_denied: denied }).await;
        response
    };
    let noted = tokio::spawn(noted.in_current_span()).await;
    noted.unwrap_or_else(|_| Problem::internal().into_response()) // it panicked: that is in the log
}

/// Writes a line of the audit log.
async fn note(writer: &Writer, note: WriteAuditLine) {
    let line = &note.line;
    tracing::info!(
        token = line.token,
        address = line.address,
        operation = line.operation,
        path = line.path,
        status = line.status,
        "Audited."
    );
    for _ in 0..TRIES {
        match writer.change(note.clone()).await {
            Ok(()) => return,
            Err(ServiceError::Busy) => tokio::time::sleep(PAUSE).await,
            Err(error) => {
                tracing::error!(error = %error, "A line of the audit log could not be written.");
                return;
            }
        }
    }
    tracing::error!("A line of the audit log could not be written: the writer has too much to do.");
}

/// An answer to a request whose body was not read: what follows it on the connection would be that.
fn unread(request: &Request, mut response: Response) -> Response {
    if request.version() <= Version::HTTP_11 && !request.body().is_end_stream() {
        response.headers_mut().insert(header::CONNECTION, HeaderValue::from_static("close"));
    }
    response
}

fn request_id(headers: &HeaderMap) -> String {
    let id = headers.get("x-request-id").and_then(|id| id.to_str().ok()).unwrap_or_default();
    id.chars().take(100).collect()
}
