//! Comparison of several runs: their curves, final values, evaluations and settings.
//!
//! [`gather`] reads the runs; [`curves`] puts them on one axis; [`figure`] draws a chart for every target. [`page`] writes HTML,
//! [`pdf_page`] writes PDF by means of [`pdf`], and [`files`] writes one file for each figure.

mod compared_run;
mod curves;
mod figure;
mod files;
mod gather;
mod groups;
mod page;
mod pdf;
mod pdf_page;
mod png;
mod settings;
mod tables;

pub(super) use curves::FigureAxis;
pub(super) use files::write_figures;
pub(super) use gather::gather;
pub(super) use groups::Grouping;
pub(super) use page::render;
pub(super) use pdf_page::render_pdf;
