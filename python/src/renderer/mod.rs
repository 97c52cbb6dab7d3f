//! Rendering of scenes as pixels.

mod text;

use std::collections::{BTreeMap, VecDeque};

use env_core::scene::{Point, Primitive, Scene, Style, View};
use tiny_skia::{Color, FillRule, Paint, Path, PathBuilder, Pixmap, Rect, Stroke, Transform};

use self::text::{LINE_HEIGHT, draw_text};

/// Positions that the trail of a marker keeps.
const TRAIL_LENGTH: usize = 12;
/// Radius of the disc of a marker, pixels.
const MARKER_RADIUS: f32 = 5.0;
/// Margin around a view, pixels.
const MARGIN: f32 = 8.0;
/// Maximum number of alerts in an image.
const MAX_ALERTS: usize = 4;

/// Color with an opacity.
#[derive(Clone, Copy)]
struct Rgba {
    red: u8,
    green: u8,
    blue: u8,
    alpha: u8,
}

const BACKGROUND: Rgba = rgb(11, 16, 32);
const TEXT: Rgba = rgb(205, 214, 228);
const ALERT: Rgba = rgb(255, 138, 101);
/// Colors of agents, distinguishable without red against green (Okabe and Ito 2008, "Color Universal Design").
const AGENTS: [Rgba; 5] =
    [rgb(86, 180, 233), rgb(230, 159, 0), rgb(0, 200, 150), rgb(204, 121, 167), rgb(240, 228, 66)];

const fn rgb(red: u8, green: u8, blue: u8) -> Rgba {
    Rgba { red, green, blue, alpha: 255 }
}

const fn style_color(style: Style) -> Rgba {
    match style {
        Style::Center => rgb(38, 74, 120),
        Style::Agent(number) => AGENTS[number as usize % AGENTS.len()],
        Style::Lost => rgb(120, 60, 60),
        Style::Debris => rgb(176, 184, 196),
        Style::HiddenDebris => rgb(88, 94, 108),
        Style::Target => rgb(70, 150, 110),
        Style::Burn => rgb(255, 214, 102),
        Style::Guide => Rgba { red: 120, green: 140, blue: 170, alpha: 110 },
    }
}

fn paint(color: Rgba) -> Paint<'static> {
    let mut paint = Paint::default();
    paint.set_color_rgba8(color.red, color.green, color.blue, color.alpha);
    paint.anti_alias = true;
    paint
}

/// Size of an image, pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ImageSize {
    pub(crate) width: u32,
    pub(crate) height: u32,
}

/// Position in an image, pixels from the upper left corner.
#[derive(Debug, Clone, Copy)]
struct PixelPosition {
    x: f32,
    y: f32,
}

/// Renders one environment frame by frame, with trails behind its markers.
pub(crate) struct Renderer {
    pixels: Pixmap,
    trails: BTreeMap<TrailKey, VecDeque<Point>>,
}

/// A marker in one of the views of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct TrailKey {
    view: usize,
    marker: u64,
}

/// Mapping from the units of a view to pixels of the image.
#[derive(Clone, Copy)]
struct Viewport {
    left: f32,
    top: f32,
    width: f32,
    height: f32,
    middle: Point,
    scale: f64,
}

impl Viewport {
    /// Converts a point to pixels.
    #[expect(clippy::cast_possible_truncation, reason = "pixels")]
    fn position(&self, point: Point) -> PixelPosition {
        let across = ((point.0 - self.middle.0) * self.scale) as f32;
        let up = ((point.1 - self.middle.1) * self.scale) as f32;
        PixelPosition { x: self.left + self.width / 2.0 + across, y: self.top + self.height / 2.0 - up }
    }

    /// Converts a length to pixels.
    #[expect(clippy::cast_possible_truncation, reason = "pixels")]
    fn length(&self, length: f64) -> f32 {
        (length * self.scale) as f32
    }
}

impl Renderer {
    /// Allocates an image; `None` if the size is zero or too large.
    pub(crate) fn new(size: ImageSize) -> Option<Self> {
        Some(Self { pixels: Pixmap::new(size.width, size.height)?, trails: BTreeMap::new() })
    }

    /// Size of the image.
    pub(crate) fn size(&self) -> ImageSize {
        ImageSize { width: self.pixels.width(), height: self.pixels.height() }
    }

    /// Removes all trails, as at the start of an episode.
    pub(crate) fn clear_trails(&mut self) {
        self.trails.clear();
    }

    /// Renders a scene as RGB bytes, row by row.
    #[expect(clippy::cast_precision_loss, reason = "numbers of views and pixels are small")]
    pub(crate) fn render(&mut self, scene: &Scene) -> Vec<u8> {
        self.pixels.fill(Color::from_rgba8(
            BACKGROUND.red,
            BACKGROUND.green,
            BACKGROUND.blue,
            BACKGROUND.alpha,
        ));
        let (width, height) = (self.pixels.width() as f32, self.pixels.height() as f32);
        let view_width = width / scene.views.len().max(1) as f32;
        for (number, view) in scene.views.iter().enumerate() {
            let half = f64::from(view_width.min(height) / 2.0 - MARGIN).max(1.0);
            let viewport = Viewport {
                left: view_width * number as f32,
                top: 0.0,
                width: view_width,
                height,
                middle: view.center,
                scale: half / view.half_extent,
            };
            self.draw_view(number, view, viewport);
            let title = PixelPosition { x: viewport.left + MARGIN, y: height - MARGIN - LINE_HEIGHT };
            draw_text(&mut self.pixels, title, view.title, TEXT);
        }
        for (line, text) in scene.status_lines.iter().enumerate() {
            draw_text(
                &mut self.pixels,
                PixelPosition { x: MARGIN, y: MARGIN + LINE_HEIGHT * line as f32 },
                text,
                TEXT,
            );
        }
        let lines = scene.alerts.len().min(MAX_ALERTS);
        for (line, text) in scene.alerts.iter().take(lines).enumerate() {
            let y = height - MARGIN - LINE_HEIGHT * (lines - line + 1) as f32;
            draw_text(&mut self.pixels, PixelPosition { x: MARGIN, y }, text, ALERT);
        }
        let rgba = self.pixels.data().chunks_exact(4);
        rgba.flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect()
    }

