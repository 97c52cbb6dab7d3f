//! PDF documents of a comparison: the whole report on A4 pages, or one figure on a page of its size.

use std::collections::BTreeSet;

use clock::rfc3339;
use pdf_writer::{Content, Finish, Name, Pdf, Rect, Ref, Str};
use plotters::prelude::IntoDrawingArea;

use super::figure::Figure;
use super::gather::Comparison;
use super::page::{EVALUATIONS, FINAL, MEANS, TITLE};
use super::pdf::{BOLD, PdfBackend, REGULAR, encode, opacity_name, text_width};
use super::tables::{TextTable, differing_settings, evaluation_tables, final_table, run_table};

/// Width and height of an A4 page in points.
const A4: (f32, f32) = (595.0, 842.0);
const MARGIN: f32 = 48.0;
/// Distance of two lines as a multiple of the size of the text.
const LINE_HEIGHT: f32 = 1.35;
/// Size of the text in tables.
const TABLE_SIZE: f32 = 7.5;
/// Width of a figure beside another one.
const FIGURE_WIDTH: f32 = (A4.0 - 2.0 * MARGIN - 14.0) / 2.0;

/// Renders the report as a PDF document.
///
/// # Errors
/// Returns an error if a figure cannot be drawn or an evaluation cannot be read.
pub(in crate::report) fn render_pdf(comparison: &Comparison) -> anyhow::Result<Vec<u8>> {
    let mut pages = Pages::new(A4.0, A4.1);
    pages.text(TITLE, BOLD, 17.0);
    let now = rfc3339(comparison.now);
    pages.text(&format!("{}. As of {now}; all times are UTC.", comparison.describe()), REGULAR, 9.0);
    pages.table(&run_table(comparison));
    for task in &comparison.tasks {
        pages.heading(&task.task);
        for pair in task.figures.chunks(2) {
            pages.figures(pair)?;
        }
        if task.figures.iter().any(Figure::has_means) {
            pages.text(MEANS, REGULAR, 9.0);
        }
        pages.table(&final_table(comparison, task));
        pages.text(FINAL, REGULAR, 9.0);
    }
    let evaluations = evaluation_tables(comparison)?;
    if !evaluations.is_empty() {
        pages.heading("Evaluations");
        pages.text(EVALUATIONS, REGULAR, 9.0);
    }
    for (suite, table) in &evaluations {
        pages.text(suite, BOLD, 10.0);
        pages.table(table);
    }
    let (settings, all) = differing_settings(comparison);
    pages.heading("Settings");
    pages.text(&format!("{} of {all} settings differ.", settings.rows.len()), REGULAR, 9.0);
    pages.table(&settings);
    Ok(pages.finish())
}

/// Returns one figure as a PDF document of its size.
///
/// # Errors
/// Returns an error if the figure cannot be drawn.
pub(super) fn figure_pdf(figure: &Figure) -> anyhow::Result<Vec<u8>> {
    let (width, height) = figure.size();
    let mut pages = Pages::new(width as f32, height as f32);
    pages.figure(figure, 0.0, height as f32, 1.0)?;
    Ok(pages.finish())
}

/// Document that is written from top to bottom.
struct Pages {
    size: (f32, f32),
    /// Contents of the pages; the last one is written.
    contents: Vec<Content>,
    /// Opacities in percent that figures use.
    opacities: BTreeSet<u8>,
    /// Lower end of the written part of the last page.
    y: f32,
}

impl Pages {
    fn new(width: f32, height: f32) -> Self {
        let contents = vec![Content::new()];
        Self { size: (width, height), contents, opacities: BTreeSet::new(), y: height - MARGIN }
    }

    fn content(&mut self) -> &mut Content {
        if self.contents.is_empty() {
            self.contents.push(Content::new());
        }
        let last = self.contents.len() - 1;
        &mut self.contents[last]
    }

    /// Begins a page unless the last one has this much free height.
    fn reserve(&mut self, height: f32) {
        if self.y - height < MARGIN && self.y < self.size.1 - MARGIN {
            self.contents.push(Content::new());
            self.y = self.size.1 - MARGIN;
        }
    }

    fn heading(&mut self, text: &str) {
        self.reserve(120.0);
        self.y -= 10.0;
        self.text(text, BOLD, 13.0);
    }

