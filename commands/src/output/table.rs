//! [`TextTable`]: a table that fits the terminal, or tab-separated values for a pipe.

use comfy_table::{CellAlignment, ColumnConstraint, ContentArrangement, LineStyle, Table, TableStyle, Width};

use super::target::OutputTarget;

/// Smallest width of a column of prose, in columns.
const MIN_PROSE_WIDTH: usize = 24;
/// Padding between two columns: one space on either side of the separator.
const CELL_PADDING: usize = 2;
/// Width of the separator between two columns.
const SEPARATOR_WIDTH: usize = 1;

/// Table style with lines above, under the header and below, and none between rows.
const STYLE: TableStyle = {
    let line = LineStyle::none().fill('─').junction('─');
    TableStyle::new().top_border(line).header_separator(line).bottom_border(line)
};

/// Column of a table.
#[derive(Debug, Clone)]
pub struct Column {
    title: String,
    kind: ColumnKind,
    /// Order in which narrow terminals hide optional columns, the highest first; 0 for columns that are always shown.
    hide_rank: u8,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ColumnKind {
    /// Words or ids, never wrapped.
    Text,
    /// Numbers, aligned right, never wrapped.
    Number,
    /// Sentences, wrapped at spaces.
    Prose,
}

impl Column {
    /// Creates a column of words or ids.
    pub fn text(title: impl Into<String>) -> Self {
        Self { title: title.into(), kind: ColumnKind::Text, hide_rank: 0 }
    }

    /// Creates a column of numbers.
    pub fn number(title: impl Into<String>) -> Self {
        Self { title: title.into(), kind: ColumnKind::Number, hide_rank: 0 }
    }

    /// Creates a column of sentences.
    pub fn prose(title: impl Into<String>) -> Self {
        Self { title: title.into(), kind: ColumnKind::Prose, hide_rank: 0 }
    }

    /// Lets a narrow terminal hide the column. Columns of the highest rank are hidden first.
    pub const fn optional(mut self, hide_rank: u8) -> Self {
        self.hide_rank = hide_rank;
        self
    }
}

/// Table of text cells.
#[derive(Debug, Clone)]
pub struct TextTable {
    columns: Vec<Column>,
    rows: Vec<Vec<String>>,
}

impl TextTable {
    /// Creates a table without rows.
    pub fn new(columns: impl IntoIterator<Item = Column>) -> Self {
        Self { columns: columns.into_iter().collect(), rows: Vec::new() }
    }

    /// Adds a row with one cell for each column. Tabs, line ends and other control characters become spaces.
    pub fn add_row<S: Into<String>>(&mut self, cells: impl IntoIterator<Item = S>) {
        let one_line = |cell: S| cell.into().replace(char::is_control, " ");
        let mut row: Vec<String> = cells.into_iter().map(one_line).collect();
        row.resize(self.columns.len(), String::new());
        self.rows.push(row);
    }

    /// Formats the table for a target, without a line end.
    pub fn render(&self, target: OutputTarget) -> String {
        match target {
            OutputTarget::Piped => self.tab_separated(),
            OutputTarget::Terminal(width) => self.fit(width),
        }
    }

    /// Formats the table as tab-separated values with a header.
    fn tab_separated(&self) -> String {
        // A no-break space only keeps the words of a title together on a terminal.
        let titles: Vec<String> =
            self.columns.iter().map(|column| column.title.replace('\u{a0}', " ")).collect();
        let rows = self.rows.iter().map(|row| row.join("\t"));
        std::iter::once(titles.join("\t")).chain(rows).collect::<Vec<_>>().join("\n")
    }

    /// Formats the table within `width`. In this order, as far as needed: titles are wrapped, prose is wrapped, optional columns
    /// are hidden, and rows are stacked.
    fn fit(&self, width: usize) -> String {
        let mut shown: Vec<usize> = (0..self.columns.len()).collect();
        loop {
            if let Some(table) = self.draw(&shown, width) {
                let lines: Vec<String> = table.lines().map(|line| line.trim_end().to_owned()).collect();
                return format!("{}{}", lines.join("\n"), self.hidden_note(&shown));
            }
            let hidden = shown.iter().copied().max_by_key(|&index| (self.columns[index].hide_rank, index));
            match hidden.filter(|&index| self.columns[index].hide_rank > 0) {
                // Stacked rows show more than a table that lacks half of its columns.
                Some(index) if 2 * (shown.len() - 1) >= self.columns.len() => {
                    shown.retain(|&other| other != index);
                }
                _ => return self.stack(width),
            }
        }
    }

    /// Draws the columns as a table if they fit the width.
    fn draw(&self, shown: &[usize], width: usize) -> Option<Table> {
        for wrap_titles in [false, true] {
            let mut table = self.plain_table(shown, wrap_titles);
            let widths = table.column_max_content_widths();
            let between = (CELL_PADDING + SEPARATOR_WIDTH) * widths.len().saturating_sub(1);
            let total = widths.iter().map(|&width| usize::from(width)).sum::<usize>() + between;
            if total <= width {
                return Some(table);
            }
            if wrap_titles && self.wrap_prose(&mut table, shown, total - width) {
                return Some(table);
            }
        }
        None
    }

