//! The sky: orbits, debris on its way, encounters, the witness, the Earth.

use env_core::kessler::bearing::Frame;
use env_core::kessler::constants::{EARTH_RADIUS, HORIZON, SATELLITES};
use env_core::kessler::kernel::Body;

use super::super::claim::AIM_WIDTH;
use super::super::language::{Design, Kind};
use super::labels::Labels;
use super::scene::{Burn, Pass, Scene};
use super::{AIM, BURN, DECOY, EARTH, EARTH_RIM, SATELLITE_COLOURS, SCREEN, THREAT};
use crate::picture::{Canvas, DIM, FAINT, Pen, Stroke, TEXT, number};

/// Steps before an encounter in which its debris' path is drawn boldly.
const BOLD: u32 = 6;
/// Burns that are drawn smaller where there are more.
const MANY: usize = 40;
/// Length of the aim's sector, LU.
const SECTOR: f64 = 30.0;
/// Lengths of the scale bar, LU.
const SCALES: [f64; 4] = [50.0, 20.0, 10.0, 5.0];

/// From LU to the page: what is to be seen fills the window.
struct Map {
    corner: (f64, f64),
    size: (f64, f64),
    middle: (f64, f64),
    scale: f64,
}

impl Map {
    fn fit(scene: &Scene, corner: (f64, f64), size: (f64, f64)) -> Self {
        let hold = (0..SATELLITES).flat_map(|s| (0..=HORIZON).map(move |step| scene.hold.at(s, step)));
        let flown = scene.witness.iter().flatten();
        let passing = scene.passes.iter().flat_map(|pass| pass.path.iter());
        let mut low = (-EARTH_RADIUS, -EARTH_RADIUS);
        let mut high = (EARTH_RADIUS, EARTH_RADIUS);
        for body in hold.chain(flown).chain(passing) {
            low = (low.0.min(body.x), low.1.min(body.y));
            high = (high.0.max(body.x), high.1.max(body.y));
        }
        let span = (high.0 - low.0 + 16.0, high.1 - low.1 + 16.0);
        let scale = (size.0 / span.0).min(size.1 / span.1);
        Self { corner, size, middle: (0.5 * (low.0 + high.0), 0.5 * (low.1 + high.1)), scale }
    }

    fn at(&self, x: f64, y: f64) -> (f64, f64) {
        let across = self.corner.0 + 0.5 * self.size.0 + self.scale * (x - self.middle.0);
        (across, self.corner.1 + 0.5 * self.size.1 - self.scale * (y - self.middle.1))
    }

    fn of(&self, body: &Body) -> (f64, f64) {
        self.at(body.x, body.y)
    }

    fn shows(&self, body: &Body) -> bool {
        let (x, y) = self.of(body);
        (self.corner.0..=self.corner.0 + self.size.0).contains(&x)
            && (self.corner.1..=self.corner.1 + self.size.1).contains(&y)
    }
}

/// The colour of a kind.
pub(super) const fn colour(kind: Kind) -> &'static str {
    match kind {
        Kind::Threat => THREAT,
        Kind::Decoy => DECOY,
        Kind::Screen => SCREEN,
    }
}

/// Draws the sky into this rectangle.
pub(super) fn draw(canvas: &mut Canvas, scene: &Scene, corner: (f64, f64), size: (f64, f64)) {
    let map = Map::fit(scene, corner, size);
    canvas.panel(corner, size, "#0b0f15");
    canvas.window("sky", corner, size);
    ground(canvas, scene, &map);
    if let Some((design, aim, pass)) = scene.design.as_ref().zip(scene.aimed()).map(|(d, (a, p))| (d, a, p))
        && let Some(bearing_deg) = aim.bearing_deg
    {
        sector(canvas, scene, &map, design, f64::from(bearing_deg), pass);
    }
    scene.passes.iter().for_each(|pass| approach(canvas, &map, pass));
    orbits(canvas, scene, &map);
    burns(canvas, scene, &map);
    starts(canvas, scene, &map);
    encounters(canvas, scene, &map);
    scale_bar(canvas, &map);
    canvas.end_window();
}

/// The Earth, circles to judge radii by, the radius that is asked for, and debris that is there for show.
fn ground(canvas: &mut Canvas, scene: &Scene, map: &Map) {
    let centre = map.at(0.0, 0.0);
    for radius in [50.0, 100.0, 150.0] {
        canvas.circle(centre, radius * map.scale, "none", Some(Stroke::new(FAINT, 1.0).opacity(0.6)));
    }
    if scene.target_radius > 0.0 {
        let asked = Stroke::new(TEXT, 1.2).opacity(0.6).dashes("1 5");
        canvas.circle(centre, scene.target_radius * map.scale, "none", Some(asked));
    }
    let dots: Vec<_> =
        scene.background.iter().filter(|body| map.shows(body)).map(|body| map.of(body)).collect();
    canvas.dots(&dots, Stroke::new(DIM, 2.4).opacity(0.55));
    canvas.circle(centre, EARTH_RADIUS * map.scale, EARTH, Some(Stroke::new(EARTH_RIM, 1.5)));
    canvas.text((centre.0, centre.1 + 4.0), Pen::new(12.0).anchor("middle").colour(EARTH_RIM), "Earth");
}