    /// Writes a paragraph in as many lines as it needs.
    fn text(&mut self, text: &str, font: Name<'_>, size: f32) {
        for line in wrap(text, size, self.size.0 - 2.0 * MARGIN) {
            self.reserve(LINE_HEIGHT * size);
            self.y -= LINE_HEIGHT * size;
            let y = self.y;
            show(self.content(), &line, font, size, MARGIN, y);
        }
        self.y -= 4.0;
    }

    /// Writes a table; its columns share the width by the lengths of their texts, and long texts are wrapped.
    fn table(&mut self, table: &TextTable) {
        let widths = column_widths(table, self.size.0 - 2.0 * MARGIN);
        self.table_row(&table.head, &widths, BOLD);
        for row in &table.rows {
            self.table_row(row, &widths, REGULAR);
        }
        self.y -= 6.0;
    }

    fn table_row(&mut self, row: &[String], widths: &[f32], font: Name<'_>) {
        let cells: Vec<Vec<String>> =
            row.iter().zip(widths).map(|(text, width)| wrap(text, TABLE_SIZE, width - 6.0)).collect();
        let lines = cells.iter().map(Vec::len).max().unwrap_or(1);
        self.reserve(lines as f32 * LINE_HEIGHT * TABLE_SIZE + 4.0);
        let (mut x, top) = (MARGIN, self.y - LINE_HEIGHT * TABLE_SIZE);
        for (cell, width) in cells.iter().zip(widths) {
            for (nth, line) in cell.iter().enumerate() {
                let y = top - nth as f32 * LINE_HEIGHT * TABLE_SIZE;
                show(self.content(), line, font, TABLE_SIZE, x, y);
            }
            x += width;
        }
        self.y = top - (lines - 1) as f32 * LINE_HEIGHT * TABLE_SIZE - 4.0;
        let y = self.y;
        self.content().set_stroke_gray(0.85).set_line_width(0.5).move_to(MARGIN, y).line_to(x, y).stroke();
    }

    /// Draws one or two figures side by side.
    fn figures(&mut self, figures: &[Figure]) -> anyhow::Result<()> {
        let scale = |figure: &Figure| FIGURE_WIDTH / figure.size().0 as f32;
        let height = figures.iter().map(|figure| figure.size().1 as f32 * scale(figure)).fold(0.0, f32::max);
        self.reserve(height + 18.0);
        let top = self.y;
        for (nth, figure) in figures.iter().enumerate() {
            let x = MARGIN + nth as f32 * (FIGURE_WIDTH + 14.0);
            show(self.content(), &figure.title, BOLD, 9.0, x, top - 12.0);
            self.figure(figure, x, top - 16.0, scale(figure))?;
        }
        self.y = top - height - 18.0;
        Ok(())
    }

    /// Draws a figure with its upper left corner at a position.
    fn figure(&mut self, figure: &Figure, x: f32, y: f32, scale: f32) -> anyhow::Result<()> {
        let mut opacities = std::mem::take(&mut self.opacities);
        let content = self.content();
        content.save_state().transform([scale, 0.0, 0.0, scale, x, y]);
        let (width, height) = figure.size();
        let area = PdfBackend::new(content, &mut opacities, width, height).into_drawing_area();
        figure.draw(&area).map_err(|error| anyhow::anyhow!("a figure cannot be drawn: {error}"))?;
        drop(area);
        self.content().restore_state();
        self.opacities = opacities;
        Ok(())
    }

    fn finish(self) -> Vec<u8> {
        let mut pdf = Pdf::new();
        let mut next = 0;
        let mut id = || {
            next += 1;
            Ref::new(next)
        };
        let (catalog, tree, regular, bold) = (id(), id(), id(), id());
        let opacities: Vec<(u8, Ref)> = self.opacities.iter().map(|percent| (*percent, id())).collect();
        let pages: Vec<(Ref, Ref)> = self.contents.iter().map(|_| (id(), id())).collect();
        pdf.catalog(catalog).pages(tree);
        pdf.pages(tree)
            .kids(pages.iter().map(|(page, _)| *page))
            .count(i32::try_from(pages.len()).unwrap_or(i32::MAX));
        for (font, name) in [(regular, Name(b"Helvetica")), (bold, Name(b"Helvetica-Bold"))] {
            pdf.type1_font(font).base_font(name).encoding_predefined(Name(b"WinAnsiEncoding"));
        }
        for (percent, state) in &opacities {
            let alpha = f32::from(*percent) / 100.0;
            pdf.ext_graphics(*state).stroking_alpha(alpha).non_stroking_alpha(alpha);
        }
        for (content, (page_id, content_id)) in self.contents.into_iter().zip(pages) {
            let mut page = pdf.page(page_id);
            page.media_box(Rect::new(0.0, 0.0, self.size.0, self.size.1)).parent(tree).contents(content_id);
            let mut resources = page.resources();
            resources.fonts().pair(REGULAR, regular).pair(BOLD, bold);
            let mut states = resources.ext_g_states();
            for (percent, state) in &opacities {
                states.pair(Name(opacity_name(*percent).as_bytes()), *state);
            }
            states.finish();
            resources.finish();
            page.finish();
            pdf.stream(content_id, &content.finish());
        }
        pdf.finish()
    }
}

