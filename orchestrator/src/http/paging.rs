//! Pages of lists: the largest number of rows, and the cursor of the next page.

use super::problem::Problem;

/// Checks the `limit` of a page, from 1 to 500 (default 50).
///
/// # Errors
/// Returns a problem with status 422 if the limit is out of range.
pub(super) fn page_limit(limit: Option<u32>) -> Result<i64, Problem> {
    match limit.unwrap_or(50) {
        limit @ 1..=500 => Ok(i64::from(limit)),
        limit => Err(Problem::invalid("limit", format!("must be from 1 to 500, got {limit}"))),
    }
}

/// Cursor of a page, `number.text`. The default is the start of a list in ascending order.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PageCursor<'a> {
    /// Number of the last row of the previous page.
    pub(super) number: i64,
    /// Further key of that row; empty if the number is the whole key.
    pub(super) text: &'a str,
}

impl<'a> PageCursor<'a> {
    /// Cursor of a row that its number alone identifies.
    pub(super) const fn at(number: i64) -> Self {
        Self { number, text: "" }
    }

    /// Parses the cursor of a query, if it has one.
    ///
    /// # Errors
    /// Returns a problem with status 422 if the text is no cursor.
    pub(super) fn parse(cursor: Option<&'a str>) -> Result<Option<Self>, Problem> {
        let Some(cursor) = cursor else { return Ok(None) };
        let parts = cursor.split_once('.');
        let cursor = parts.and_then(|(number, text)| Some(Self { number: number.parse().ok()?, text }));
        cursor.map(Some).ok_or_else(|| Problem::invalid("cursor", "must be the `next` of a previous page"))
    }
}

/// Number below which a page in descending order starts; the largest number without a cursor.
///
/// # Errors
/// As [`PageCursor::parse`].
pub(super) fn number_before(cursor: Option<&str>) -> Result<i64, Problem> {
    Ok(PageCursor::parse(cursor)?.map_or(i64::MAX, |cursor| cursor.number))
}

/// Number above which a page in ascending order starts; −1 without a cursor.
///
/// # Errors
/// As [`PageCursor::parse`].
pub(super) fn number_after(cursor: Option<&str>) -> Result<i64, Problem> {
    Ok(PageCursor::parse(cursor)?.map_or(-1, |cursor| cursor.number))
}

/// Formats the cursor after the last row of a page. Returns `None` if the page is not full, so that there are no more rows.
pub(super) fn next_cursor(rows: usize, limit: i64, last: Option<PageCursor<'_>>) -> Option<String> {
    last.filter(|_| rows as i64 >= limit).map(|PageCursor { number, text }| format!("{number}.{text}"))
}
