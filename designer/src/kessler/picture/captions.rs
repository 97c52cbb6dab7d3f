//! Captions of a picture: title, legend, and table of encounters.

use env_core::kessler::constants::RADAR_NONE;

use super::scene::Scene;
use super::style::{BURN_COLOUR, SATELLITE_COLOURS, draw_star, kind_colour};
use super::{MARGIN, WIDTH};
use crate::design_language::{LayoutKind, LayoutView};
use crate::kessler::aim::has_threat;
use crate::kessler::table::{aim_text, encounter_row, frame_text};
use crate::kessler::vocabulary::{EncounterKind, frame_spec};
use crate::picture_parts::{self, AIM_COLOUR, Legend, TitlePage};
use crate::svg::{Arrow, DIM, GRID, Point, Stroke, SvgCanvas, TEXT, TextAnchor, TextStyle};

/// Draws the name, the kind and aim, and the scenario with its scores.
pub(super) fn draw_title(canvas: &mut SvgCanvas, layout: LayoutView<'_>, scene: &Scene) {
    let subtitle = match &scene.design {
        None => "without a design; shows the debris that hits holding satellites".to_owned(),
        Some(design) => {
            let kind = if has_threat(design) { LayoutKind::Threat } else { LayoutKind::Decoy };
            format!("{}, aimed at {}", kind.as_str(), aim_text(design))
        }
    };
    let recipe = layout.scenario.recipe();
    let params = recipe.task().params().iter().filter_map(|spec| {
        let value = recipe.param(spec.name)?;
        let is_shown = match spec.name {
            "debris" | "fuel" => true,
            "radar_range" => value < RADAR_NONE,
            _ => false,
        };
        is_shown.then(|| format!("{} {value}", spec.name.replace('_', " ")))
    });
    let params: Vec<String> = params.collect();
    let page = TitlePage { left: MARGIN, width: WIDTH - 2.0 * MARGIN };
    picture_parts::draw_title(canvas, layout, &subtitle, &params, page);
}

/// Legend of a picture of kessler.
struct KesslerLegend<'a>(Legend<'a>);

impl KesslerLegend<'_> {
    /// Adds the satellites, if they hold and by the reference plan.
    fn add_satellites(&mut self, scene: &Scene) {
        for (satellite, colour) in SATELLITE_COLOURS.iter().enumerate() {
            let text = scene.lost[satellite].map_or_else(
                || format!("satellite {satellite}: holds, survives"),
                |step| format!("satellite {satellite}: holds, lost at step {step}"),
            );
            self.0.entry(&text, |canvas, x, y| {
                canvas.line(&[(x + 8.0, y), (x + 34.0, y)], Stroke::new(colour, 2.2));
                canvas.circle((x + 8.0, y), 5.0, colour, None);
            });
        }
        let dashed = Stroke::new(TEXT, 1.6).dashes("3 4");
        let burns = match scene.reference.burns.len() {
            0 => {
                self.0.line_entry("reference plan: holds", dashed);
                return;
            }
            1 => "burn of the reference plan".to_owned(),
            count => format!("{count} burns of the reference plan"),
        };
        self.0.line_entry("path by the reference plan", dashed);
        self.0.entry(&burns, |canvas, x, y| {
            let arrow = Arrow { from: (x + 8.0, y), to: (x + 30.0, y) };
            canvas.arrow(arrow, 6.0, Stroke::new(BURN_COLOUR, 1.6));
        });
    }

    /// Adds the kinds of encounters that occur.
    fn add_encounters(&mut self, scene: &Scene) {
        for kind in [EncounterKind::Threat, EncounterKind::Decoy, EncounterKind::Screen] {
            let of_kind = || scene.passes.iter().filter(move |pass| pass.encounter.kind == kind);
            let (name, colour) = (kind.as_str(), kind_colour(kind));
            if of_kind().any(|pass| !pass.encounter.is_rogue) {
                self.0.entry(&format!("{name}: from start to encounter"), |canvas, x, y| {
                    canvas.circle((x + 4.0, y), 2.2, colour, None);
                    canvas.line(&[(x + 4.0, y), (x + 14.0, y)], Stroke::new(colour, 0.9).opacity(0.4));
                    canvas.line(&[(x + 14.0, y), (x + 34.0, y)], Stroke::new(colour, 2.0));
                });
            }
            if of_kind().any(|pass| pass.encounter.is_rogue) {
                self.0.entry(&format!("rogue {name}: from its appearance"), |canvas, x, y| {
                    draw_star(canvas, (x + 6.0, y), colour);
                    canvas.line(&[(x + 6.0, y), (x + 34.0, y)], Stroke::new(colour, 2.0).dashes("5 3"));
                });
            }
        }
    }

    /// Adds the marks that help to read the picture.
    fn add_marks(&mut self, scene: &Scene) {
        if scene.aimed_pass().is_some_and(|(aim, _)| aim.bearing_deg.is_some()) {
            self.0.entry("aim: sector of bearings", |canvas, x, y| {
                let outline = [(x + 4.0, y), (x + 34.0, y - 6.0), (x + 34.0, y + 6.0)];
                canvas.area(&outline, AIM_COLOUR, 0.2, Some(Stroke::new(AIM_COLOUR, 1.0).opacity(0.7)));
            });
        }
        if !scene.passes.is_empty() {
            self.0.entry("bearing: line of sight", |canvas, x, y| {
                canvas.line(&[(x + 4.0, y), (x + 30.0, y)], Stroke::new(TEXT, 1.0).dashes("2 3"));
                canvas.circle((x + 30.0, y), 4.2, "none", Some(Stroke::new(TEXT, 1.4)));
            });
            self.0.entry("contact distance: 2 LU", |canvas, x, y| {
                canvas.circle((x + 20.0, y), 6.0, "none", Some(Stroke::new(TEXT, 0.8).opacity(0.7)));
            });
        }
        let target_radius = scene.reference.target_radius;
        if target_radius > 0.0 {
            let text = format!("target radius: {target_radius:.0} LU");
            self.0.line_entry(&text, Stroke::new(TEXT, 1.2).opacity(0.6).dashes("1 5"));
        }
        if !scene.background.is_empty() {
            let text = format!("background debris: {}", scene.background.len());
            self.0.entry(&text, |canvas, x, y| {
                canvas.dots(&[(x + 8.0, y), (x + 19.0, y - 3.0), (x + 30.0, y + 2.0)], Stroke::new(DIM, 2.4));
            });
        }
    }
}