fn show(content: &mut Content, text: &str, font: Name<'_>, size: f32, x: f32, y: f32) {
    content.begin_text().set_fill_gray(0.15).set_font(font, size).next_line(x, y);
    content.show(Str(&encode(text))).end_text();
}

/// Divides the width of a table by the longest texts of its columns; columns that need less than their share keep what they need.
fn column_widths(table: &TextTable, width: f32) -> Vec<f32> {
    let longest = |at: usize| {
        let texts = table.rows.iter().chain([&table.head]).filter_map(|row| row.get(at));
        // Bold titles are wider than the widths of the regular font.
        texts.map(|text| 1.08 * text_width(text, TABLE_SIZE) + 8.0).fold(0.0, f32::max)
    };
    let needs: Vec<f32> = (0..table.head.len()).map(longest).collect();
    let mut order: Vec<usize> = (0..needs.len()).collect();
    order.sort_by(|a, b| needs[*a].total_cmp(&needs[*b]));
    let (mut rest, mut widths) = (width, vec![0.0; needs.len()]);
    for (nth, at) in order.iter().enumerate() {
        widths[*at] = needs[*at].min(rest / (needs.len() - nth) as f32);
        rest -= widths[*at];
    }
    widths
}

/// Divides a text into lines of a width at its spaces; longer words are divided too.
fn wrap(text: &str, size: f32, width: f32) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        let line = lines.last().map_or("", String::as_str);
        let joined = if line.is_empty() { word.to_owned() } else { format!("{line} {word}") };
        if text_width(&joined, size) <= width || line.is_empty() {
            lines.pop();
            lines.push(joined);
        } else {
            lines.push(word.to_owned());
        }
        while let Some(rest) = lines.last().and_then(|line| divide(line, size, width)) {
            let kept = lines.pop().map(|mut line| {
                line.truncate(line.len() - rest.len());
                line
            });
            lines.extend(kept);
            lines.push(rest);
        }
    }
    lines
}

/// Returns the part of a line beyond the width; none if it fits or has one character.
fn divide(line: &str, size: f32, width: f32) -> Option<String> {
    if text_width(line, size) <= width {
        return None;
    }
    let mut ends = line.char_indices().map(|(at, _)| at).filter(|at| *at > 0);
    let first = ends.next()?;
    let fitting = ends.take_while(|at| text_width(&line[..*at], size) <= width).last().unwrap_or(first);
    Some(line[fitting..].to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_are_wrapped_at_spaces_and_within_long_words() {
        assert_eq!(wrap("one two three", 10.0, 40.0), ["one two", "three"]);
        let lines = wrap("unbreakable-identifier", 10.0, 40.0);
        assert!(lines.len() > 2 && lines.iter().all(|line| text_width(line, 10.0) <= 40.0), "{lines:?}");
        assert_eq!(lines.concat(), "unbreakable-identifier");
        assert_eq!(wrap("", 10.0, 40.0), [""]);
        assert_eq!(wrap("猫", 10.0, 1.0), ["猫"]);
    }

    #[test]
    fn columns_fill_the_width_only_if_they_need_it() {
        let table = TextTable {
            head: vec!["a".to_owned(), "b".to_owned()],
            rows: vec![vec!["1".to_owned(), "a very long text in the second column of the table".repeat(4)]],
        };
        let widths = column_widths(&table, 300.0);
        assert!((widths.iter().sum::<f32>() - 300.0).abs() < 1e-3 && widths[0] < 20.0, "{widths:?}");
    }
}
