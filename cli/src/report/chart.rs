//! Charts of curves over time, drawn as SVG.

use std::ops::Range;

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use plotters::prelude::*;

use clock::{Millis, rfc3339};
use commands::plot::{DrawResult, SvgArea};

const SIZE: (u32, u32) = (560, 210);
pub(super) const INK: RGBColor = RGBColor(60, 60, 60);
pub(super) const PALE: RGBColor = RGBColor(228, 228, 228);
/// Palette of Okabe & Ito (2008), which is safe for colour-blind readers.
pub(super) const BLUE: RGBColor = RGBColor(0, 114, 178);
pub(super) const ORANGE: RGBColor = RGBColor(213, 94, 0);
pub(super) const GREEN: RGBColor = RGBColor(0, 138, 99);
pub(super) const MAUVE: RGBColor = RGBColor(168, 73, 127);

/// Curve with its name, colour and values; unknown values are `None`.
#[derive(Debug)]
pub(super) struct Curve {
    pub(super) name: &'static str,
    pub(super) colour: RGBColor,
    pub(super) values: Vec<Option<f64>>,
    /// Interval around each value, drawn as a band.
    pub(super) intervals: Option<Vec<Option<Interval>>>,
}

/// Closed interval on the value axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Interval {
    pub(super) low: f64,
    pub(super) high: f64,
}

/// Triangle on the time axis at a level move.
#[derive(Debug, Clone, Copy)]
pub(super) struct LevelMark {
    /// Time of the move.
    pub(super) at: Millis,
    /// True unless the level went down.
    pub(super) is_upward: bool,
}

/// Chart of several curves over one time range.
#[derive(Debug)]
pub(super) struct Chart<'a> {
    /// Time of each value.
    pub(super) times: &'a [Millis],
    /// Time range of the chart.
    pub(super) range: Range<Millis>,
    /// Label of the value axis, with its unit.
    pub(super) value_label: &'a str,
    /// Range of the value axis; by default the range of the values with a margin.
    pub(super) limits: Option<Interval>,
    /// Values of the dashed horizontal lines.
    pub(super) thresholds: &'a [f64],
    /// Level moves, drawn as triangles.
    pub(super) marks: &'a [LevelMark],
    /// Curves of the chart.
    pub(super) curves: &'a [Curve],
}

/// Time axis with short labels in UTC.
struct TimeAxis(Range<Millis>);

impl Ranged for TimeAxis {
    type FormatOption = NoDefaultFormatting;
    type ValueType = Millis;

    #[expect(clippy::cast_possible_truncation, reason = "pixels of a picture")]
    fn map(&self, value: &Millis, limit: (i32, i32)) -> i32 {
        let Range { start, end } = self.0;
        let share = (value - start) as f64 / (end - start).max(1) as f64;
        limit.0 + (share * f64::from(limit.1 - limit.0)) as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<Millis> {
        let Range { start, end } = self.0;
        (0..=4).map(|nth| start + (end - start) * nth / 4).collect()
    }

    fn range(&self) -> std::ops::Range<Millis> {
        self.0.clone()
    }
}

impl ValueFormatter<Millis> for TimeAxis {
    fn format_ext(&self, value: &Millis) -> String {
        let text = rfc3339(*value); // 2026-01-31T12:00:00.000Z
        let part = |range: Range<usize>| text.get(range).unwrap_or_default();
        match self.0.end - self.0.start {
            length if length > 3 * 86_400_000 => part(5..10).to_owned(),
            length if length > 8 * 60_000 => format!("{} {}", part(5..10), part(11..16)),
            _ => part(11..19).to_owned(),
        }
    }
}

impl Chart<'_> {
    /// Draws the chart as an SVG document.
    ///
    /// # Errors
    /// Returns an error if the drawing backend fails.
    pub(super) fn draw(&self) -> anyhow::Result<String> {
        let mut text = String::new();
        {
            let root = SVGBackend::with_string(&mut text, SIZE).into_drawing_area();
            self.draw_on(&root).map_err(|error| anyhow::anyhow!("a chart cannot be drawn: {error}"))?;
        }
        Ok(text)
    }