/// Where the aim says that it comes from, seen from the satellite when its bearing is taken.
fn sector(canvas: &mut Canvas, scene: &Scene, map: &Map, design: &Design, bearing_deg: f64, pass: &Pass) {
    let of = scene.hold.at(pass.encounter.satellite as usize, pass.seen);
    let direction = design.frame.direction_deg(of, bearing_deg);
    let mut outline = vec![map.of(of)];
    for part in 0..=10 {
        let angle = direction + AIM_WIDTH * (f64::from(part) / 5.0 - 1.0);
        let (sin, cos) = libm::sincos(angle.to_radians());
        outline.push(map.at(of.x + SECTOR * cos, of.y + SECTOR * sin));
    }
    canvas.area(&outline, AIM, 0.16, Some(Stroke::new(AIM, 1.0).opacity(0.7)));
}

/// Debris on its way: faint from its start, bold in the last steps, a star where it appears out of nothing.
fn approach(canvas: &mut Canvas, map: &Map, pass: &Pass) {
    let colour = colour(pass.encounter.kind);
    let dashes = if pass.encounter.rogue { "5 3" } else { "" };
    let near = pass.encounter.step.saturating_sub(BOLD);
    let far: Vec<_> = pass.steps().filter(|(step, _)| *step <= near).map(|(_, body)| map.of(body)).collect();
    canvas.line(&far, Stroke::new(colour, 0.9).opacity(0.3));
    let last: Vec<_> = pass
        .steps()
        .filter(|(step, _)| (near..=pass.encounter.step).contains(step))
        .map(|(_, body)| map.of(body))
        .collect();
    canvas.line(&last, Stroke::new(colour, 2.0).dashes(dashes));
    let after: Vec<_> =
        pass.steps().filter(|(step, _)| *step >= pass.encounter.step).map(|(_, body)| map.of(body)).collect();
    canvas.line(&after, Stroke::new(colour, 1.2).opacity(0.5));
    if let Some(start) = pass.path.first().map(|body| map.of(body)) {
        if pass.encounter.rogue {
            star(canvas, start, colour);
        } else {
            canvas.circle(start, 2.2, colour, None);
        }
    }
    // Which way it goes, halfway along the bold part.
    let middle = pass.encounter.step.saturating_sub(BOLD / 2).max(pass.from + 1);
    if let Some((before, then)) = pass.at(middle - 1).zip(pass.at(middle)) {
        head(canvas, map.of(before), map.of(then), colour);
    }
}

pub(super) fn star(canvas: &mut Canvas, (x, y): (f64, f64), colour: &'static str) {
    for (dx, dy) in [(5.0, 0.0), (2.5, 4.3), (-2.5, 4.3)] {
        canvas.line(&[(x - dx, y - dy), (x + dx, y + dy)], Stroke::new(colour, 1.4));
    }
}

fn head(canvas: &mut Canvas, from: (f64, f64), to: (f64, f64), colour: &'static str) {
    let (dx, dy) = (to.0 - from.0, to.1 - from.1);
    let length = (dx * dx + dy * dy).sqrt().max(1e-6);
    let tip = (to.0 + 4.0 * dx / length, to.1 + 4.0 * dy / length);
    canvas.arrow((tip.0 - 8.0 * dx / length, tip.1 - 8.0 * dy / length), tip, 7.0, Stroke::new(colour, 1.0));
}

/// Who holds (solid, faint from where it is lost), and who flies the witness (dashed).
fn orbits(canvas: &mut Canvas, scene: &Scene, map: &Map) {
    for (satellite, colour) in SATELLITE_COLOURS.iter().enumerate() {
        let end = scene.lost[satellite].unwrap_or(HORIZON);
        let path = |from: u32, to: u32| -> Vec<_> {
            (from..=to).map(|step| map.of(scene.hold.at(satellite, step))).collect()
        };
        canvas.line(&path(end, HORIZON), Stroke::new(colour, 1.2).opacity(0.25));
        canvas.line(&path(0, end), Stroke::new(colour, 2.2));
        let flown: Vec<_> = scene.witness[satellite].iter().map(|body| map.of(body)).collect();
        canvas.line(&flown, Stroke::new(colour, 1.6).dashes("3 4"));
    }
}

