//! Draws simulations: the difficulty of the proposed scenarios, the ability of the learner, and its success.

use std::ops::Range;

use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::CompletedSimulation;
use crate::plot::{DrawResult, SvgArea};
use curriculum::MoveKind;
use curriculum::simulation::{SimulatedGroup, SimulatedMove};

/// Width and height of one simulation's panel in pixels.
const PANEL: (u32, u32) = (320, 300);
/// Height of the part of a panel that shows levels, in pixels; the rest shows success.
const LEVELS_HEIGHT: u32 = 184;
/// Largest number of panels in a row.
const MAX_COLUMNS: usize = 4;
/// Height of a line of the legend in pixels.
const LEGEND_LINE: i32 = 18;
/// Average width of a character of the legend in pixels.
const CHARACTER_WIDTH: i32 = 6;
/// Number of sections into which a simulation is divided.
const SECTIONS: usize = 80;
/// Range of the axis of levels; the ability of an untrained learner is below level 0.
const LEVELS: Range<f64> = -4.6..10.4;
/// Position of the marks of level moves on the axis of levels.
const MARKS_AT: f64 = -4.0;

const DIFFICULTY: RGBColor = RGBColor(31, 119, 180);
const ABILITY: RGBColor = RGBColor(214, 39, 40);
const SUCCESS: RGBColor = RGBColor(44, 160, 44);
const INK: RGBColor = RGBColor(60, 60, 60);

/// Draws all simulations as panels of one SVG document.
///
/// # Errors
/// Returns the message of the drawing backend if it fails.
pub(super) fn draw(simulated: &[CompletedSimulation], episodes: u64) -> Result<String, String> {
    let learners = simulated.iter().filter(|one| one.strategy == simulated[0].strategy).count();
    let beside = learners.clamp(1, MAX_COLUMNS);
    let below = simulated.len().div_ceil(beside);
    let width = PANEL.0 * u32::try_from(beside).unwrap_or(1);
    let legend = legend_entries(i32::try_from(width).unwrap_or(i32::MAX));
    let lines = legend.last().map_or(0, |entry| entry.line + 1);
    let legend_height = u32::try_from(LEGEND_LINE * lines + 12).unwrap_or(0);
    let size = (width, PANEL.1 * u32::try_from(below).unwrap_or(1) + legend_height);
    let mut text = String::new();
    {
        let root = SVGBackend::with_string(&mut text, size).into_drawing_area();
        root.fill(&WHITE).map_err(|error| error.to_string())?;
        let (head, rest) = root.split_vertically(legend_height);
        draw_legend(&legend, &head).map_err(|error| error.to_string())?;
        for (one, area) in simulated.iter().zip(rest.split_evenly((below, beside))) {
            draw_panel(one, &area, episodes).map_err(|error| error.to_string())?;
        }
        root.present().map_err(|error| error.to_string())?;
    }
    Ok(text)
}

/// Sample of a legend entry.
#[derive(Clone, Copy)]
enum Sample {
    Line(RGBColor),
    /// Line within a band.
    Band(RGBColor),
    /// Triangle whose tip points up or down.
    Triangle {
        is_upward: bool,
    },
}

/// Entry of the legend with its place.
struct LegendEntry {
    sample: Sample,
    text: &'static str,
    /// Left end in pixels.
    x: i32,
    /// Number of the line, from the top.
    line: i32,
}

/// Places the entries of the legend in as many lines as the width needs.
fn legend_entries(width: i32) -> Vec<LegendEntry> {
    let entries = [
        (Sample::Band(DIFFICULTY), "difficulty of the scenarios: median, middle 80 %"),
        (Sample::Line(ABILITY), "ability of the learner"),
        (Sample::Line(SUCCESS), "success on contested scenarios"),
        (Sample::Triangle { is_upward: true }, "level up"),
        (Sample::Triangle { is_upward: false }, "level down"),
    ];
    let (mut x, mut line) = (12, 0);
    let mut placed = Vec::new();
    for (sample, text) in entries {
        let length = 26 + CHARACTER_WIDTH * i32::try_from(text.chars().count()).unwrap_or(0);
        if x > 12 && x + length > width {
            (x, line) = (12, line + 1);
        }
        placed.push(LegendEntry { sample, text, x, line });
        x += length + 10;
    }
    placed
}

fn draw_legend(entries: &[LegendEntry], area: &SvgArea<'_>) -> DrawResult {
    for LegendEntry { sample, text, x, line } in entries {
        let y = 14 + LEGEND_LINE * line;
        match *sample {
            Sample::Line(color) => {
                area.draw(&PathElement::new([(*x, y), (x + 18, y)], color.stroke_width(2)))?;
            }
            Sample::Band(color) => {
                area.draw(&Rectangle::new([(*x, y - 5), (x + 18, y + 5)], color.mix(0.2).filled()))?;
                area.draw(&PathElement::new([(*x, y), (x + 18, y)], color.stroke_width(2)))?;
            }
            Sample::Triangle { is_upward } => area.draw(&triangle((x + 9, y), is_upward))?,
        }
        let style = ("sans-serif", 12).into_font().color(&INK).pos(Pos::new(HPos::Left, VPos::Center));
        area.draw(&Text::new(*text, (x + 24, y), style))?;
    }
    Ok(())
}

/// Mark of a level move.
fn triangle<Point>(at: Point, is_upward: bool) -> TriangleMarker<Point, i32> {
    TriangleMarker::new(at, if is_upward { 4 } else { -4 }, INK.filled())
}

