//! [`Report`]: prose and tables, formatted for a terminal or a pipe.

use super::table::TextTable;
use super::target::OutputTarget;

/// Text output of a subcommand: a sequence of blocks.
///
/// A terminal shows blocks separated by empty lines, except where a block follows tightly. A pipe gets tables as tab-separated
/// values; all other lines begin with `# `, so that programs can skip them.
#[derive(Debug, Clone, Default)]
pub struct Report {
    blocks: Vec<Block>,
}

#[derive(Debug, Clone)]
struct Block {
    content: Content,
    /// True if no empty line separates the block from the one before.
    is_tight: bool,
}

#[derive(Debug, Clone)]
enum Content {
    /// Prose, with the indent of its first line and of all others.
    Prose {
        text: String,
        first_indent: &'static str,
        indent: &'static str,
    },
    Table(TextTable),
}

impl Report {
    /// Adds a paragraph of prose.
    pub fn paragraph(&mut self, text: impl Into<String>) -> &mut Self {
        self.prose(text, "", "", false)
    }

    /// Adds prose directly under the block before it.
    pub fn line(&mut self, text: impl Into<String>) -> &mut Self {
        self.prose(text, "", "  ", true)
    }

    /// Adds an indented item directly under the block before it.
    pub fn item(&mut self, text: impl Into<String>) -> &mut Self {
        self.prose(text, "  ", "    ", true)
    }

    /// Adds a table directly under the block before it, or separated from another table.
    pub fn table(&mut self, table: TextTable) -> &mut Self {
        let follows_table = matches!(self.blocks.last(), Some(Block { content: Content::Table(_), .. }));
        self.push(Content::Table(table), !follows_table)
    }

    /// Adds a table, separated from the block before it.
    pub fn separate_table(&mut self, table: TextTable) -> &mut Self {
        self.push(Content::Table(table), false)
    }

    fn prose(
        &mut self,
        text: impl Into<String>,
        first_indent: &'static str,
        indent: &'static str,
        is_tight: bool,
    ) -> &mut Self {
        self.push(Content::Prose { text: text.into(), first_indent, indent }, is_tight)
    }

    fn push(&mut self, content: Content, is_tight: bool) -> &mut Self {
        let is_tight = is_tight || self.blocks.is_empty();
        self.blocks.push(Block { content, is_tight });
        self
    }

    /// Formats the report for a target, without a line end after the last line.
    pub fn render(&self, target: OutputTarget) -> String {
        let mut text = String::new();
        for (at, block) in self.blocks.iter().enumerate() {
            if at > 0 {
                text.push_str(if block.is_tight { "\n" } else { "\n\n" });
            }
            text.push_str(&block.content.render(target));
        }
        text
    }
}

impl Content {
    fn render(&self, target: OutputTarget) -> String {
        match (self, target) {
            (Self::Table(table), _) => table.render(target),
            (Self::Prose { text, first_indent, indent }, OutputTarget::Terminal(_)) => {
                target.wrap(&format!("{first_indent}{text}"), indent)
            }
            (Self::Prose { text, .. }, OutputTarget::Piped) => comment(text),
        }
    }
}

/// Puts `# ` before each line.
fn comment(text: &str) -> String {
    text.lines().map(|line| format!("# {line}").trim_end().to_owned()).collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::super::table::Column;
    use super::*;

    #[test]
    fn reports_have_prose_for_people_and_tables_for_programs() {
        let mut table = TextTable::new([Column::text("task"), Column::number("level")]);
        table.add_row(["kessler/survival", "3"]);
        let mut report = Report::default();
        report.paragraph("One run with a sentence that is longer than forty columns.").table(table);
        report.item("after 12 episodes: up from level 2 to 3").paragraph("The end.");
        let piped = report.render(OutputTarget::Piped).replace('\t', "→");
        insta::assert_snapshot!(format!("{}\n\n{piped}", report.render(OutputTarget::Terminal(40))));
    }
}