    fn draw_view(&mut self, number: usize, view: &View, viewport: Viewport) {
        for primitive in &view.primitives {
            match primitive {
                Primitive::Disc { at, radius, style } => {
                    let radius = viewport.length(*radius).max(1.0);
                    self.fill_disc(viewport.position(*at), radius, style_color(*style));
                }
                Primitive::Ring { at, radius, style } => {
                    let PixelPosition { x, y } = viewport.position(*at);
                    let ring = PathBuilder::from_circle(x, y, viewport.length(*radius).max(0.5));
                    self.stroke(ring, 1.0, style_color(*style));
                }
                Primitive::Path { points, style } => {
                    self.draw_line(points, &viewport, 1.0, style_color(*style));
                }
                Primitive::Marker { id, at, style } => {
                    self.draw_marker(TrailKey { view: number, marker: *id }, *at, *style, &viewport);
                }
                Primitive::Arrow { from, to, style } => {
                    self.draw_arrow(viewport.position(*from), viewport.position(*to), style_color(*style));
                }
            }
        }
    }

    fn fill_disc(&mut self, center: PixelPosition, radius: f32, color: Rgba) {
        if let Some(disc) = PathBuilder::from_circle(center.x, center.y, radius) {
            self.pixels.fill_path(&disc, &paint(color), FillRule::Winding, Transform::identity(), None);
        }
    }

    fn stroke(&mut self, path: Option<Path>, width: f32, color: Rgba) {
        let stroke = Stroke { width, ..Stroke::default() };
        if let Some(path) = path {
            self.pixels.stroke_path(&path, &paint(color), &stroke, Transform::identity(), None);
        }
    }

    fn draw_line<'a>(
        &mut self,
        points: impl IntoIterator<Item = &'a Point>,
        viewport: &Viewport,
        width: f32,
        color: Rgba,
    ) {
        let mut builder = PathBuilder::new();
        for (n, point) in points.into_iter().enumerate() {
            let PixelPosition { x, y } = viewport.position(*point);
            if n == 0 { builder.move_to(x, y) } else { builder.line_to(x, y) }
        }
        self.stroke(builder.finish(), width, color);
    }

    /// Draws a marker and its trail; a piece of debris gets only the trail, since the scene has a disc for it.
    fn draw_marker(&mut self, key: TrailKey, at: Point, style: Style, viewport: &Viewport) {
        let trail = self.trails.entry(key).or_default();
        if trail.back() != Some(&at) {
            trail.push_back(at);
        }
        while trail.len() > TRAIL_LENGTH {
            trail.pop_front();
        }
        let points: Vec<Point> = trail.iter().copied().collect();
        self.draw_line(&points, viewport, 1.5, Rgba { alpha: 90, ..style_color(style) });
        let position = viewport.position(at);
        let PixelPosition { x, y } = position;
        match style {
            Style::Agent(_) => self.fill_disc(position, MARKER_RADIUS, style_color(style)),
            Style::Lost => {
                let mut cross = PathBuilder::new();
                for (dx, dy) in [(MARKER_RADIUS, MARKER_RADIUS), (MARKER_RADIUS, -MARKER_RADIUS)] {
                    cross.move_to(x - dx, y - dy);
                    cross.line_to(x + dx, y + dy);
                }
                self.stroke(cross.finish(), 2.0, ALERT);
            }
            _ => {}
        }
    }

    fn draw_arrow(&mut self, from: PixelPosition, to: PixelPosition, color: Rgba) {
        let (dx, dy) = (to.x - from.x, to.y - from.y);
        let length = dx.hypot(dy);
        if length < 0.5 {
            return;
        }
        let (ux, uy) = (dx / length, dy / length);
        let head = 5.0_f32.min(length);
        let mut arrow = PathBuilder::new();
        arrow.move_to(from.x, from.y);
        arrow.line_to(to.x, to.y);
        for side in [0.5, -0.5] {
            arrow.move_to(to.x, to.y);
            arrow.line_to(to.x - head * (ux - side * uy), to.y - head * (uy + side * ux));
        }
        self.stroke(arrow.finish(), 2.0, color);
    }
}

/// Fills one pixel, if it is inside the image.
fn fill_pixel(pixels: &mut Pixmap, position: PixelPosition, color: Rgba) {
    if let Some(rect) = Rect::from_xywh(position.x, position.y, 1.0, 1.0) {
        let mut paint = paint(color);
        paint.anti_alias = false;
        pixels.fill_rect(rect, &paint, Transform::identity(), None);
    }
}
