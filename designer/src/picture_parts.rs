//! Parts of the pictures of all worlds: title, legend, and colours that mean the same everywhere.

use crate::design_language::LayoutView;
use crate::svg::{DIM, Point, Stroke, SvgCanvas, TextStyle, truncate_to_width};

/// Background of maps and charts.
pub(crate) const SPACE_COLOUR: &str = "#0b0f15";
/// Colour of the sector of an aim.
pub(crate) const AIM_COLOUR: &str = "#ffa657";
/// Colours of agents, by index.
pub(crate) const AGENT_COLOURS: [&str; 5] = ["#6cb6ff", "#7ee0a1", "#d2a8ff", "#f2cc60", "#ff9bce"];

/// Place of a title on its page.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TitlePage {
    /// Left end of the title.
    pub(crate) left: f64,
    /// Largest width of the title.
    pub(crate) width: f64,
}

/// Draws the name of a layout, a line about its kind and aim, and the scenario with its scores. `params` are its most important
/// params.
pub(crate) fn draw_title(
    canvas: &mut SvgCanvas,
    layout: LayoutView<'_>,
    subtitle: &str,
    params: &[String],
    page: TitlePage,
) {
    let TitlePage { left: x, width } = page;
    let name = truncate_to_width(layout.name, width, 20.0);
    canvas.text((x, 30.0), TextStyle::new(20.0).bold(), &name);
    canvas.text((x, 52.0), TextStyle::new(14.0), &truncate_to_width(subtitle, width, 14.0));
    let bracket = layout.bracket;
    let details = format!(
        "{} · {} · scores: hold {:.3}, floor {:.3}, reference {:.3}",
        layout.scenario.task().id(),
        params.join(", "),
        bracket.hold_score(),
        bracket.floor,
        bracket.reference.score
    );
    let details = truncate_to_width(&details, width, 12.5);
    canvas.text((x, 72.0), TextStyle::new(12.5).colour(DIM), &details);
}

/// Writer of legend entries, from top to bottom.
pub(crate) struct Legend<'a> {
    canvas: &'a mut SvgCanvas,
    x: f64,
    y: f64,
}

impl<'a> Legend<'a> {
    /// Starts a legend at its top left corner.
    pub(crate) const fn new(canvas: &'a mut SvgCanvas, corner: Point) -> Self {
        Self { canvas, x: corner.0, y: corner.1 + 10.0 }
    }

    /// Returns the bottom of the last entry.
    pub(crate) const fn bottom(&self) -> f64 {
        self.y
    }

    /// Adds an entry. `draw_sample` gets the point at the left end of the sample, which may be 36 wide.
    pub(crate) fn entry(&mut self, text: &str, draw_sample: impl FnOnce(&mut SvgCanvas, f64, f64)) {
        draw_sample(self.canvas, self.x, self.y - 4.0);
        self.canvas.text((self.x + 42.0, self.y), TextStyle::new(12.0), text);
        self.y += 19.0;
    }

    /// Adds an entry with a line as its sample.
    pub(crate) fn line_entry(&mut self, text: &str, stroke: Stroke) {
        self.entry(text, |canvas, x, y| canvas.line(&[(x + 2.0, y), (x + 34.0, y)], stroke));
    }
}
