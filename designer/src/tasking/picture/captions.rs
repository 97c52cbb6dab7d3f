//! Captions of a picture: title, legends, and table of fields.

use super::sky::{LayoutSky, PlannedKind};
use super::style::{
    BACKGROUND_TARGET_COLOUR, BATTERY_COLOUR, IMAGED_COLOUR, OUTAGE_COLOUR, STATION_COLOUR, STORAGE_COLOUR,
    SUN_COLOUR, TARGET_COLOUR, satellite_colour,
};
use super::timeline::task_colour;
use super::world_map::{draw_cross, draw_dish};
use super::{MARGIN, WIDTH};
use crate::design_language::LayoutView;
use crate::picture_parts::{self, TitlePage};
use crate::svg::{DIM, GRID, Point, Stroke, SvgCanvas, TextAnchor, TextStyle, truncate_to_width};
use crate::tasking::table::{aim_text, design_table, start_text};

/// Distance between two entries of a legend.
const ENTRY_GAP: f64 = 16.0;
/// Width of a sample in a legend.
const SAMPLE_WIDTH: f64 = 18.0;
/// Width of a letter of a legend, as [`truncate_to_width`] reckons it.
const LETTER_WIDTH: f64 = 0.56 * 11.0;

/// Params that the title shows.
const SHOWN_PARAMS: [&str; 4] = ["satellites", "targets", "battery_wh", "storage_gbit"];

/// Draws the name, the aim, the scenario with its scores, and the start.
pub(super) fn draw_title(canvas: &mut SvgCanvas, layout: LayoutView<'_>, sky: &LayoutSky) {
    let width = WIDTH - 2.0 * MARGIN;
    let (subtitle, start) = match &sky.design {
        Some(design) => (format!("threat, aimed at {}", aim_text(design)), start_text(design)),
        None => ("without a design".to_owned(), start_without_design(sky)),
    };
    let recipe = layout.scenario.recipe();
    let param = |name: &&str| Some(format!("{} {}", name.replace('_', " "), recipe.param(name)?));
    let params: Vec<String> = SHOWN_PARAMS.iter().filter_map(param).collect();
    let page = TitlePage { left: MARGIN, width };
    picture_parts::draw_title(canvas, layout, &subtitle, &params, page);
    let start = truncate_to_width(&start, width, 12.5);
    canvas.text((MARGIN, 90.0), TextStyle::new(12.5).colour(DIM), &start);
}

/// Returns the resources of the first satellite at the start.
fn start_without_design(sky: &LayoutSky) -> String {
    sky.forecast.satellites.first().map_or_else(String::new, |path| {
        let resources = &path.resources;
        format!(
            "satellite 0 starts at {:.0}° from noon; battery {:.0} %, wheels {:.0} %, storage {:.0} %",
            path.track.first().map_or(0.0, |point| point.orbit_angle_deg),
            100.0 * resources.charge_wh / resources.battery_wh,
            100.0 * resources.wheel_share,
            100.0 * resources.stored_bits / resources.storage_bits,
        )
    })
}

/// Writer of legend entries, from left to right.
struct LegendRow<'a> {
    canvas: &'a mut SvgCanvas,
    at: Point,
}

impl LegendRow<'_> {
    /// Adds an entry. `draw_sample` gets the middle of the sample.
    fn entry(&mut self, text: &str, draw_sample: impl FnOnce(&mut SvgCanvas, Point)) {
        let width = SAMPLE_WIDTH + 4.0 + LETTER_WIDTH * text.chars().count() as f64;
        if self.at.0 + width > WIDTH - MARGIN {
            self.at = (MARGIN, self.at.1 + 17.0);
        }
        draw_sample(self.canvas, (self.at.0 + 0.5 * SAMPLE_WIDTH, self.at.1 - 4.0));
        self.canvas.text((self.at.0 + SAMPLE_WIDTH + 4.0, self.at.1), TextStyle::new(11.0), text);
        self.at.0 += width + ENTRY_GAP;
    }

    fn line_entry(&mut self, text: &str, stroke: Stroke) {
        self.entry(text, |canvas, (x, y)| canvas.line(&[(x - 9.0, y), (x + 9.0, y)], stroke));
    }

    fn bar_entry(&mut self, text: &str, colour: &'static str) {
        self.entry(text, |canvas, (x, y)| canvas.panel((x - 8.0, y - 4.0), (16.0, 9.0), colour));
    }
}