    /// Makes the widest column of prose narrower by `excess`. Returns false if it would be too narrow.
    fn wrap_prose(&self, table: &mut Table, shown: &[usize], excess: usize) -> bool {
        let widths = table.column_max_content_widths();
        let is_prose = |place: &usize| self.columns[shown[*place]].kind == ColumnKind::Prose;
        let Some(place) = (0..shown.len()).filter(is_prose).max_by_key(|&place| widths[place]) else {
            return false;
        };
        let left = usize::from(widths[place]).saturating_sub(excess);
        let Some(column) = table.column_mut(place).filter(|_| left >= MIN_PROSE_WIDTH) else { return false };
        let padding = usize::from(column.padding_width());
        let fixed = u16::try_from(left + padding).unwrap_or(u16::MAX);
        column.set_constraint(ColumnConstraint::Absolute(Width::Fixed(fixed)));
        true
    }

    fn plain_table(&self, shown: &[usize], wrap_titles: bool) -> Table {
        let mut table = Table::new();
        table.load_style(STYLE).set_content_arrangement(ContentArrangement::Disabled);
        let title = |&index: &usize| {
            let title = &self.columns[index].title;
            if wrap_titles { title.replace(' ', "\n") } else { title.clone() }
        };
        table.set_header(shown.iter().map(title).collect::<Vec<_>>());
        for row in &self.rows {
            table.add_row(shown.iter().map(|&index| row[index].clone()).collect::<Vec<_>>());
        }
        for (place, &index) in shown.iter().enumerate() {
            if let Some(column) = table.column_mut(place) {
                // The table has no outer margins.
                column.set_padding((u16::from(place > 0), u16::from(place + 1 < shown.len())));
            }
            if self.columns[index].kind == ColumnKind::Number
                && let Some(column) = table.column_mut(place)
            {
                column.set_cell_alignment(CellAlignment::Right);
            }
        }
        table
    }

    fn hidden_note(&self, shown: &[usize]) -> String {
        let hidden = self.columns.iter().enumerate().filter(|(index, _)| !shown.contains(index));
        let titles: Vec<&str> = hidden.map(|(_, column)| column.title.as_str()).collect();
        match titles.as_slice() {
            [] => String::new(),
            titles => format!("\nHidden in a narrow terminal: {}.", titles.join(", ")),
        }
    }

    /// Formats each row as lines of "title: cell", with an empty line between rows.
    fn stack(&self, width: usize) -> String {
        let target = OutputTarget::Terminal(width);
        let label = self.columns.iter().map(|column| column.title.chars().count()).max().unwrap_or(0);
        let line = |(column, cell): (&Column, &String)| {
            target.wrap(&format!("{:<label$}  {cell}", column.title), &" ".repeat(label + 2))
        };
        let rows =
            self.rows.iter().map(|row| self.columns.iter().zip(row).map(line).collect::<Vec<_>>().join("\n"));
        rows.collect::<Vec<_>>().join("\n\n")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn runs() -> TextTable {
        let mut table = TextTable::new([
            Column::text("run"),
            Column::text("status"),
            Column::number("active leases").optional(1),
            Column::text("created").optional(2),
            Column::prose("warning"),
        ]);
        table.add_row([
            "run-1a2b3c4d5e6f",
            "active",
            "12",
            "2026-11-26T10:00:00Z",
            "7 of 32 outcomes are missing, so the level cannot rise.",
        ]);
        table.add_row(["sweep-3", "paused", "0", "2026-11-25T10:00:00Z", "a tab\tand a line\nend"]);
        table
    }

    #[test]
    fn tables_fit_the_terminal_without_splitting_words() {
        let at = |width| runs().render(OutputTarget::Terminal(width));
        for width in [200, 100, 80, 60, 48, 40] {
            let widest = at(width).lines().map(|line| line.chars().count()).max();
            assert!(widest <= Some(width), "{width}: {widest:?}\n{}", at(width));
        }
        insta::assert_snapshot!([120, 80, 60, 40].map(at).join("\n\n"));
    }

    #[test]
    fn pipe_gets_tab_separated_values() {
        insta::assert_snapshot!(runs().render(OutputTarget::Piped).replace('\t', "→"), @r"
        run→status→active leases→created→warning
        run-1a2b3c4d5e6f→active→12→2026-11-26T10:00:00Z→7 of 32 outcomes are missing, so the level cannot rise.
        sweep-3→paused→0→2026-11-25T10:00:00Z→a tab and a line end
        ");
        let mut table = TextTable::new([Column::number("mastery (10–90\u{a0}%)")]);
        table.add_row(["0.5"]);
        assert_eq!(table.render(OutputTarget::Piped), "mastery (10–90 %)\n0.5");
    }
}
