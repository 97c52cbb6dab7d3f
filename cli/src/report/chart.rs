//! Curves over time, as SVG.

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use plotters::prelude::*;

use orchestrator::clock::{Millis, rfc3339};

const SIZE: (u32, u32) = (560, 190);
const INK: RGBColor = RGBColor(60, 60, 60);
const PALE: RGBColor = RGBColor(228, 228, 228);
/// Okabe & Ito (2008): told apart by everybody.
pub(super) const BLUE: RGBColor = RGBColor(0, 114, 178);
pub(super) const ORANGE: RGBColor = RGBColor(213, 94, 0);
pub(super) const GREEN: RGBColor = RGBColor(0, 138, 99);
pub(super) const MAUVE: RGBColor = RGBColor(168, 73, 127);

/// A curve: what it is called, its colour, and its values where they are known.
#[derive(Debug)]
pub(super) struct Curve {
    pub(super) name: &'static str,
    pub(super) colour: RGBColor,
    pub(super) values: Vec<Option<f64>>,
    /// An interval around each value.
    pub(super) around: Option<Vec<Option<(f64, f64)>>>,
}

/// A picture of some curves.
#[derive(Debug)]
pub(super) struct Chart<'a> {
    /// Where each value stands.
    pub(super) at: &'a [Millis],
    /// From when to when.
    pub(super) stretch: (Millis, Millis),
    /// The values' axis; as the values have it where none is given.
    pub(super) limits: Option<(f64, f64)>,
    /// Horizontal lines: thresholds.
    pub(super) lines: &'a [f64],
    /// Moments at which a level moved: when, and whether up.
    pub(super) marks: &'a [(Millis, bool)],
    /// The curves.
    pub(super) curves: &'a [Curve],
}

/// Times as an axis: labels are short, in UTC.
struct Times(Millis, Millis);

impl Ranged for Times {
    type FormatOption = NoDefaultFormatting;
    type ValueType = Millis;

    #[expect(clippy::cast_possible_truncation, reason = "pixels of a picture")]
    fn map(&self, value: &Millis, limit: (i32, i32)) -> i32 {
        let share = (value - self.0) as f64 / (self.1 - self.0).max(1) as f64;
        limit.0 + (share * f64::from(limit.1 - limit.0)) as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<Millis> {
        (0..=4).map(|nth| self.0 + (self.1 - self.0) * nth / 4).collect()
    }

    fn range(&self) -> std::ops::Range<Millis> {
        self.0..self.1
    }
}

impl ValueFormatter<Millis> for Times {
    fn format_ext(&self, value: &Millis) -> String {
        let text = rfc3339(*value); // 2026-01-31T12:00:00.000Z
        let (day, time) = (text.get(5..10).unwrap_or_default(), text.get(11..16).unwrap_or_default());
        if self.1 - self.0 > 3 * 86_400_000 { day.to_owned() } else { format!("{day} {time}") }
    }
}

impl Chart<'_> {
    /// Draws it: an SVG document.
    pub(super) fn draw(&self) -> anyhow::Result<String> {
        let mut text = String::new();
        {
            let root = SVGBackend::with_string(&mut text, SIZE).into_drawing_area();
            self.draw_on(&root).map_err(|error| anyhow::anyhow!("a picture: {error}"))?;
        }
        Ok(text)
    }

    fn draw_on(
        &self,
        root: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>,
    ) -> Result<(), DrawingAreaErrorKind<std::io::Error>> {
        let (low, high) = self.limits.unwrap_or_else(|| self.spread());
        let mut chart = ChartBuilder::on(root)
            .margin(6)
            .margin_right(34) // half of the last label
            .x_label_area_size(20)
            .y_label_area_size(38)
            .build_cartesian_2d(Times(self.stretch.0, self.stretch.1), low..high)?;
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(PALE)
            .axis_style(PALE)
            .label_style(("sans-serif", 11).into_font().color(&INK))
            .y_labels(5)
            .draw()?;
        for line in self.lines {
            let ends = [(self.stretch.0, *line), (self.stretch.1, *line)];
            chart.draw_series(DashedLineSeries::new(ends, 5, 4, INK.stroke_width(1)))?;
        }
        for curve in self.curves {
            self.band(&mut chart, curve)?;
            for part in self.parts(&curve.values) {
                if let [alone] = part[..] {
                    chart.draw_series([Circle::new(alone, 2, curve.colour.filled())])?;
                } else {
                    chart.draw_series(LineSeries::new(part, curve.colour.stroke_width(2)))?;
                }
            }
        }
        for (at, up) in self.marks {
            let colour = if *up { GREEN } else { ORANGE };
            chart.draw_series([TriangleMarker::new(
                (*at, low),
                if *up { 6 } else { -6 },
                colour.filled(),
            )])?;
        }
        root.present()
    }

    fn band(
        &self,
        chart: &mut ChartContext<
            '_,
            SVGBackend<'_>,
            Cartesian2d<Times, plotters::coord::types::RangedCoordf64>,
        >,
        curve: &Curve,
    ) -> Result<(), DrawingAreaErrorKind<std::io::Error>> {
        let Some(around) = &curve.around else { return Ok(()) };
        let known = || self.at.iter().zip(around).filter_map(|(at, ends)| Some((*at, (*ends)?)));
        let lower = known().map(|(at, (low, _))| (at, low));
        let upper: Vec<_> = known().map(|(at, (_, high))| (at, high)).collect();
        let around: Vec<_> = lower.chain(upper.into_iter().rev()).collect();
        if around.len() > 3 {
            chart.draw_series([Polygon::new(around, curve.colour.mix(0.18))])?;
        }
        Ok(())
    }

    /// A curve's parts between what is not known.
    fn parts(&self, values: &[Option<f64>]) -> Vec<Vec<(Millis, f64)>> {
        let mut parts = vec![Vec::new()];
        for (at, value) in self.at.iter().zip(values) {
            match (value, parts.last_mut()) {
                (Some(value), Some(part)) => part.push((*at, *value)),
                (None, Some(part)) if !part.is_empty() => parts.push(Vec::new()),
                _ => {}
            }
        }
        parts.retain(|part| !part.is_empty());
        parts
    }

    fn spread(&self) -> (f64, f64) {
        let values = || self.curves.iter().flat_map(|curve| curve.values.iter().flatten().copied());
        let low = values().fold(f64::INFINITY, f64::min);
        let high = values().fold(f64::NEG_INFINITY, f64::max);
        if low > high {
            return (0.0, 1.0);
        }
        let room = if high > low { 0.08 * (high - low) } else { 0.5 };
        (low - room, high + room)
    }
}