/// Draws the legend. Returns its bottom.
pub(super) fn draw_legend(canvas: &mut SvgCanvas, scene: &Scene, corner: Point) -> f64 {
    let mut legend = KesslerLegend(Legend::new(canvas, corner));
    legend.add_satellites(scene);
    legend.add_encounters(scene);
    legend.add_marks(scene);
    legend.0.bottom()
}

/// Column of the table of encounters, aligned to the right.
struct Column {
    title: &'static str,
    /// Unit, below the title; empty if the cells have it or there is none.
    unit: &'static str,
    /// Right end, as a share of the width of the table.
    right: f64,
}

/// Columns before the kind.
const COLUMNS: [Column; 6] = [
    Column { title: "#", unit: "", right: 0.04 },
    Column { title: "sat.", unit: "", right: 0.13 },
    Column { title: "step", unit: "", right: 0.235 },
    Column { title: "bearing", unit: "", right: 0.415 },
    Column { title: "speed", unit: "LU/TU", right: 0.565 },
    Column { title: "miss", unit: "LU", right: 0.685 },
];

/// Left end of the column with the kind, as a share of the width of the table.
const KIND_LEFT: f64 = 0.715;

/// Draws the table of encounters with a note on the frame. Returns its bottom.
pub(super) fn draw_table(canvas: &mut SvgCanvas, scene: &Scene, corner: Point, width: f64) -> f64 {
    let (left, top) = corner;
    let mut y = top + 10.0;
    let title_style = TextStyle::new(11.0).colour(DIM);
    canvas.text((left + KIND_LEFT * width, y), title_style, "kind");
    for Column { title, unit, right } in COLUMNS {
        canvas.text((left + right * width, y), title_style.anchor(TextAnchor::End), title);
        if !unit.is_empty() {
            canvas.text((left + right * width, y + 13.0), title_style.anchor(TextAnchor::End), unit);
        }
    }
    y += 13.0;
    canvas.line(&[(left, y + 5.0), (left + width, y + 5.0)], Stroke::new(GRID, 1.0));
    for (index, pass) in scene.passes.iter().enumerate() {
        y += 18.0;
        let row = encounter_row(index, &pass.encounter);
        let style = TextStyle::new(11.5);
        for (column, cell) in COLUMNS.iter().zip(&row) {
            canvas.text((left + column.right * width, y), style.anchor(TextAnchor::End), cell);
        }
        let kind = row.last().map_or("", String::as_str);
        canvas.text((left + KIND_LEFT * width, y), style.colour(kind_colour(pass.encounter.kind)), kind);
    }
    y += 20.0;
    let Some(design) = &scene.design else { return y };
    let note_style = TextStyle::new(10.5).colour(DIM);
    canvas.text((left, y), note_style, &format!("Bearings: {}.", frame_text(design)));
    for part in frame_spec(design.frame).description.split(", ") {
        y += 14.0;
        canvas.text((left + 10.0, y), note_style, part);
    }
    y
}
