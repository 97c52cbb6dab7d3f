//! Figure of a comparison: curves of groups on one axis, with a legend. It is drawn on any backend of `plotters`.

use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::curves::{FigureAxis, Line, MeanBand, Quantity, mean_curve};
use super::groups::RunGroup;
use crate::report::chart::{INK, Interval, PALE};

/// Width of a figure, and height of its chart, in pixels.
const CHART: (u32, u32) = (560, 260);
/// Height of a line of the legend in pixels.
const LEGEND_LINE: u32 = 18;
/// Average width of a character of the legend in pixels.
const CHARACTER_WIDTH: usize = 6;
/// Width of the sample and of the gaps of an entry of the legend in pixels.
const SAMPLE_WIDTH: usize = 46;
/// Number of positions of a curve.
const GRID_POINTS: usize = 240;
/// Colours of the dashboard's comparison, which readers with colour blindness can tell apart.
const COLOURS: [RGBColor; 8] = [
    RGBColor(0x00, 0x72, 0xb2),
    RGBColor(0xd5, 0x5e, 0x00),
    RGBColor(0x00, 0x93, 0x6a),
    RGBColor(0xb0, 0x54, 0x8a),
    RGBColor(0x6e, 0x5a, 0x00),
    RGBColor(0x1b, 0x24, 0x30),
    RGBColor(0x35, 0x98, 0xd6),
    RGBColor(0x86, 0x28, 0x5a),
];
/// Lengths of dashes and gaps in pixels, of the curves after the first eight.
const DASHES: [Option<(i32, i32)>; 4] = [None, Some((8, 4)), Some((2, 3)), Some((12, 6))];

/// Chart whose curves share their positions.
#[derive(Debug)]
pub(super) struct Figure {
    /// Name of the figure's files, without an extension.
    pub(super) stem: String,
    /// Title of the figure.
    pub(super) title: String,
    axis: FigureAxis,
    quantity: Quantity,
    grid: Vec<f64>,
    curves: Vec<FigureCurve>,
}

/// Curve of a group.
#[derive(Debug)]
struct FigureCurve {
    label: String,
    /// Position of the group, which determines colour and dashes.
    style: usize,
    values: Vec<Option<MeanBand>>,
    /// True if the values are means of several runs, with intervals.
    is_mean: bool,
    is_stepped: bool,
}

/// Returns the figure of a quantity of a task. `lines` has one line for each run.
pub(super) fn task_figure(
    task: &str,
    quantity: Quantity,
    axis: FigureAxis,
    lines: &[Line],
    groups: &[RunGroup],
) -> Figure {
    let last = lines.iter().filter_map(|line| line.points.last()).map(|(x, _)| *x).fold(0.0, f64::max);
    let grid: Vec<f64> = (0..GRID_POINTS).map(|i| last * i as f64 / (GRID_POINTS - 1) as f64).collect();
    let curve = |(style, group): (usize, &RunGroup)| {
        let members: Vec<&Line> =
            group.runs.iter().map(|at| &lines[*at]).filter(|line| !line.points.is_empty()).collect();
        let n = members.len();
        (n > 0).then(|| FigureCurve {
            label: if n > 1 { format!("{} ({n} runs)", group.label) } else { group.label.clone() },
            style,
            values: mean_curve(&members, &grid, quantity.bounds()),
            is_mean: n > 1,
            is_stepped: members[0].is_stepped,
        })
    };
    let curves = groups.iter().enumerate().filter_map(curve).collect();
    let short = task.rsplit('/').next().unwrap_or(task).replace('_', " ");
    Figure {
        stem: format!("{}-{}", task.replace(['/', '_'], "-"), quantity.slug()),
        title: format!("{} of {short}", quantity.name()),
        axis,
        quantity,
        curves,
        grid,
    }
}

impl Figure {
    /// True if a curve is a mean of several runs.
    pub(super) fn has_means(&self) -> bool {
        self.curves.iter().any(|curve| curve.is_mean)
    }

    /// Returns width and height in pixels.
    pub(super) fn size(&self) -> (u32, u32) {
        let lines = self.legend_places().last().map_or(0, |(_, line)| line + 1);
        (CHART.0, CHART.1 + 8 + LEGEND_LINE * u32::try_from(lines).unwrap_or(0))
    }

    /// Draws the figure as an SVG document.
    ///
    /// # Errors
    /// Returns an error if the drawing backend fails.
    pub(super) fn svg(&self) -> anyhow::Result<String> {
        let mut text = String::new();
        {
            let root = SVGBackend::with_string(&mut text, self.size()).into_drawing_area();
            self.draw(&root).map_err(|error| anyhow::anyhow!("a figure cannot be drawn: {error}"))?;
        }
        Ok(text)
    }

