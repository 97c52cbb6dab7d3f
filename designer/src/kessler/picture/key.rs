//! The words of a picture: title, legend, table of encounters.

use env_core::kessler::constants::RADAR_NONE;

use super::super::claim;
use super::super::language::Kind;
use super::super::listing;
use super::scene::Scene;
use super::sky::colour;
use super::{AIM, BURN, MARGIN, SATELLITE_COLOURS, WIDTH};
use crate::language::Claim;
use crate::picture::{Canvas, DIM, FAINT, Pen, Stroke, Subject, TEXT, fitted};

/// Name; claim and aim; scenario and what it is worth.
pub(super) fn title(canvas: &mut Canvas, subject: Subject<'_>, scene: &Scene) {
    let room = WIDTH - 2.0 * MARGIN;
    canvas.text((MARGIN, 30.0), Pen::new(20.0).bold(), &fitted(subject.name, room, 20.0));
    let said = match &scene.design {
        None => "laid out by hand: what hits satellites that hold is shown".to_owned(),
        Some(design) => {
            let claim = if claim::threatens(design) { Claim::Threat } else { Claim::Decoy };
            let aim = listing::aim(design);
            format!("{}, aimed at {aim}", claim.word())
        }
    };
    canvas.text((MARGIN, 52.0), Pen::new(14.0), &fitted(&said, room, 14.0));
    let bracket = subject.bracket;
    let recipe = subject.scenario.recipe();
    let params = recipe.task().params().iter().filter_map(|spec| {
        let value = recipe.param(spec.name)?;
        let tells = match spec.name {
            "debris" | "fuel" => true,
            "radar_range" => value < RADAR_NONE,
            _ => false,
        };
        tells.then(|| format!("{} {value}", spec.name.replace('_', " ")))
    });
    let params: Vec<_> = params.collect();
    let worth = format!(
        "{} · {} · hold {:.3} → reference {:.3} (floor {:.3})",
        recipe.task().id(),
        params.join(", "),
        bracket.hold(),
        bracket.reference.score,
        bracket.floor
    );
    canvas.text((MARGIN, 72.0), Pen::new(12.5).colour(DIM), &fitted(&worth, room, 12.5));
}

/// A sample and its words, line by line.
struct Legend<'a> {
    canvas: &'a mut Canvas,
    x: f64,
    y: f64,
}