/// Where satellites start, with their numbers.
fn starts(canvas: &mut Canvas, scene: &Scene, map: &Map) {
    for (satellite, colour) in SATELLITE_COLOURS.iter().enumerate() {
        let start = map.of(scene.hold.at(satellite, 0));
        canvas.circle(start, 8.0, colour, None);
        let words = Pen::new(11.0).anchor("middle").bold().colour(crate::picture::BACK);
        canvas.text((start.0, start.1 + 4.0), words, &satellite.to_string());
    }
}

/// The witness' burns, longer for more.
fn burns(canvas: &mut Canvas, scene: &Scene, map: &Map) {
    // Who burns in every step would be covered by arrows.
    let (long, head, width) = if scene.burns.len() > MANY { (9.0, 4.0, 0.9) } else { (16.0, 6.0, 1.6) };
    let arrow = |burn: &Burn| {
        let (dx, dy) = burn.by;
        let size = (dx * dx + dy * dy).sqrt();
        let length = long * (1.0 + 1.5 * size.min(1.0));
        let from = map.of(&burn.at);
        (size > 0.0).then(|| (from, (from.0 + length * dx / size, from.1 - length * dy / size)))
    };
    let arrows: Vec<_> = scene.burns.iter().filter_map(arrow).collect();
    canvas.arrows(&arrows, head, Stroke::new(BURN, width));
}

/// A mark at each encounter, and its number and step where there is room.
fn encounters(canvas: &mut Canvas, scene: &Scene, map: &Map) {
    let met = |pass: &Pass| {
        let hit = scene.hold.at(pass.encounter.satellite as usize, pass.encounter.step);
        map.of(hit)
    };
    let mut labels = Labels::within(map.corner, map.size);
    (0..SATELLITES).for_each(|satellite| labels.avoid(map.of(scene.hold.at(satellite, 0)), 10.0));
    scene.passes.iter().for_each(|pass| labels.avoid(met(pass), 5.0));
    for (step, body, pass) in
        scene.passes.iter().flat_map(|pass| pass.steps().map(move |(s, b)| (s, b, pass)))
    {
        if step + BOLD >= pass.encounter.step {
            labels.avoid(map.of(body), 1.5);
        }
    }
    for (number, pass) in scene.passes.iter().enumerate() {
        let (at, colour) = (met(pass), colour(pass.encounter.kind));
        let words = format!("{number}: step {}", pass.encounter.step);
        let size = (12.0 + 6.2 * words.chars().count() as f64, 16.0);
        let corner = labels.place(at, size);
        let middle = (corner.0 + 0.5 * size.0, corner.1 + 0.5 * size.1);
        canvas.line(&[at, middle], Stroke::new(colour, 0.9).opacity(0.8));
        canvas.circle(at, 4.0, crate::picture::BACK, Some(Stroke::new(colour, 2.0)));
        canvas.panel(corner, size, "#1b2430");
        let pen = Pen::new(11.0).anchor("middle").colour(colour);
        canvas.text((middle.0, corner.1 + 12.0), pen, &words);
    }
}

fn scale_bar(canvas: &mut Canvas, map: &Map) {
    let length = SCALES.into_iter().find(|length| length * map.scale < 0.3 * map.size.0).unwrap_or(5.0);
    let (x, y) = (map.corner.0 + 16.0, map.corner.1 + map.size.1 - 16.0);
    let end = x + length * map.scale;
    canvas.line(&[(x, y - 4.0), (x, y), (end, y), (end, y - 4.0)], Stroke::new(TEXT, 1.2));
    canvas.text((end + 6.0, y), Pen::new(11.0), &format!("{} LU", number(length)));
    // The axes that inertial bearings are measured in.
    let (x, y) = (map.corner.0 + map.size.0 - 52.0, map.corner.1 + map.size.1 - 18.0);
    canvas.arrow((x, y), (x + 24.0, y), 5.0, Stroke::new(DIM, 1.0));
    canvas.arrow((x, y), (x, y - 24.0), 5.0, Stroke::new(DIM, 1.0));
    canvas.text((x + 27.0, y + 4.0), Pen::new(10.0).colour(DIM), "+X");
    canvas.text((x - 6.0, y - 28.0), Pen::new(10.0).colour(DIM), "+Y");
}

/// The direction of a bearing in an inset, where radial out is up and in-track right: degrees clockwise from up.
pub(super) fn turned(frame: Frame, of: &Body, bearing_deg: f64) -> f64 {
    Frame::RadialInTrack.bearing_deg(of, {
        let (sin, cos) = libm::sincos(frame.direction_deg(of, bearing_deg).to_radians());
        (of.x + cos, of.y + sin)
    })
}
