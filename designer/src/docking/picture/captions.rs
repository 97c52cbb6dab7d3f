//! Captions of a picture: title, legend, and table of deputies.

use env_core::docking::constants::{DOCKING_RADIUS_M, MAX_DISTANCE_M};
use env_core::docking::end_conditions::DeputyStatus;

use super::plane_map::{BOUNDS_COLOUR, CHIEF_COLOUR, agent_colour};
use super::scene::DockingScene;
use super::{MARGIN, WIDTH};
use crate::design_language::{LayoutKind, LayoutView};
use crate::docking::table::{HEADER, aim_text, deputy_row};
use crate::picture_parts::{self, AIM_COLOUR, Legend, TitlePage};
use crate::svg::{Arrow, DIM, GRID, Point, Stroke, SvgCanvas, TEXT, TextAnchor, TextStyle};

/// Draws the name, the kind and aim, and the scenario with its scores.
pub(super) fn draw_title(canvas: &mut SvgCanvas, layout: LayoutView<'_>, scene: &DockingScene) {
    let subtitle = scene.design.as_ref().map_or_else(
        || "without a design".to_owned(),
        |design| format!("{}, aimed at {}", LayoutKind::Threat.as_str(), aim_text(design)),
    );
    let setup = &scene.setup;
    let count = scene.deputies.len();
    let params = [
        if count == 1 { "1 deputy".to_owned() } else { format!("{count} deputies") },
        format!("time limit {} s", setup.recipe_time_limit),
        format!("thrust bound {} N", setup.thrust_bound),
    ];
    let page = TitlePage { left: MARGIN, width: WIDTH - 2.0 * MARGIN };
    picture_parts::draw_title(canvas, layout, &subtitle, &params, page);
}

/// Draws the legend. Returns its bottom.
pub(super) fn draw_legend(canvas: &mut SvgCanvas, scene: &DockingScene, corner: Point) -> f64 {
    let mut legend = Legend::new(canvas, corner);
    for (index, deputy) in scene.deputies.iter().enumerate() {
        let end = match deputy.status {
            DeputyStatus::Docked => format!("docks after {} s", deputy.end_step),
            status => format!("{} after {} s", status_text(status), deputy.end_step),
        };
        let colour = agent_colour(index);
        legend.entry(&format!("deputy {index}: {end} by the reference plan"), |canvas, x, y| {
            canvas.line(&[(x + 8.0, y), (x + 34.0, y)], Stroke::new(colour, 1.8));
            canvas.circle((x + 8.0, y), 5.0, colour, None);
        });
    }
    legend.line_entry("path without thrust", Stroke::new(TEXT, 1.2).opacity(0.7).dashes("2 4"));
    legend.entry("velocity at the start", |canvas, x, y| {
        canvas.arrow(Arrow { from: (x + 4.0, y), to: (x + 32.0, y) }, 7.0, Stroke::new(TEXT, 1.6));
    });
    if !scene.aimed.is_empty() {
        legend.entry("deputy that matches the aim", |canvas, x, y| {
            canvas.circle((x + 18.0, y), 7.0, "none", Some(Stroke::new(AIM_COLOUR, 1.4)));
        });
    }
    if scene.design.as_ref().is_some_and(|design| design.aim.bearing_deg.is_some()) {
        legend.entry("aim: sector of bearings", |canvas, x, y| {
            let outline = [(x + 4.0, y), (x + 34.0, y - 6.0), (x + 34.0, y + 6.0)];
            canvas.area(&outline, AIM_COLOUR, 0.2, Some(Stroke::new(AIM_COLOUR, 1.0).opacity(0.7)));
        });
    }
    legend.entry(
        &format!("chief, docking radius {DOCKING_RADIUS_M} m (enlarged if small)"),
        |canvas, x, y| {
            canvas.circle((x + 18.0, y), 4.0, "none", Some(Stroke::new(CHIEF_COLOUR, 1.2)));
            canvas.dots(&[(x + 18.0, y)], Stroke::new(CHIEF_COLOUR, 3.0));
        },
    );
    legend.line_entry("speed limit in the chart", Stroke::new(BOUNDS_COLOUR, 1.6));
    let bounds = format!("bounds at {} km, beyond most maps", MAX_DISTANCE_M / 1000.0);
    legend.line_entry(&bounds, Stroke::new(BOUNDS_COLOUR, 1.4).dashes("6 4"));
    legend.bottom()
}

const fn status_text(status: DeputyStatus) -> &'static str {
    match status {
        DeputyStatus::Active => "still flies",
        DeputyStatus::Docked => "docks",
        DeputyStatus::Crashed => "crashes",
        DeputyStatus::OutOfBounds => "leaves bounds",
        DeputyStatus::Saturated => "is stopped",
        DeputyStatus::Collided => "collides",
        DeputyStatus::TimedOut => "runs out of time",
    }
}

/// Right ends of the columns of the table.
const COLUMN_ENDS: [f64; HEADER.len()] = [24.0, 150.0, 270.0, 390.0, 510.0, 630.0, 750.0, 868.0];

/// Draws the table of deputies of a design. Returns its bottom.
pub(super) fn draw_table(canvas: &mut SvgCanvas, scene: &DockingScene, (left, top): Point) -> f64 {
    let Some(design) = &scene.design else { return top };
    let mut y = top + 10.0;
    let title_style = TextStyle::new(11.0).colour(DIM).anchor(TextAnchor::End);
    for (title, end) in HEADER.iter().zip(COLUMN_ENDS) {
        canvas.text((left + end, y), title_style, title);
    }
    y += 6.0;
    canvas.line(&[(left, y), (left + WIDTH - 2.0 * MARGIN, y)], Stroke::new(GRID, 1.0));
    for (index, deputy) in design.deputies.iter().enumerate() {
        y += 18.0;
        let row = deputy_row(index, deputy);
        for (column, (cell, end)) in row.iter().zip(COLUMN_ENDS).enumerate() {
            let colour = if column == 0 { agent_colour(index) } else { TEXT };
            let style = TextStyle::new(11.5).anchor(TextAnchor::End).colour(colour);
            canvas.text((left + end, y), style, cell);
        }
    }
    y += 20.0;
    let note = "Speeds are in percent of the speed limit at the distance, closing towards the chief and cross to it.";
    canvas.text((left, y), TextStyle::new(10.5).colour(DIM), note);
    y
}
