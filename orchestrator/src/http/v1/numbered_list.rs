//! Lists by number that are merged over all shards, newest first.

use api_types::MissingShard;
use axum::http::HeaderMap;
use serde::de::DeserializeOwned;
use store::shard::Shard;

use crate::http::problem::Problem;
use crate::http::state::AppState;
use crate::shards::merge::{MergedPage, NumberedItem, NumberedPage, ShardCursor, merge_numbered};
use crate::shards::{PeerParts, ShardPart};

/// Query of a list by number.
pub(super) struct NumberedQuery {
    /// Path of the list.
    pub(super) path: &'static str,
    /// Filters in the form of a query, each with a `&` at its end.
    pub(super) filters: String,
    /// Largest number of items of a page.
    pub(super) limit: i64,
    /// Cursor of the request.
    pub(super) cursor: ShardCursor,
}

/// Page of the lists of all shards.
pub(super) struct ShardedList<T> {
    /// Items of the page.
    pub(super) merged: MergedPage<T>,
    /// Shards without an answer.
    pub(super) missing: Vec<MissingShard>,
}

/// Parses the cursor of a merged list.
///
/// # Errors
/// Returns a problem with status 422 if the text is no cursor.
pub(super) fn parse_shard_cursor(text: Option<&str>) -> Result<ShardCursor, Problem> {
    let malformed = || Problem::invalid("cursor", "must be the `next` of a previous page");
    ShardCursor::parse(text).ok_or_else(malformed)
}

/// Returns the number before which the page of this server starts.
pub(super) fn own_number(app: &AppState, cursor: &ShardCursor) -> i64 {
    app.shards.own().and_then(|own| cursor.before(own)).unwrap_or(i64::MAX)
}

/// Merges a page of this server with those of its peers. `numbered` takes the items out of a page, and `is_longer` returns true if
/// a page is not the last one.
pub(super) async fn list_of_shards<P: DeserializeOwned, T>(
    app: &AppState,
    headers: &HeaderMap,
    query: NumberedQuery,
    own: P,
    mut numbered: impl FnMut(P) -> Vec<NumberedItem<T>>,
    is_longer: impl Fn(&P) -> bool,
) -> ShardedList<T> {
    let NumberedQuery { path, filters, limit, cursor } = query;
    let path_of = |shard: &Shard| {
        let before = cursor.before(shard).map(|number| format!("&cursor={number}."));
        format!("{path}?{filters}limit={limit}{}", before.unwrap_or_default())
    };
    let PeerParts { mut parts, missing } = app.shards.ask::<P>(headers, path_of).await;
    if let Some(shard) = app.shards.own() {
        parts.insert(0, ShardPart { shard: shard.clone(), part: own });
    }
    let pages = parts.into_iter().map(|ShardPart { shard, part }| {
        let has_more = is_longer(&part);
        NumberedPage { shard, items: numbered(part), has_more }
    });
    let merged = merge_numbered(pages.collect(), cursor, usize::try_from(limit).unwrap_or_default());
    ShardedList { merged, missing }
}