fn draw_panel(one: &CompletedSimulation, area: &SvgArea<'_>, episodes: u64) -> DrawResult {
    let sections: Vec<Section> = sections(&one.track.groups, episodes);
    let (upper, lower) = area.split_vertically(LEVELS_HEIGHT);
    draw_levels(one, &sections, &upper, episodes)?;
    draw_success(&sections, &lower, episodes)
}

/// Draws the difficulty of the scenarios, the ability of the learner, and the level moves.
fn draw_levels(
    one: &CompletedSimulation,
    sections: &[Section],
    area: &SvgArea<'_>,
    episodes: u64,
) -> DrawResult {
    let title = format!("{} × {}", one.strategy.name(), one.learner);
    let mut builder = ChartBuilder::on(area);
    builder.caption(title, ("sans-serif", 13).into_font().color(&INK));
    let mut chart = build_chart(&mut builder, episodes, LEVELS, "level")?;
    let band: Vec<(f64, f64)> = {
        let upper = sections.iter().map(|s| (s.at, s.high));
        upper.chain(sections.iter().rev().map(|s| (s.at, s.low))).collect()
    };
    if band.len() > 2 {
        chart.draw_series([Polygon::new(band, DIFFICULTY.mix(0.2))])?;
    }
    let line = |value: fn(&Section) -> f64| sections.iter().map(move |s| (s.at, value(s)));
    chart.draw_series(LineSeries::new(line(|s| s.middle), DIFFICULTY.stroke_width(1)))?;
    chart.draw_series(LineSeries::new(line(|s| s.ability), ABILITY.stroke_width(2)))?;
    for SimulatedMove { episodes_before, level_move } in &one.track.moves {
        let is_upward = match level_move.kind {
            MoveKind::Up => true,
            MoveKind::Down => false,
            MoveKind::Placement => continue,
        };
        chart.draw_series([triangle((*episodes_before as f64, MARKS_AT), is_upward)])?;
    }
    Ok(())
}

/// Draws the success rate on contested scenarios.
fn draw_success(sections: &[Section], area: &SvgArea<'_>, episodes: u64) -> DrawResult {
    let mut builder = ChartBuilder::on(area);
    let mut chart = build_chart(&mut builder, episodes, 0.0..1.0, "success")?;
    let success = sections.iter().filter_map(|s| Some((s.at, s.success?)));
    chart.draw_series(LineSeries::new(success, SUCCESS.stroke_width(1)))?;
    Ok(())
}

/// Chart in a part of a panel, with episodes on the horizontal axis.
type PanelChart<'area, 'text> =
    ChartContext<'area, SVGBackend<'text>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// Builds a chart and draws its axes.
fn build_chart<'area, 'text>(
    builder: &mut ChartBuilder<'area, '_, SVGBackend<'text>>,
    episodes: u64,
    values: Range<f64>,
    values_label: &str,
) -> Result<PanelChart<'area, 'text>, DrawingAreaErrorKind<std::io::Error>> {
    let is_share = values.end <= 1.0;
    let mut chart = builder
        .margin(6)
        .margin_right(14) // half of the last label
        .x_label_area_size(32)
        .y_label_area_size(38)
        .build_cartesian_2d(0.0..episodes as f64, values)?;
    let format_episodes = |x: &f64| {
        if episodes < 10_000 || *x == 0.0 { format!("{x:.0}") } else { format!("{:.0}k", x / 1000.0) }
    };
    let format_value = |y: &f64| if is_share { format!("{y:.1}") } else { format!("{y:.0}") };
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(RGBColor(225, 225, 225))
        .axis_style(RGBColor(150, 150, 150))
        .label_style(("sans-serif", 11).into_font().color(&INK))
        .axis_desc_style(("sans-serif", 12).into_font().color(&INK))
        .x_desc("episodes")
        .y_desc(values_label)
        .x_labels(4)
        .x_label_formatter(&format_episodes)
        .y_labels(if is_share { 3 } else { 6 })
        .y_label_formatter(&format_value)
        .draw()?;
    Ok(chart)
}

/// Section of a simulation over all tasks.
struct Section {
    at: f64,
    low: f64,
    middle: f64,
    high: f64,
    ability: f64,
    /// Share of successes on contested scenarios; `None` if there were none.
    success: Option<f64>,
}

fn sections(samples: &[SimulatedGroup], episodes: u64) -> Vec<Section> {
    let width = (episodes as f64 / SECTIONS as f64).max(1.0);
    let mut sections = Vec::new();
    for number in 0..SECTIONS {
        let (from, to) = (width * number as f64, width * (number + 1) as f64);
        let these: Vec<&SimulatedGroup> =
            samples.iter().filter(|s| (from..to).contains(&(s.episodes_before as f64))).collect();
        let mut difficulties: Vec<f64> = these.iter().map(|sample| sample.difficulty).collect();
        difficulties.sort_by(f64::total_cmp);
        let quantile = |share: f64| evaluation::bootstrap::quantile(&difficulties, share);
        let (Some(low), Some(middle), Some(high)) = (quantile(0.1), quantile(0.5), quantile(0.9)) else {
            continue;
        };
        let contested = these.iter().filter(|sample| sample.contested);
        let (successes, finished) = contested.fold((0u64, 0u64), |(s, f), sample| {
            (s + u64::from(sample.successes), f + u64::from(sample.finished))
        });
        sections.push(Section {
            at: 0.5 * (from + to),
            low,
            middle,
            high,
            ability: these.iter().map(|sample| sample.ability).sum::<f64>() / these.len() as f64,
            success: (finished > 0).then(|| successes as f64 / finished as f64),
        });
    }
    sections
}