impl Legend<'_> {
    /// A line: `sample` draws around this height, from this place 36 to the right.
    fn entry(&mut self, words: &str, sample: impl FnOnce(&mut Canvas, f64, f64)) {
        sample(self.canvas, self.x, self.y - 4.0);
        self.canvas.text((self.x + 42.0, self.y), Pen::new(12.0), words);
        self.y += 19.0;
    }

    fn line(&mut self, words: &str, stroke: Stroke) {
        self.entry(words, |canvas, x, y| canvas.line(&[(x + 2.0, y), (x + 34.0, y)], stroke));
    }

    /// Who flies, under hold and by the witness.
    fn flown(&mut self, scene: &Scene) {
        for (satellite, colour) in SATELLITE_COLOURS.iter().enumerate() {
            let words = scene.lost[satellite].map_or_else(
                || format!("satellite {satellite}: holding, it lives"),
                |step| format!("satellite {satellite}: holding, lost at step {step}"),
            );
            self.entry(&words, |canvas, x, y| {
                canvas.line(&[(x + 8.0, y), (x + 34.0, y)], Stroke::new(colour, 2.2));
                canvas.circle((x + 8.0, y), 5.0, colour, None);
            });
        }
        let witness = Stroke::new(TEXT, 1.6).dashes("3 4");
        if scene.burns.is_empty() {
            self.line("the witness: the planner holds too", witness);
            return;
        }
        self.line("the witness: what the planner flies", witness);
        let burns = match scene.burns.len() {
            1 => "its burn".to_owned(),
            count => format!("its {count} burns"),
        };
        self.entry(&burns, |canvas, x, y| {
            canvas.arrow((x + 8.0, y), (x + 30.0, y), 6.0, Stroke::new(BURN, 1.6));
        });
    }

    /// What comes, by kind.
    fn coming(&mut self, scene: &Scene) {
        for kind in [Kind::Threat, Kind::Decoy, Kind::Screen] {
            let of_kind = || scene.passes.iter().filter(move |pass| pass.encounter.kind == kind);
            let (word, colour) = (kind.word(), colour(kind));
            if of_kind().any(|pass| !pass.encounter.rogue) {
                self.entry(&format!("{word}: from its start to its encounter"), |canvas, x, y| {
                    canvas.circle((x + 4.0, y), 2.2, colour, None);
                    canvas.line(&[(x + 4.0, y), (x + 14.0, y)], Stroke::new(colour, 0.9).opacity(0.4));
                    canvas.line(&[(x + 14.0, y), (x + 34.0, y)], Stroke::new(colour, 2.0));
                });
            }
            if of_kind().any(|pass| pass.encounter.rogue) {
                self.entry(&format!("rogue {word}: from where it appears"), |canvas, x, y| {
                    super::sky::star(canvas, (x + 6.0, y), colour);
                    canvas.line(&[(x + 6.0, y), (x + 34.0, y)], Stroke::new(colour, 2.0).dashes("5 3"));
                });
            }
        }
    }

    /// What helps the eye.
    fn help(&mut self, scene: &Scene) {
        if scene.aimed().is_some_and(|(aim, _)| aim.bearing_deg.is_some()) {
            self.entry("the aim: where it should come from", |canvas, x, y| {
                let outline = [(x + 4.0, y), (x + 34.0, y - 6.0), (x + 34.0, y + 6.0)];
                canvas.area(&outline, AIM, 0.2, Some(Stroke::new(AIM, 1.0).opacity(0.7)));
            });
        }
        if !scene.passes.is_empty() {
            self.entry("its bearing, and where it is then", |canvas, x, y| {
                canvas.line(&[(x + 4.0, y), (x + 30.0, y)], Stroke::new(TEXT, 1.0).dashes("2 3"));
                canvas.circle((x + 30.0, y), 4.2, "none", Some(Stroke::new(TEXT, 1.4)));
            });
            self.entry("nearer than 2 LU is a contact", |canvas, x, y| {
                canvas.circle((x + 20.0, y), 6.0, "none", Some(Stroke::new(TEXT, 0.8).opacity(0.7)));
            });
        }
        if scene.target_radius > 0.0 {
            let words = format!("the radius to reach: {:.0} LU", scene.target_radius);
            self.line(&words, Stroke::new(TEXT, 1.2).opacity(0.6).dashes("1 5"));
        }
        if !scene.background.is_empty() {
            let words = format!("background: {} pieces", scene.background.len());
            self.entry(&words, |canvas, x, y| {
                canvas.dots(&[(x + 8.0, y), (x + 19.0, y - 3.0), (x + 30.0, y + 2.0)], Stroke::new(DIM, 2.4));
            });
        }
    }
}

/// What is what; answers with where it ends.
pub(super) fn legend(canvas: &mut Canvas, scene: &Scene, corner: (f64, f64)) -> f64 {
    let mut legend = Legend { canvas, x: corner.0, y: corner.1 + 10.0 };
    legend.flown(scene);
    legend.coming(scene);
    legend.help(scene);
    legend.y
}

/// Where the columns of the encounters' table end, as shares of its width; the last column begins after the others.
const COLUMNS: [(f64, &str); 6] =
    [(0.05, "#"), (0.15, "sat"), (0.28, "step"), (0.42, "from"), (0.56, "LU/TU"), (0.68, "miss")];

const KIND: f64 = 0.715;

/// All encounters; answers with where they end.
pub(super) fn table(canvas: &mut Canvas, scene: &Scene, corner: (f64, f64), width: f64) -> f64 {
    let mut y = corner.1 + 10.0;
    let head = Pen::new(11.0).colour(DIM);
    for (end, name) in COLUMNS {
        canvas.text((corner.0 + end * width, y), head.anchor("end"), name);
    }
    canvas.text((corner.0 + KIND * width, y), head, "kind");
    canvas.line(&[(corner.0, y + 5.0), (corner.0 + width, y + 5.0)], Stroke::new(FAINT, 1.0));
    for (index, pass) in scene.passes.iter().enumerate() {
        y += 18.0;
        let row = listing::row(index, &pass.encounter);
        let pen = Pen::new(11.5);
        for ((end, _), words) in COLUMNS.iter().zip(&row) {
            canvas.text((corner.0 + end * width, y), pen.anchor("end"), words);
        }
        let kind = row.last().map_or("", String::as_str);
        canvas.text((corner.0 + KIND * width, y), pen.colour(colour(pass.encounter.kind)), kind);
    }
    y += 20.0;
    let Some(design) = &scene.design else { return y };
    let bearings = listing::frame_about(design);
    let note = Pen::new(10.5).colour(DIM);
    canvas.text((corner.0, y), note, &format!("Bearings: {}.", listing::frame(design)));
    for part in bearings.split(", ") {
        y += 14.0;
        canvas.text((corner.0 + 10.0, y), note, part);
    }
    y
}
