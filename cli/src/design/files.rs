//! Files of layouts, and pictures of them.

use std::fmt::Write;
use std::path::Path;

use anyhow::Context;
use designer::svg::escape_xml;
use designer::{LayoutView, draw_layout};
use serde_json::json;

use super::row::Outcome;

/// Letters of a layout's name that its picture's file is called by, at most.
const MAX_SLUG: usize = 40;

/// Draws every admitted layout into a folder, which is made where there is none, with an index. Answers with what was
/// written, in a sentence.
pub(super) fn pictures(folder: &Path, outcome: &Outcome) -> anyhow::Result<String> {
    let context = || format!("--svg: {} cannot be written", folder.display());
    std::fs::create_dir_all(folder).with_context(context)?;
    let mut drawn = Vec::new();
    for (row, passed, scenario) in outcome.admitted() {
        let design = row.understood();
        let subject = LayoutView { name: &row.name, design, scenario, bracket: &passed.bracket };
        let Some(picture) = draw_layout(subject) else { continue };
        let file = format!("{:02}-{}.svg", drawn.len() + 1, slug(&row.name));
        std::fs::write(folder.join(&file), picture).with_context(context)?;
        drawn.push((file, row.name.as_str()));
    }
    std::fs::write(folder.join("index.html"), index(&drawn)).with_context(context)?;
    let path = folder.display();
    Ok(format!("{} pictures are in {path}; look at {path}/index.html.", drawn.len()))
}

/// A page with all of them.
fn index(drawn: &[(String, &str)]) -> String {
    let mut page = "<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\"><title>Layouts</title>\n\
                    <style>body { background: #1b2430; color: #d6dde6; font: 15px system-ui, sans-serif; margin: 2em auto; \
                    max-width: 920px } img { max-width: 100% } a { color: #6cb6ff }</style>\n<h1>Layouts</h1>\n<ol>\n"
        .to_owned();
    for (file, name) in drawn {
        // Writing into a string cannot fail.
        let _ = writeln!(page, "<li><a href=\"#{file}\">{}</a></li>", escape_xml(name));
    }
    page += "</ol>\n";
    for (file, name) in drawn {
        let name = escape_xml(name);
        let _ =
            writeln!(page, "<p id=\"{file}\"><a href=\"{file}\"><img src=\"{file}\" alt=\"{name}\"></a></p>");
    }
    page + "</html>\n"
}

/// A name as part of a file's: small letters, digits and hyphens, whatever it was.
fn slug(name: &str) -> String {
    let mut slug = String::new();
    for c in name.chars() {
        match c.to_ascii_lowercase() {
            c if c.is_ascii_alphanumeric() => slug.push(c),
            _ if !slug.is_empty() && !slug.ends_with('-') => slug.push('-'),
            _ => {}
        }
        if slug.len() >= MAX_SLUG {
            break;
        }
    }
    let slug = slug.trim_end_matches('-');
    if slug.is_empty() { "layout".to_owned() } else { slug.to_owned() }
}

/// Writes the admitted layouts as a file that [`designer::replay`] reads. Answers with what was written, in a sentence.
pub(super) fn layouts(path: &Path, outcome: &Outcome) -> anyhow::Result<String> {
    let admitted: Vec<_> = outcome
        .admitted()
        .map(|(row, _, scenario)| json!({"name": row.name, "scenario": scenario.to_json()}))
        .collect();
    let context = || format!("--out: {} cannot be written", path.display());
    let text = serde_json::to_string(&json!({ "layouts": admitted }))?;
    std::fs::write(path, text + "\n").with_context(context)?;
    Ok(format!("{} layouts are in {}; --layouts reads them.", admitted.len(), path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_names_are_safe_whatever_a_layout_is_called() {
        for (name, wanted) in [
            ("From +Y, twice", "from-y-twice"),
            ("../../etc/passwd", "etc-passwd"),
            ("<script>", "script"),
            ("", "layout"),
            ("…", "layout"),
            (&"long ".repeat(40), "long-long-long-long-long-long-long-long"),
        ] {
            assert_eq!(slug(name), wanted);
        }
    }

    #[test]
    fn the_index_holds_words_and_no_markup_of_strangers() {
        let page = index(&[("01-x.svg".to_owned(), "\"><script>alert(1)</script>")]);
        assert!(!page.contains("<script") && page.contains("&quot;&gt;&lt;script&gt;"), "{page}");
    }
}