    /// Returns the values as comma-separated text: a column for each curve, and two for each interval.
    ///
    /// # Errors
    /// Returns an error if the text cannot be written.
    pub(super) fn csv(&self) -> anyhow::Result<Vec<u8>> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        let mut head = vec![self.axis.label().to_owned()];
        for curve in &self.curves {
            head.push(curve.label.clone());
            if curve.is_mean {
                head.extend([format!("{}, low", curve.label), format!("{}, high", curve.label)]);
            }
        }
        writer.write_record(&head)?;
        for (i, at) in self.grid.iter().enumerate() {
            let mut row = vec![at.to_string()];
            for curve in &self.curves {
                let band = curve.values[i];
                let text = |value: &dyn Fn(MeanBand) -> f64| {
                    band.map_or_else(String::new, |band| value(band).to_string())
                };
                row.push(text(&|band| band.mean));
                if curve.is_mean {
                    row.extend([text(&|band| band.interval.low), text(&|band| band.interval.high)]);
                }
            }
            writer.write_record(&row)?;
        }
        Ok(writer.into_inner()?)
    }

    /// Draws the chart, and the legend below it.
    ///
    /// # Errors
    /// Returns the error of the drawing backend.
    pub(super) fn draw<DB: DrawingBackend>(
        &self,
        root: &DrawingArea<DB, Shift>,
    ) -> Result<(), DrawingAreaErrorKind<DB::ErrorType>> {
        let (upper, lower) = root.split_vertically(CHART.1);
        let Interval { low, high } = self.limits();
        let end = self.grid.last().copied().filter(|end| *end > 0.0).unwrap_or(1.0);
        let mut chart = ChartBuilder::on(&upper)
            .margin(6)
            .margin_right(24) // half of the last label
            .x_label_area_size(38)
            .y_label_area_size(50)
            .build_cartesian_2d(0.0..end, low..high)?;
        let round = |value: f64| ((value * 1e6).round() / 1e6).to_string();
        let is_count = self.axis != FigureAxis::Hours;
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(PALE)
            .axis_style(PALE)
            .label_style(("sans-serif", 11).into_font().color(&INK))
            .axis_desc_style(("sans-serif", 12).into_font().color(&INK))
            .x_desc(self.axis.label())
            .y_desc(self.quantity.name().to_lowercase())
            .x_labels(6)
            .y_labels(5)
            .x_label_formatter(&|x: &f64| if is_count { short_count(*x) } else { round(*x) })
            .y_label_formatter(&|y: &f64| round(*y))
            .draw()?;
        for curve in self.curves.iter().filter(|curve| curve.is_mean) {
            self.draw_band(&mut chart, curve)?;
        }
        for curve in &self.curves {
            self.draw_curve(&mut chart, curve)?;
        }
        self.draw_legend(&lower)?;
        root.present()
    }

    fn draw_band<DB: DrawingBackend>(
        &self,
        chart: &mut ChartContext<'_, DB, Cartesian2d<RangedCoordf64, RangedCoordf64>>,
        curve: &FigureCurve,
    ) -> Result<(), DrawingAreaErrorKind<DB::ErrorType>> {
        let known =
            || self.grid.iter().zip(&curve.values).filter_map(|(x, band)| Some((*x, (*band)?.interval)));
        let upper: Vec<_> = known().map(|(x, interval)| (x, interval.high)).collect();
        let lower = known().map(|(x, interval)| (x, interval.low));
        let outline: Vec<_> = lower.chain(upper.into_iter().rev()).collect();
        if outline.len() > 3 {
            chart.draw_series([Polygon::new(outline, COLOURS[curve.style % 8].mix(0.18))])?;
        }
        Ok(())
    }

    fn draw_curve<DB: DrawingBackend>(
        &self,
        chart: &mut ChartContext<'_, DB, Cartesian2d<RangedCoordf64, RangedCoordf64>>,
        curve: &FigureCurve,
    ) -> Result<(), DrawingAreaErrorKind<DB::ErrorType>> {
        let mut points = Vec::<(f64, f64)>::with_capacity(2 * self.grid.len());
        for (x, band) in self.grid.iter().zip(&curve.values) {
            let Some(band) = band else { continue };
            // A level changes in a step.
            if let Some((_, before)) = points.last().copied().filter(|_| curve.is_stepped) {
                points.push((*x, before));
            }
            points.push((*x, band.mean));
        }
        let style = COLOURS[curve.style % 8].stroke_width(2);
        if let [alone] = points[..] {
            chart.draw_series([Circle::new(alone, 2, style.filled())])?;
        } else if let Some((dash, gap)) = DASHES[curve.style / 8 % 4] {
            chart.draw_series(DashedLineSeries::new(points, dash, gap, style))?;
        } else {
            chart.draw_series(LineSeries::new(points, style))?;
        }
        Ok(())
    }

    /// Returns left end in pixels and line of each entry of the legend.
    fn legend_places(&self) -> Vec<(usize, usize)> {
        let (mut x, mut line) = (12, 0);
        let mut places = Vec::new();
        for curve in &self.curves {
            let length = SAMPLE_WIDTH + CHARACTER_WIDTH * curve.label.chars().count();
            if x > 12 && x + length > CHART.0 as usize {
                (x, line) = (12, line + 1);
            }
            places.push((x, line));
            x += length;
        }
        places
    }

    fn draw_legend<DB: DrawingBackend>(
        &self,
        area: &DrawingArea<DB, Shift>,
    ) -> Result<(), DrawingAreaErrorKind<DB::ErrorType>> {
        let pixels = |n: usize| i32::try_from(n).unwrap_or(i32::MAX);
        for (curve, (x, line)) in self.curves.iter().zip(self.legend_places()) {
            let (x, y) = (pixels(x), 10 + pixels(line) * LEGEND_LINE.cast_signed());
            let style = COLOURS[curve.style % 8].stroke_width(2);
            let (dash, gap) = DASHES[curve.style / 8 % 4].unwrap_or((24, 0));
            let mut from = x;
            while from < x + 24 {
                area.draw(&PathElement::new([(from, y), ((from + dash).min(x + 24), y)], style))?;
                from += dash + gap;
            }
            let text = ("sans-serif", 12).into_font().color(&INK).pos(Pos::new(HPos::Left, VPos::Center));
            area.draw(&Text::new(curve.label.clone(), (x + 30, y), text))?;
        }
        Ok(())
    }

    /// Returns the range of the value axis: of rates 0 to 1, of levels at least 0 to 4, otherwise that of the curves with a margin.
    fn limits(&self) -> Interval {
        let bands = || self.curves.iter().flat_map(|curve| curve.values.iter().flatten());
        let high = bands().map(|band| band.interval.high).fold(f64::NEG_INFINITY, f64::max);
        let low = bands().map(|band| band.interval.low).fold(f64::INFINITY, f64::min);
        match self.quantity {
            Quantity::Success => Interval { low: 0.0, high: 1.0 },
            Quantity::Level | Quantity::Rung => Interval { low: 0.0, high: high.max(3.0) + 1.0 },
            Quantity::Skill if low > high => Interval { low: 0.0, high: 1.0 },
            Quantity::Skill => {
                let margin = if high > low { 0.08 * (high - low) } else { 0.5 };
                Interval { low: low - margin, high: high + margin }
            }
        }
    }
}

