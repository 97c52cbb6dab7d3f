//! Draws simulations: the difficulty of the faced scenarios and the skill of the learner.

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::CompletedSimulation;
use crate::plot::{DrawResult, SvgArea};
use curriculum::MoveKind;
use curriculum::simulation::{SimulatedGroup, SimulatedMove};

/// Width and height of one simulation's panel in pixels.
const PANEL: (u32, u32) = (320, 210);
/// Height of the legend in pixels.
const LEGEND_HEIGHT: u32 = 34;
/// Largest number of panels in a row.
const MAX_COLUMNS: usize = 4;
/// Number of sections into which the band is divided.
const SECTIONS: usize = 80;
/// Range of the value axis in rows of the level table; untrained learners are below row 0.
const ROWS: std::ops::Range<f64> = -3.5..10.0;

const FACED: RGBColor = RGBColor(31, 119, 180);
const SKILL: RGBColor = RGBColor(214, 39, 40);
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
    let size = (
        PANEL.0 * u32::try_from(beside).unwrap_or(1),
        PANEL.1 * u32::try_from(below).unwrap_or(1) + LEGEND_HEIGHT,
    );
    let mut text = String::new();
    {
        let root = SVGBackend::with_string(&mut text, size).into_drawing_area();
        root.fill(&WHITE).map_err(|error| error.to_string())?;
        let (head, rest) = root.split_vertically(LEGEND_HEIGHT);
        legend(&head).map_err(|error| error.to_string())?;
        for (one, area) in simulated.iter().zip(rest.split_evenly((below, beside))) {
            part(one, &area, episodes).map_err(|error| error.to_string())?;
        }
        root.present().map_err(|error| error.to_string())?;
    }
    Ok(text)
}

fn legend(area: &SvgArea<'_>) -> DrawResult {
    let words = [
        (FACED, "rows faced: median and the middle eight tenths"),
        (SKILL, "skill of the learner, rows"),
        (SUCCESS, "success on contested scenarios, 0 to 10 for 0 to 1"),
        (INK, "▲ up  ▼ down"),
    ];
    let mut x = 12;
    for (color, words) in words {
        area.draw(&Rectangle::new([(x, 12), (x + 14, 18)], color.filled()))?;
        let style = ("sans-serif", 12).into_font().color(&INK).pos(Pos::new(HPos::Left, VPos::Center));
        area.draw(&Text::new(words, (x + 20, 15), style))?;
        x += 34 + 6 * i32::try_from(words.chars().count()).unwrap_or(0);
    }
    Ok(())
}

fn part(one: &CompletedSimulation, area: &SvgArea<'_>, episodes: u64) -> DrawResult {
    let title = format!("{} × {}", one.strategy.name(), one.learner.name());
    let mut chart = ChartBuilder::on(area)
        .margin(6)
        .caption(title, ("sans-serif", 13).into_font().color(&INK))
        .x_label_area_size(18)
        .y_label_area_size(24)
        .build_cartesian_2d(0.0..episodes as f64, ROWS)?;
    let thousands = |x: &f64| format!("{:.0}k", x / 1000.0);
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(RGBColor(225, 225, 225))
        .axis_style(RGBColor(150, 150, 150))
        .label_style(("sans-serif", 10).into_font().color(&INK))
        .x_labels(4)
        .x_label_formatter(&thousands)
        .y_labels(6)
        .draw()?;
    let sections: Vec<Section> = sections(&one.track.groups, episodes);
    let band: Vec<(f64, f64)> = {
        let upper = sections.iter().map(|s| (s.at, s.high));
        upper.chain(sections.iter().rev().map(|s| (s.at, s.low))).collect()
    };
    if band.len() > 2 {
        chart.draw_series([Polygon::new(band, FACED.mix(0.2))])?;
    }
    let line = |value: fn(&Section) -> f64| sections.iter().map(move |s| (s.at, value(s)));
    chart.draw_series(LineSeries::new(line(|s| s.middle), FACED.stroke_width(1)))?;
    let success = sections.iter().filter_map(|s| Some((s.at, 10.0 * s.success?)));
    chart.draw_series(LineSeries::new(success, SUCCESS.stroke_width(1)))?;
    chart.draw_series(LineSeries::new(line(|s| s.skill), SKILL.stroke_width(2)))?;
    for SimulatedMove { episodes_before, level_move } in &one.track.moves {
        let sign = match level_move.kind {
            MoveKind::Up => "▲",
            MoveKind::Down => "▼",
            MoveKind::Placement => continue,
        };
        let style = ("sans-serif", 8).into_font().color(&INK).pos(Pos::new(HPos::Center, VPos::Center));
        chart.draw_series([Text::new(sign, (*episodes_before as f64, -3.0), style)])?;
    }
    Ok(())
}

/// Section of a simulation over all tasks.
struct Section {
    at: f64,
    low: f64,
    middle: f64,
    high: f64,
    skill: f64,
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
        let mut faced: Vec<f64> = these.iter().map(|sample| sample.difficulty).collect();
        faced.sort_by(f64::total_cmp);
        let quantile = |share: f64| orchestrator::evaluation::bootstrap::quantile(&faced, share);
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
            skill: these.iter().map(|sample| sample.skill).sum::<f64>() / these.len() as f64,
            success: (finished > 0).then(|| successes as f64 / finished as f64),
        });
    }
    sections
}