/// Draws the legend of the map. Returns its bottom.
pub(super) fn draw_map_legend(canvas: &mut SvgCanvas, sky: &LayoutSky, top: f64) -> f64 {
    let mut row = LegendRow { canvas, at: (MARGIN, top) };
    let colour = satellite_colour(0);
    row.line_entry("track in sunlight", Stroke::new(colour, 1.3));
    row.line_entry("in the shadow", Stroke::new(colour, 1.0).opacity(0.55).dashes("2 4"));
    row.entry("Sun overhead at the start", |canvas, at| canvas.circle(at, 5.0, SUN_COLOUR, None));
    row.entry("station and its reach", |canvas, at| draw_dish(canvas, at, STATION_COLOUR));
    if !sky.outages.is_empty() {
        row.entry("out of service", draw_cross);
    }
    if sky.forecast.targets.len() > sky.forecast.drawn_targets {
        row.entry("target of a field, larger for priority", |canvas, at| {
            canvas.circle(at, 3.0, TARGET_COLOUR, None);
        });
    }
    if sky.forecast.drawn_targets > 0 {
        row.entry("drawn target", |canvas, at| {
            canvas.circle(at, 1.2, BACKGROUND_TARGET_COLOUR, None);
        });
    }
    if !sky.imaged.is_empty() {
        row.entry("imaged by the reference plan", |canvas, at| {
            canvas.circle(at, 3.0, TARGET_COLOUR, Some(Stroke::new(IMAGED_COLOUR, 1.2)));
        });
    }
    row.at.1
}

/// Draws the legend of the timelines. Returns its bottom.
pub(super) fn draw_time_legend(canvas: &mut SvgCanvas, sky: &LayoutSky, top: f64) -> f64 {
    let mut row = LegendRow { canvas, at: (MARGIN, top) };
    let work = if sky.forecast.targets.is_empty() { "scan" } else { "image" };
    row.bar_entry("shadow", GRID);
    for (text, kind) in [
        (work, PlannedKind::Work),
        ("charge", PlannedKind::Charge),
        ("downlink, pass", PlannedKind::Downlink),
        ("desaturate", PlannedKind::Desaturate),
    ] {
        row.bar_entry(text, task_colour(kind));
    }
    for (text, colour) in
        [("battery", BATTERY_COLOUR), ("storage", STORAGE_COLOUR), ("fastest wheel", OUTAGE_COLOUR)]
    {
        row.line_entry(text, Stroke::new(colour, 1.5));
    }
    row.at.1
}

/// Draws the table of the fields. Returns its bottom.
pub(super) fn draw_table(canvas: &mut SvgCanvas, sky: &LayoutSky, top: f64) -> f64 {
    let Some(design) = sky.design.as_ref().filter(|design| !design.fields.is_empty()) else {
        return top - 20.0;
    };
    let table = design_table(design);
    let column = (WIDTH - 2.0 * MARGIN) / table.header.len() as f64;
    let mut y = top;
    let mut write = |cells: &[String], style: TextStyle| {
        for (index, cell) in cells.iter().enumerate() {
            canvas.text((MARGIN + (index as f64 + 0.8) * column, y), style, cell);
        }
        y += 17.0;
    };
    let header: Vec<String> = table.header.iter().map(|title| (*title).to_owned()).collect();
    write(&header, TextStyle::new(11.0).colour(DIM).anchor(TextAnchor::End));
    for row in &table.rows {
        write(row, TextStyle::new(11.0).anchor(TextAnchor::End));
    }
    y - 17.0
}