    fn draw_on(&self, root: &SvgArea<'_>) -> DrawResult {
        let Interval { low, high } = self.limits.unwrap_or_else(|| self.value_range());
        let mut chart = ChartBuilder::on(root)
            .margin(6)
            .margin_right(34) // half of the last label
            .x_label_area_size(36)
            .y_label_area_size(52)
            .build_cartesian_2d(TimeAxis(self.range.clone()), low..high)?;
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(PALE)
            .axis_style(PALE)
            .label_style(("sans-serif", 11).into_font().color(&INK))
            .axis_desc_style(("sans-serif", 12).into_font().color(&INK))
            .x_desc("time (UTC)")
            .y_desc(self.value_label)
            .y_labels(5)
            .y_label_formatter(&|value: &f64| ((value * 1e6).round() / 1e6).to_string())
            .draw()?;
        for threshold in self.thresholds {
            let ends = [(self.range.start, *threshold), (self.range.end, *threshold)];
            chart.draw_series(DashedLineSeries::new(ends, 5, 4, INK.stroke_width(1)))?;
        }
        for curve in self.curves {
            self.draw_band(&mut chart, curve)?;
            for part in self.parts(&curve.values) {
                if let [alone] = part[..] {
                    chart.draw_series([Circle::new(alone, 2, curve.colour.filled())])?;
                } else {
                    chart.draw_series(LineSeries::new(part, curve.colour.stroke_width(2)))?;
                }
            }
        }
        for LevelMark { at, is_upward } in self.marks {
            let (colour, size) = if *is_upward { (GREEN, 6) } else { (ORANGE, -6) };
            chart.draw_series([TriangleMarker::new((*at, low), size, colour.filled())])?;
        }
        root.present()
    }

    fn draw_band(
        &self,
        chart: &mut ChartContext<
            '_,
            SVGBackend<'_>,
            Cartesian2d<TimeAxis, plotters::coord::types::RangedCoordf64>,
        >,
        curve: &Curve,
    ) -> DrawResult {
        let Some(intervals) = &curve.intervals else { return Ok(()) };
        let known =
            || self.times.iter().zip(intervals).filter_map(|(at, interval)| Some((*at, (*interval)?)));
        let lower = known().map(|(at, interval)| (at, interval.low));
        let upper: Vec<_> = known().map(|(at, interval)| (at, interval.high)).collect();
        let outline: Vec<_> = lower.chain(upper.into_iter().rev()).collect();
        if outline.len() > 3 {
            chart.draw_series([Polygon::new(outline, curve.colour.mix(0.18))])?;
        }
        Ok(())
    }

    /// Splits a curve at its unknown values.
    fn parts(&self, values: &[Option<f64>]) -> Vec<Vec<(Millis, f64)>> {
        let mut parts = vec![Vec::new()];
        for (at, value) in self.times.iter().zip(values) {
            match (value, parts.last_mut()) {
                (Some(value), Some(part)) => part.push((*at, *value)),
                (None, Some(part)) if !part.is_empty() => parts.push(Vec::new()),
                _ => {}
            }
        }
        parts.retain(|part| !part.is_empty());
        parts
    }

    /// Returns the range of all values with a margin of 8 %.
    fn value_range(&self) -> Interval {
        let values = || self.curves.iter().flat_map(|curve| curve.values.iter().flatten().copied());
        let low = values().fold(f64::INFINITY, f64::min);
        let high = values().fold(f64::NEG_INFINITY, f64::max);
        if low > high {
            return Interval { low: 0.0, high: 1.0 };
        }
        let margin = if high > low { 0.08 * (high - low) } else { 0.5 };
        Interval { low: low - margin, high: high + margin }
    }
}