/// Formats a count: 1500000 as "1.5M", 20000 as "20k".
fn short_count(value: f64) -> String {
    let (size, unit) = match value.abs() {
        size if size >= 1e6 => (1e6, "M"),
        size if size >= 1e4 => (1e3, "k"),
        _ => (1.0, ""),
    };
    format!("{}{unit}", ((value / size) * 1e3).round() / 1e3)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure(runs: usize) -> Figure {
        let line = |slope: f64| Line {
            points: (0..=10).map(|x| (f64::from(x), slope * f64::from(x) / 100.0)).collect(),
            is_stepped: false,
        };
        let lines: Vec<Line> = (0..runs).map(|run| line(run as f64)).collect();
        let groups: Vec<RunGroup> =
            (0..runs).map(|run| RunGroup { label: format!("arm, {run}"), runs: vec![run] }).collect();
        task_figure("kessler/eco_station", Quantity::Success, FigureAxis::Episodes, &lines, &groups)
    }

    #[test]
    fn curves_after_the_eighth_are_dashed() {
        let (eight, nine) = (figure(8).svg().unwrap(), figure(9).svg().unwrap());
        assert!(eight.matches("<polyline").count() < 40, "solid lines are one path each");
        assert!(nine.matches("<polyline").count() > eight.matches("<polyline").count() + 10);
        assert!(nine.contains("arm, 8"));
    }

    #[test]
    fn csv_has_a_column_for_each_curve() {
        let figure = figure(2);
        assert_eq!(figure.stem, "kessler-eco-station-success");
        let text = String::from_utf8(figure.csv().unwrap()).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), GRID_POINTS + 1);
        assert_eq!(lines[0], "episodes of the task,\"arm, 0\",\"arm, 1\"");
        assert_eq!(lines[GRID_POINTS], "10,0,0.1");
    }

    #[test]
    fn group_of_several_runs_has_an_interval() {
        let line = |value: f64| Line { points: vec![(0.0, value), (4.0, value)], is_stepped: true };
        let groups = [RunGroup { label: "all".to_owned(), runs: vec![0, 1] }];
        let figure = task_figure(
            "docking/single",
            Quantity::Level,
            FigureAxis::Steps,
            &[line(1.0), line(3.0)],
            &groups,
        );
        assert!(figure.has_means() && figure.svg().unwrap().contains("<polygon"));
        let text = String::from_utf8(figure.csv().unwrap()).unwrap();
        assert!(
            text.starts_with("environment steps of the task,all (2 runs),\"all (2 runs), low\""),
            "{text}"
        );
        assert!(text.contains("\n4,2,1,3\n"), "{text}");
    }

    #[test]
    fn counts_are_short() {
        assert_eq!([0.0, 9_500.0, 20_000.0, 1_500_000.0].map(short_count), ["0", "9500", "20k", "1.5M"]);
    }
}
