//! Files of the figures, for papers and other programs.

use std::path::Path;

use commands::files;

use super::gather::Comparison;
use super::pdf_page::figure_pdf;
use super::png::figure_png;

/// Writes each figure as SVG, PNG, PDF and CSV into a folder, which is created. Returns the number of files.
///
/// # Errors
/// Returns an error if a figure cannot be drawn or a file cannot be written.
pub(in crate::report) fn write_figures(comparison: &Comparison, folder: &Path) -> anyhow::Result<usize> {
    files::create_folder(folder)?;
    let mut written = 0;
    for figure in comparison.tasks.iter().flat_map(|task| &task.figures) {
        let path = |extension: &str| folder.join(format!("{}.{extension}", figure.stem));
        files::write(&path("svg"), figure.svg()?)?;
        files::write(&path("png"), figure_png(figure)?)?;
        files::write(&path("pdf"), figure_pdf(figure)?)?;
        files::write(&path("csv"), figure.csv()?)?;
        written += 4;
    }
    Ok(written)
}
