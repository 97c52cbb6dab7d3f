//! Output files: admitted layouts as JSON and their pictures as SVG.

use std::fmt::Write;
use std::path::Path;

use anyhow::Context;
use designer::svg::escape_xml;
use designer::{LayoutView, draw_layout};
use serde_json::json;

use super::design_report::{AdmittedLayout, DesignReport};
use crate::files;

/// Longest part of a layout's name in a file name, in bytes.
const MAX_SLUG_BYTES: usize = 40;

/// Draws every admitted layout into a folder, together with an index page. Creates the folder if it does not exist. Returns
/// a sentence that says what was written.
///
/// # Errors
/// Returns an error if the folder or a file cannot be written.
pub(super) fn write_pictures(folder: &Path, outcome: &DesignReport) -> anyhow::Result<String> {
    files::create_folder(folder).context("--svg")?;
    let mut drawn = Vec::new();
    for AdmittedLayout { layout, gate, scenario } in outcome.admitted() {
        let design = layout.canonical_design();
        let subject = LayoutView { name: &layout.name, design, scenario, bracket: &gate.bracket };
        let Some(picture) = draw_layout(subject) else { continue };
        let file = format!("{:02}-{}.svg", drawn.len() + 1, slug(&layout.name));
        files::write(&folder.join(&file), picture).context("--svg")?;
        drawn.push(DrawnLayout { file, name: &layout.name });
    }
    files::write(&folder.join("index.html"), index_page(&drawn)).context("--svg")?;
    let path = folder.display();
    Ok(format!("Wrote {} pictures to {path}; open {path}/index.html.", drawn.len()))
}

/// Picture file of a layout.
struct DrawnLayout<'a> {
    file: String,
    name: &'a str,
}

/// Builds the index page of all pictures.
fn index_page(drawn: &[DrawnLayout<'_>]) -> String {
    let mut page = "<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\"><title>Layouts</title>\n\
                    <style>body { background: #1b2430; color: #d6dde6; font: 15px system-ui, sans-serif; margin: 2em auto; \
                    max-width: 920px } img { max-width: 100% } a { color: #6cb6ff }</style>\n<h1>Layouts</h1>\n<ol>\n"
        .to_owned();
    for DrawnLayout { file, name } in drawn {
        // Writing into a string cannot fail.
        let _ = writeln!(page, "<li><a href=\"#{file}\">{}</a></li>", escape_xml(name));
    }
    page += "</ol>\n";
    for DrawnLayout { file, name } in drawn {
        let name = escape_xml(name);
        let _ =
            writeln!(page, "<p id=\"{file}\"><a href=\"{file}\"><img src=\"{file}\" alt=\"{name}\"></a></p>");
    }
    page + "</html>\n"
}

/// Converts a name to lowercase letters, digits and hyphens for use in a file name.
fn slug(name: &str) -> String {
    let mut slug = String::new();
    for c in name.chars() {
        match c.to_ascii_lowercase() {
            c if c.is_ascii_alphanumeric() => slug.push(c),
            _ if !slug.is_empty() && !slug.ends_with('-') => slug.push('-'),
            _ => {}
        }
        if slug.len() >= MAX_SLUG_BYTES {
            break;
        }
    }
    let slug = slug.trim_end_matches('-');
    if slug.is_empty() { "layout".to_owned() } else { slug.to_owned() }
}

/// Writes the admitted layouts as a file that [`designer::replay`] reads. Returns a sentence that says what was written.
///
/// # Errors
/// Returns an error if the file cannot be written.
pub(super) fn write_layouts(path: &Path, outcome: &DesignReport) -> anyhow::Result<String> {
    let admitted: Vec<_> = outcome
        .admitted()
        .map(|admitted| json!({"name": admitted.layout.name, "scenario": admitted.scenario.to_json()}))
        .collect();
    let text = serde_json::to_string(&json!({ "layouts": admitted }))?;
    files::write(path, text + "\n").context("--out")?;
    Ok(format!("Wrote {} layouts to {}, in the format of --layouts.", admitted.len(), path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_names_are_safe_for_any_layout_name() {
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
    fn index_page_escapes_layout_names() {
        let page =
            index_page(&[DrawnLayout { file: "01-x.svg".to_owned(), name: "\"><script>alert(1)</script>" }]);
        assert!(!page.contains("<script") && page.contains("&quot;&gt;&lt;script&gt;"), "{page}");
    }
}
