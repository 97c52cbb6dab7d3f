//! A scene as pixels.

mod text;

use std::collections::{BTreeMap, VecDeque};

use env_core::scene::{Ink, Mark, Point, Scene, View};
use tiny_skia::{Color, FillRule, Paint, Path, PathBuilder, Pixmap, Rect, Stroke, Transform};

use self::text::{LINE, write};

/// Places that a trail goes back.
const TRAIL: usize = 12;
/// Pixels of a craft's disc.
const CRAFT: f32 = 5.0;
/// Around a view, pixels.
const MARGIN: f32 = 8.0;

type Colour = (u8, u8, u8, u8);

const SKY: Colour = (11, 16, 32, 255);
const TEXT: Colour = (205, 214, 228, 255);
const ALERT: Colour = (255, 138, 101, 255);
/// Agents, told apart without red against green (Okabe and Ito 2008, "Color Universal Design").
const AGENTS: [Colour; 5] =
    [(86, 180, 233, 255), (230, 159, 0, 255), (0, 200, 150, 255), (204, 121, 167, 255), (240, 228, 66, 255)];

const fn colour(ink: Ink) -> Colour {
    match ink {
        Ink::Centre => (38, 74, 120, 255),
        Ink::Agent(number) => AGENTS[number as usize % AGENTS.len()],
        Ink::Lost => (120, 60, 60, 255),
        Ink::Debris => (176, 184, 196, 255),
        Ink::Hidden => (88, 94, 108, 255),
        Ink::Target => (70, 150, 110, 255),
        Ink::Burn => (255, 214, 102, 255),
        Ink::Faint => (120, 140, 170, 110),
    }
}

fn paint(ink: Colour) -> Paint<'static> {
    let mut paint = Paint::default();
    paint.set_color_rgba8(ink.0, ink.1, ink.2, ink.3);
    paint.anti_alias = true;
    paint
}

/// Draws one environment frame after frame, and leaves trails behind what flies.
pub(crate) struct Picture {
    pixels: Pixmap,
    trails: BTreeMap<(usize, u64), VecDeque<Point>>,
}

/// Where a view is in the picture.
#[derive(Clone, Copy)]
struct Frame {
    left: f32,
    top: f32,
    width: f32,
    height: f32,
    middle: Point,
    scale: f64,
}

impl Frame {
    #[expect(clippy::cast_possible_truncation, reason = "pixels")]
    fn at(&self, point: Point) -> (f32, f32) {
        let across = ((point.0 - self.middle.0) * self.scale) as f32;
        let up = ((point.1 - self.middle.1) * self.scale) as f32;
        (self.left + self.width / 2.0 + across, self.top + self.height / 2.0 - up)
    }

    #[expect(clippy::cast_possible_truncation, reason = "pixels")]
    fn long(&self, length: f64) -> f32 {
        (length * self.scale) as f32
    }
}

impl Picture {
    /// Of so many pixels; `None` where there are none, or too many for memory.
    pub(crate) fn new((width, height): (u32, u32)) -> Option<Self> {
        Some(Self { pixels: Pixmap::new(width, height)?, trails: BTreeMap::new() })
    }

    pub(crate) fn size(&self) -> (u32, u32) {
        (self.pixels.width(), self.pixels.height())
    }

    /// Another episode begins.
    pub(crate) fn begin(&mut self) {
        self.trails.clear();
    }

    /// The scene, three bytes a pixel.
    #[expect(clippy::cast_precision_loss, reason = "numbers of views and pixels are small")]
    pub(crate) fn draw(&mut self, scene: &Scene) -> Vec<u8> {
        let (r, g, b, a) = SKY;
        self.pixels.fill(Color::from_rgba8(r, g, b, a));
        let (width, height) = (self.pixels.width() as f32, self.pixels.height() as f32);
        let each = width / scene.views.len().max(1) as f32;
        for (number, view) in scene.views.iter().enumerate() {
            let half = f64::from(each.min(height) / 2.0 - MARGIN).max(1.0);
            let frame = Frame {
                left: each * number as f32,
                top: 0.0,
                width: each,
                height,
                middle: view.middle,
                scale: half / view.reach,
            };
            self.view(number, view, frame);
            write(&mut self.pixels, (frame.left + MARGIN, height - MARGIN - LINE), view.title, TEXT);
        }
        for (line, words) in scene.told.iter().enumerate() {
            write(&mut self.pixels, (MARGIN, MARGIN + LINE * line as f32), words, TEXT);
        }
        let lines = scene.alerts.len().min(4);
        for (line, words) in scene.alerts.iter().take(lines).enumerate() {
            let up = height - MARGIN - LINE * (lines - line + 1) as f32;
            write(&mut self.pixels, (MARGIN, up), words, ALERT);
        }
        let opaque = self.pixels.data().chunks_exact(4);
        opaque.flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect()
    }

