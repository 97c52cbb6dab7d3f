//! The `Date` header of responses.

use std::time::{Duration, SystemTime};

use axum::extract::{Request, State};
use axum::http::{HeaderValue, header};
use axum::middleware::Next;
use axum::response::Response;
use clock::{Clock, Millis};

/// Sets the `Date` header. The HTTP library caches its date until the system time passes it, so that its date would stay in the
/// future after the system time is set back.
pub(super) async fn set_date(State(clock): State<Clock>, request: Request, next: Next) -> Response {
    let mut response = next.run(request).await;
    if let Some(date) = http_date(clock.now()) {
        response.headers_mut().insert(header::DATE, date);
    }
    response
}

/// Formats a time (RFC 9110, section 5.6.7); `None` for a time that the format cannot represent.
fn http_date(now: Millis) -> Option<HeaderValue> {
    let seconds = u64::try_from(now / 1000).ok().filter(|seconds| *seconds < YEAR_10_000_S)?;
    let time = SystemTime::UNIX_EPOCH + Duration::from_secs(seconds);
    HeaderValue::from_str(&httpdate::fmt_http_date(time)).ok()
}

/// First second of the year 10000, whose number has too many digits.
const YEAR_10_000_S: u64 = 253_402_300_800;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn date_has_the_format_of_http() {
        assert_eq!(http_date(784_111_777_999).expect("a date"), "Sun, 06 Nov 1994 08:49:37 GMT");
        assert_eq!((http_date(-1000), http_date(Millis::MAX)), (None, None));
    }
}
