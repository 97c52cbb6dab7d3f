//! Draws the success rates of an evaluation with their intervals, one panel per task.

use api_types::{Estimate, EvaluationEstimates, SuiteSection};
use evaluation::EvaluationReport;
use evaluation::report::ALL_LABEL;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use crate::plot::{DrawResult, SvgArea};

/// Width of a panel in pixels.
const PANEL_WIDTH: u32 = 300;
/// Height of a policy's row in pixels.
const ROW: u32 = 22;
/// Width of the policy names on the left, in pixels.
const NAMES: u32 = 96;
/// Height of the title and the legend of the picture, in pixels.
const LEGEND: u32 = 46;
/// Height of the caption of a panel, in pixels: that of a text of size 13.
const HEAD: u32 = 20;
/// Height of the axis below a panel, in pixels.
const FOOT: u32 = 30;

const INK: RGBColor = RGBColor(60, 60, 60);
const PALE: RGBColor = RGBColor(225, 225, 225);
/// Parts of a suite with their colours: contested scenarios, then unfiltered ones.
const PARTS: [(SuiteSection, RGBColor); 2] =
    [(SuiteSection::Contested, RGBColor(214, 39, 40)), (SuiteSection::AsTheyCome, RGBColor(31, 119, 180))];

/// Draws an SVG document with one panel per task and one row per policy. Each row shows the success rate with its
/// interval, on contested and on unfiltered scenarios.
///
/// # Errors
/// Returns the message of the drawing backend if it fails.
pub(super) fn draw(report: &EvaluationReport) -> Result<String, String> {
    let mut tasks: Vec<&str> = Vec::new();
    let mut policies: Vec<&str> = Vec::new();
    for row in &report.rows {
        if row.task != ALL_LABEL && !tasks.contains(&row.task.as_str()) {
            tasks.push(&row.task);
        }
        if !policies.contains(&row.policy.as_str()) {
            policies.push(&row.policy);
        }
    }
    let wide = u32::try_from(tasks.len().clamp(1, 4)).unwrap_or(1);
    let high = u32::try_from(tasks.len().div_ceil(4).max(1)).unwrap_or(1);
    let part = HEAD + ROW * u32::try_from(policies.len()).unwrap_or(1) + FOOT;
    let mut text = String::new();
    {
        let root = SVGBackend::with_string(&mut text, (NAMES + PANEL_WIDTH * wide, part * high + LEGEND))
            .into_drawing_area();
        let message = |error: DrawingAreaErrorKind<std::io::Error>| error.to_string();
        root.fill(&WHITE).map_err(message)?;
        let (head, rest) = root.split_vertically(LEGEND);
        legend(&head, report).map_err(message)?;
        let (names, parts) = rest.split_horizontally(NAMES);
        for lines in names.split_evenly((high as usize, 1)) {
            for (at, policy) in (0i32..).zip(&policies) {
                let style =
                    ("sans-serif", 12).into_font().color(&INK).pos(Pos::new(HPos::Right, VPos::Center));
                let y = HEAD as i32 + ROW as i32 * at + ROW as i32 / 2;
                lines
                    .draw(&Text::new((*policy).to_owned(), (NAMES as i32 - 4, y), style))
                    .map_err(message)?;
            }
        }
        for (task, area) in tasks.iter().zip(parts.split_evenly((high as usize, wide as usize))) {
            let rows: Vec<&EvaluationEstimates> =
                report.rows.iter().filter(|row| row.task == *task).collect();
            draw_task(task, &rows, &policies, &area).map_err(message)?;
        }
        root.present().map_err(message)?;
    }
    Ok(text)
}

fn legend(area: &SvgArea<'_>, report: &EvaluationReport) -> DrawResult {
    let words = format!("{}: success rate with {:.0} % intervals", report.suite, 100.0 * report.confidence);
    let style = || ("sans-serif", 13).into_font().color(&INK).pos(Pos::new(HPos::Left, VPos::Center));
    area.draw(&Text::new(words, (8, 13), style()))?;
    let mut x = 14;
    for (part, color) in PARTS {
        area.draw(&Circle::new((x, 33), 4, color.filled()))?;
        let label = part.label();
        area.draw(&Text::new(label, (x + 10, 33), style()))?;
        x += 40 + 7 * i32::try_from(label.len()).unwrap_or(0);
    }
    Ok(())
}

fn draw_task(task: &str, rows: &[&EvaluationEstimates], policies: &[&str], area: &SvgArea<'_>) -> DrawResult {
    let count = policies.len().max(1) as f64;
    let mut chart = ChartBuilder::on(area)
        .margin_right(10)
        .margin_left(6)
        .caption(task, ("sans-serif", 13).into_font().color(&INK))
        .x_label_area_size(FOOT)
        .build_cartesian_2d(0.0..1.0, count..0.0)?;
    chart
        .configure_mesh()
        .disable_y_axis()
        .disable_y_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(PALE)
        .axis_style(PALE)
        .label_style(("sans-serif", 10).into_font().color(&INK))
        .x_labels(6)
        .x_desc("success rate")
        .axis_desc_style(("sans-serif", 11).into_font().color(&INK))
        .draw()?;
    for (at, policy) in policies.iter().enumerate() {
        for (number, (part, color)) in PARTS.into_iter().enumerate() {
            let row = rows.iter().find(|row| row.policy == *policy && row.part == part);
            let Some(Estimate { mean, low, high, .. }) = row.and_then(|row| row.success) else { continue };
            let y = at as f64 + 0.35 + 0.3 * number as f64;
            chart.draw_series([PathElement::new(vec![(low, y), (high, y)], color.stroke_width(2))])?;
            chart.draw_series([Circle::new((mean, y), 4, color.filled())])?;
        }
    }
    Ok(())
}
