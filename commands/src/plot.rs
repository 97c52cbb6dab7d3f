//! Types of the SVG backend of `plotters` that all charts share.

use plotters::coord::Shift;
use plotters::drawing::{DrawingArea, DrawingAreaErrorKind};
use plotters::prelude::SVGBackend;

/// Area of an SVG document in pixel coordinates.
pub type SvgArea<'a> = DrawingArea<SVGBackend<'a>, Shift>;
/// Result of a drawing operation.
pub type DrawResult = Result<(), DrawingAreaErrorKind<std::io::Error>>;
