//! The timeline of a satellite: sunlight, passes, windows, and tasks and resources by the reference plan.

use super::sky::{LayoutSky, PlannedKind, ResourceSample};
use super::style::{
    BATTERY_COLOUR, OUTAGE_COLOUR, STATION_COLOUR, STORAGE_COLOUR, SUN_COLOUR, TARGET_COLOUR, WORK_COLOUR,
    satellite_colour,
};
use super::{MARGIN, WIDTH};
use crate::picture_parts::SPACE_COLOUR;
use crate::svg::{DIM, GRID, Point, Stroke, SvgCanvas, TEXT, TextAnchor, TextStyle};
use crate::tasking::units::S_PER_MINUTE;

/// Left end of the time axis, right of the names of the rows.
const LEFT: f64 = MARGIN + 84.0;
/// Height of a row of bars.
const ROW: f64 = 13.0;
/// Height of the chart of resources.
const CHART: f64 = 62.0;
/// Distance of the marks of the axis, min.
const MARK_MINUTES: f64 = 30.0;

/// A curve of the chart.
struct ResourceCurve {
    colour: &'static str,
    /// Share of the limit.
    share: fn(&ResourceSample) -> f64,
}

/// Curves of the chart, the last on top.
const CURVES: [ResourceCurve; 3] = [
    ResourceCurve { colour: OUTAGE_COLOUR, share: |sample| sample.wheels },
    ResourceCurve { colour: STORAGE_COLOUR, share: |sample| sample.storage },
    ResourceCurve { colour: BATTERY_COLOUR, share: |sample| sample.battery },
];

/// Converts times to the page.
#[derive(Debug, Clone, Copy)]
struct TimeAxis {
    limit_s: f64,
}

impl TimeAxis {
    fn x(self, time_s: f64) -> f64 {
        LEFT + (time_s / self.limit_s).clamp(0.0, 1.0) * (WIDTH - MARGIN - LEFT)
    }

    /// Draws a bar between two times.
    fn bar(self, canvas: &mut SvgCanvas, y: f64, [from_s, to_s]: [f64; 2], colour: &str) {
        let (from, to) = (self.x(from_s), self.x(to_s));
        if to > from {
            let corners = [(from, y + 1.5), (to, y + 1.5), (to, y + ROW - 1.5), (from, y + ROW - 1.5)];
            canvas.area(&corners, colour, 1.0, None);
        }
    }
}

/// Returns the colour of a task.
pub(super) const fn task_colour(kind: PlannedKind) -> &'static str {
    match kind {
        PlannedKind::Work => WORK_COLOUR,
        PlannedKind::Charge => SUN_COLOUR,
        PlannedKind::Downlink => STATION_COLOUR,
        PlannedKind::Desaturate => OUTAGE_COLOUR,
    }
}

/// Draws the timeline of a satellite. Returns its bottom.
pub(super) fn draw(canvas: &mut SvgCanvas, sky: &LayoutSky, satellite: usize, top: f64) -> f64 {
    let axis = TimeAxis { limit_s: sky.forecast.time_limit_s.max(1.0) };
    let path = &sky.forecast.satellites[satellite];
    let title = TextStyle::new(12.0).colour(satellite_colour(satellite)).bold();
    canvas.text((MARGIN, top + 10.0), title, &format!("satellite {satellite}"));
    let mut y = top + 14.0;
    let mut row = |canvas: &mut SvgCanvas, name: &str, bars: &[([f64; 2], &'static str)]| {
        canvas.text((LEFT - 6.0, y + 10.0), TextStyle::new(10.0).colour(DIM).anchor(TextAnchor::End), name);
        canvas.panel((LEFT, y), (WIDTH - MARGIN - LEFT, ROW), SPACE_COLOUR);
        for (times, colour) in bars {
            axis.bar(canvas, y, *times, colour);
        }
        y += ROW + 2.0;
    };
    let shadows: Vec<_> = path.shadows().into_iter().map(|times| (times, GRID)).collect();
    row(canvas, "shadow", &shadows);
    let passes: Vec<_> =
        path.passes.iter().map(|pass| ([pass.open_s, pass.close_s], STATION_COLOUR)).collect();
    row(canvas, "passes", &passes);
    let placed = path.windows.iter().filter(|window| window.object >= sky.forecast.drawn_targets);
    let fields: Vec<_> = merge(placed.map(|window| [window.open_s, window.close_s]).collect())
        .into_iter()
        .map(|times| (times, TARGET_COLOUR))
        .collect();
    if !sky.forecast.targets.is_empty() {
        row(canvas, "fields", &fields);
    }
    let tasks: Vec<_> = sky.plans[satellite]
        .tasks
        .iter()
        .map(|task| ([task.start_s, task.end_s], task_colour(task.kind)))
        .collect();
    row(canvas, "plan", &tasks);
    draw_chart(canvas, axis, &sky.plans[satellite].resources, y + 2.0)
}

/// Draws the resources by the reference plan, and the axis below. Returns the bottom.
fn draw_chart(canvas: &mut SvgCanvas, axis: TimeAxis, resources: &[ResourceSample], top: f64) -> f64 {
    let width = WIDTH - MARGIN - LEFT;
    canvas.panel((LEFT, top), (width, CHART), SPACE_COLOUR);
    let label = TextStyle::new(9.0).colour(DIM).anchor(TextAnchor::End);
    for (share, text) in [(0.0, "0 %"), (0.5, "50 %"), (1.0, "100 %")] {
        let y = top + CHART * (1.0 - share);
        canvas.line(&[(LEFT, y), (LEFT + width, y)], Stroke::new(GRID, 0.6).opacity(0.7));
        canvas.text((LEFT - 6.0, y + 3.0), label, text);
    }
    for ResourceCurve { colour, share } in CURVES {
        let point = |sample: &ResourceSample| -> Point {
            (axis.x(sample.time_s), top + CHART * (1.0 - share(sample).clamp(0.0, 1.0)))
        };
        let points: Vec<Point> = resources.iter().map(point).collect();
        canvas.line(&points, Stroke::new(colour, 1.5));
    }
    let bottom = top + CHART;
    let marks = (axis.limit_s / S_PER_MINUTE / MARK_MINUTES) as i32;
    let step = 1 + marks / 12;
    for mark in (0..=marks).step_by(step.unsigned_abs() as usize) {
        let minutes = f64::from(mark) * MARK_MINUTES;
        let x = axis.x(minutes * S_PER_MINUTE);
        canvas.line(&[(x, bottom), (x, bottom + 3.0)], Stroke::new(DIM, 1.0));
        let style = TextStyle::new(9.0).colour(TEXT).anchor(TextAnchor::Middle);
        canvas.text((x, bottom + 13.0), style, &format!("{minutes:.0} min"));
    }
    bottom + 16.0
}

/// Joins times that overlap.
fn merge(mut times: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    times.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut merged: Vec<[f64; 2]> = Vec::new();
    for [from_s, to_s] in times {
        match merged.last_mut().filter(|last| last[1] >= from_s) {
            Some(last) => last[1] = last[1].max(to_s),
            None => merged.push([from_s, to_s]),
        }
    }
    merged
}
