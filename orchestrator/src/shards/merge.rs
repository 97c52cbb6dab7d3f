//! Joins the pages of several servers to one page. Lists by number are newest first, and numbers of servers are independent, so
//! that the cursor has one number for each shard.

use std::collections::BTreeMap;
use std::fmt;

use store::shard::Shard;

/// Item of a list by number.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct NumberedItem<T> {
    /// Time by which the lists of several servers are merged, RFC 3339.
    pub(crate) at: String,
    /// Number of the item in the database of its server, from 1.
    pub(crate) number: i64,
    /// Item in the form of the response.
    pub(crate) item: T,
}

/// Page of one server.
#[derive(Debug)]
pub(crate) struct NumberedPage<T> {
    /// Shard of the server.
    pub(crate) shard: Shard,
    /// Items of the page, newest first.
    pub(crate) items: Vec<NumberedItem<T>>,
    /// True if the server has older items.
    pub(crate) has_more: bool,
}

/// Page of all servers.
#[derive(Debug)]
pub(crate) struct MergedPage<T> {
    /// Items of the page, newest first.
    pub(crate) items: Vec<T>,
    /// Cursor of the next page; none on the last page.
    pub(crate) next: Option<String>,
}

/// Position in the lists of all servers: the number before which the next page of each shard starts, written
/// `shard.number,shard.number`. A shard that it does not name starts at its newest item. Number 0 is the end of a list.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct ShardCursor(BTreeMap<Shard, i64>);

impl ShardCursor {
    /// Largest number of shards of a cursor.
    const MAX_SHARDS: usize = 1000;

    /// Parses the cursor of a query; without one, all lists start at their newest items. Returns `None` if the text is no cursor.
    pub(crate) fn parse(text: Option<&str>) -> Option<Self> {
        let Some(text) = text else { return Some(Self::default()) };
        let mut numbers = BTreeMap::new();
        for part in text.split(',') {
            let (shard, number) = part.split_once('.')?;
            let number = number.parse().ok().filter(|number| *number >= 0)?;
            numbers.insert(shard.parse().ok()?, number);
        }
        (numbers.len() <= Self::MAX_SHARDS).then_some(Self(numbers))
    }

    /// Returns the number before which the page of a shard starts; `None` for the newest items.
    pub(crate) fn before(&self, shard: &Shard) -> Option<i64> {
        self.0.get(shard).copied()
    }
}

impl fmt::Display for ShardCursor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (at, (shard, number)) in self.0.iter().enumerate() {
            let separator = if at > 0 { "," } else { "" };
            write!(f, "{separator}{shard}.{number}")?;
        }
        Ok(())
    }
}

/// Merges pages of `limit` items each, which start at the cursor. Each list keeps its own order.
pub(crate) fn merge_numbered<T>(
    pages: Vec<NumberedPage<T>>,
    mut cursor: ShardCursor,
    limit: usize,
) -> MergedPage<T> {
    let mut heads: Vec<_> = pages
        .into_iter()
        .map(|page| (page.shard, page.has_more, page.items.into_iter().peekable()))
        .collect();
    let mut items = Vec::new();
    while items.len() < limit {
        let newest = heads
            .iter_mut()
            .enumerate()
            .filter_map(|(at, (_, _, rest))| Some((rest.peek()?.at.clone(), at)))
            .max_by(|(a, first), (b, second)| a.cmp(b).then(second.cmp(first)));
        let Some((shard, _, rest)) = newest.and_then(|(_, at)| heads.get_mut(at)) else { break };
        let Some(NumberedItem { number, item, .. }) = rest.next() else { break };
        cursor.0.insert(shard.clone(), number);
        items.push(item);
    }
    let mut has_more = false;
    for (shard, is_longer, mut rest) in heads {
        if is_longer || rest.peek().is_some() {
            has_more = true;
        } else {
            cursor.0.insert(shard, 0);
        }
    }
    MergedPage { items, next: has_more.then(|| cursor.to_string()) }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn shard(name: &str) -> Shard {
        name.parse().expect("a shard")
    }

    /// Returns the page of a server whose items have these times, oldest first.
    fn page(name: &str, times: &[u8], cursor: &ShardCursor, limit: usize) -> NumberedPage<(String, i64)> {
        let shard = shard(name);
        let before = cursor.before(&shard).unwrap_or(i64::MAX);
        let all = times.iter().enumerate().map(|(index, time)| {
            let number = index as i64 + 1;
            NumberedItem { at: format!("{time:03}"), number, item: (name.to_owned(), number) }
        });
        let older: Vec<_> = all.rev().filter(|item| item.number < before).collect();
        let has_more = older.len() > limit;
        NumberedPage { shard, items: older.into_iter().take(limit).collect(), has_more }
    }

    #[test]
    fn cursor_has_one_text() {
        for text in ["a.1", "a.0,b.12"] {
            assert_eq!(
                ShardCursor::parse(Some(text)).map(|cursor| cursor.to_string()).as_deref(),
                Some(text)
            );
        }
        assert_eq!(ShardCursor::parse(None), Some(ShardCursor::default()));
        for text in ["", "a", "a.", "a.-1", "A.1", "a.1,", "12."] {
            assert_eq!(ShardCursor::parse(Some(text)), None, "{text}");
        }
    }

    proptest! {
        /// All pages together have each item once, and each list keeps its order. A shard that is missing for a page is continued.
        #[test]
        fn pages_together_have_each_item_once(
            mut east in prop::collection::vec(0u8..20, 0..12),
            mut west in prop::collection::vec(0u8..20, 0..12),
            limit in 1usize..5,
            missing_page in 0usize..6,
        ) {
            east.sort_unstable();
            west.sort_unstable();
            let (mut listed, mut cursor) = (Vec::new(), ShardCursor::default());
            for number in 0.. {
                let mut pages = vec![page("east", &east, &cursor, limit)];
                if number != missing_page {
                    pages.push(page("west", &west, &cursor, limit));
                }
                let merged = merge_numbered(pages, cursor, limit);
                prop_assert!(merged.items.len() <= limit);
                listed.extend(merged.items);
                match merged.next {
                    Some(next) => cursor = ShardCursor::parse(Some(&next)).expect("a cursor"),
                    None => break,
                }
            }
            for (name, count) in [("east", east.len()), ("west", west.len())] {
                let numbers: Vec<i64> =
                    listed.iter().filter(|(shard, _)| shard == name).map(|(_, number)| *number).collect();
                let all: Vec<i64> = (1..=count as i64).rev().collect();
                // The list may end while a shard is missing.
                prop_assert!(numbers == all || name == "west" && all.starts_with(&numbers), "{listed:?}");
            }
        }
    }
}