    fn view(&mut self, number: usize, view: &View, frame: Frame) {
        for mark in &view.marks {
            match mark {
                Mark::Disc { at, radius, ink } => {
                    self.fill(frame.at(*at), frame.long(*radius).max(1.0), colour(*ink));
                }
                Mark::Ring { at, radius, ink } => {
                    let (x, y) = frame.at(*at);
                    let ring = PathBuilder::from_circle(x, y, frame.long(*radius).max(0.5));
                    self.line(ring, 1.0, colour(*ink));
                }
                Mark::Path { points, ink } => self.path(points, &frame, 1.0, colour(*ink)),
                Mark::Craft { id, at, ink } => self.craft((number, *id), *at, *ink, &frame),
                Mark::Arrow { from, to, ink } => self.arrow(frame.at(*from), frame.at(*to), colour(*ink)),
            }
        }
    }

    fn fill(&mut self, (x, y): (f32, f32), radius: f32, ink: Colour) {
        if let Some(disc) = PathBuilder::from_circle(x, y, radius) {
            self.pixels.fill_path(&disc, &paint(ink), FillRule::Winding, Transform::identity(), None);
        }
    }

    fn line(&mut self, path: Option<Path>, width: f32, ink: Colour) {
        let stroke = Stroke { width, ..Stroke::default() };
        if let Some(path) = path {
            self.pixels.stroke_path(&path, &paint(ink), &stroke, Transform::identity(), None);
        }
    }

    fn path<'a>(
        &mut self,
        points: impl IntoIterator<Item = &'a Point>,
        frame: &Frame,
        width: f32,
        ink: Colour,
    ) {
        let mut builder = PathBuilder::new();
        for (n, point) in points.into_iter().enumerate() {
            let (x, y) = frame.at(*point);
            if n == 0 { builder.move_to(x, y) } else { builder.line_to(x, y) }
        }
        self.line(builder.finish(), width, ink);
    }

    /// A craft and its trail; debris, which a disc stands for already, leaves a trail alone.
    fn craft(&mut self, id: (usize, u64), at: Point, ink: Ink, frame: &Frame) {
        let trail = self.trails.entry(id).or_default();
        if trail.back() != Some(&at) {
            trail.push_back(at);
        }
        while trail.len() > TRAIL {
            trail.pop_front();
        }
        let points: Vec<Point> = trail.iter().copied().collect();
        let (r, g, b, _) = colour(ink);
        self.path(&points, frame, 1.5, (r, g, b, 90));
        let (x, y) = frame.at(at);
        match ink {
            Ink::Agent(_) => self.fill((x, y), CRAFT, colour(ink)),
            Ink::Lost => {
                let mut cross = PathBuilder::new();
                for (dx, dy) in [(CRAFT, CRAFT), (CRAFT, -CRAFT)] {
                    cross.move_to(x - dx, y - dy);
                    cross.line_to(x + dx, y + dy);
                }
                self.line(cross.finish(), 2.0, ALERT);
            }
            _ => {}
        }
    }

    fn arrow(&mut self, (x, y): (f32, f32), (to_x, to_y): (f32, f32), ink: Colour) {
        let (dx, dy) = (to_x - x, to_y - y);
        let long = dx.hypot(dy);
        if long < 0.5 {
            return;
        }
        let (ux, uy) = (dx / long, dy / long);
        let head = 5.0_f32.min(long);
        let mut arrow = PathBuilder::new();
        arrow.move_to(x, y);
        arrow.line_to(to_x, to_y);
        for side in [0.5, -0.5] {
            arrow.move_to(to_x, to_y);
            arrow.line_to(to_x - head * (ux - side * uy), to_y - head * (uy + side * ux));
        }
        self.line(arrow.finish(), 2.0, ink);
    }
}

/// A pixel, where there is one.
fn pixel(pixels: &mut Pixmap, x: f32, y: f32, ink: Colour) {
    if let Some(rect) = Rect::from_xywh(x, y, 1.0, 1.0) {
        let mut paint = paint(ink);
        paint.anti_alias = false;
        pixels.fill_rect(rect, &paint, Transform::identity(), None);
    }
}
