//! Pictures of layouts, as SVG. What is drawn is the world's ([`crate::Language::picture`]); here is what every picture is
//! written with. Names are strangers' words: whatever is text, or the value of an attribute, is escaped on its way out.

use std::fmt::Write;

use env_core::{Bracket, Scenario};
use serde_json::Value;

/// A layout to draw.
#[derive(Debug, Clone, Copy)]
pub struct Subject<'a> {
    /// Its name, for people.
    pub name: &'a str,
    /// The design it was made of; none for one that was laid out by hand.
    pub design: Option<&'a Value>,
    /// The scenario it makes.
    pub scenario: &'a Scenario,
    /// What that is worth, with the witness.
    pub bracket: &'a Bracket,
}

/// The picture of a layout: an SVG document by itself, about 900 wide; none for a world that nobody designs for yet.
#[must_use]
pub fn draw(subject: Subject<'_>) -> Option<String> {
    crate::language(subject.scenario.task()).map(|language| language.picture(subject))
}

/// Dark enough for the colours, on a light page as on a dark one.
pub(crate) const BACK: &str = "#11151c";
/// Words.
pub(crate) const TEXT: &str = "#d6dde6";
/// Words that matter less, and lines that help the eye.
pub(crate) const DIM: &str = "#8594a7";
/// Rules and grids.
pub(crate) const FAINT: &str = "#313c4c";

/// From where to where.
pub(crate) type Arrow = ((f64, f64), (f64, f64));

/// An SVG document on its way out.
#[derive(Debug, Default)]
pub(crate) struct Canvas(String);

/// How words are written.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pen {
    pub(crate) size: f64,
    pub(crate) colour: &'static str,
    /// `start`, `middle` or `end`.
    pub(crate) anchor: &'static str,
    pub(crate) bold: bool,
}

impl Pen {
    /// Words in this size, from the left.
    pub(crate) const fn new(size: f64) -> Self {
        Self { size, colour: TEXT, anchor: "start", bold: false }
    }

    pub(crate) const fn colour(self, colour: &'static str) -> Self {
        Self { colour, ..self }
    }

    pub(crate) const fn anchor(self, anchor: &'static str) -> Self {
        Self { anchor, ..self }
    }

    pub(crate) const fn bold(self) -> Self {
        Self { bold: true, ..self }
    }
}

/// Attributes that lines share.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stroke {
    pub(crate) colour: &'static str,
    pub(crate) width: f64,
    pub(crate) opacity: f64,
    /// Lengths of dashes and gaps; none is a solid line.
    pub(crate) dashes: &'static str,
}

impl Stroke {
    /// A solid line.
    pub(crate) const fn new(colour: &'static str, width: f64) -> Self {
        Self { colour, width, opacity: 1.0, dashes: "" }
    }

    pub(crate) const fn opacity(self, opacity: f64) -> Self {
        Self { opacity, ..self }
    }

    pub(crate) const fn dashes(self, dashes: &'static str) -> Self {
        Self { dashes, ..self }
    }
}

impl Canvas {
    /// Nothing yet.
    pub(crate) const fn new() -> Self {
        Self(String::new())
    }

    /// The document, of this size, with a title for who cannot see it.
    pub(crate) fn finish(self, (width, height): (f64, f64), title: &str) -> String {
        let drawn = self.0;
        let mut canvas = Self(String::new());
        let size = format!("0 0 {} {}", number(width), number(height));
        canvas.open(
            "svg",
            &[
                ("xmlns", "http://www.w3.org/2000/svg"),
                ("viewBox", &size),
                ("width", &number(width)),
                ("height", &number(height)),
                ("role", "img"),
                (
                    "font-family",
                    "ui-sans-serif, system-ui, 'Segoe UI', Roboto, 'Helvetica Neue', 'DejaVu Sans', sans-serif",
                ),
            ],
        );
        canvas.0 += "<title>";
        canvas.words(title);
        canvas.0 += "</title>\n";
        canvas.panel((0.0, 0.0), (width, height), BACK);
        canvas.0 += &drawn;
        canvas.close("svg");
        canvas.0
    }

    fn open(&mut self, tag: &str, attributes: &[(&str, &str)]) {
        self.start(tag, attributes);
        self.0 += ">\n";
    }

    fn close(&mut self, tag: &str) {
        // Writing into a string cannot fail, here and below.
        let _ = writeln!(self.0, "</{tag}>");
    }

    fn start(&mut self, tag: &str, attributes: &[(&str, &str)]) {
        self.0.push('<');
        self.0 += tag;
        for (name, value) in attributes {
            let _ = write!(self.0, " {name}=\"");
            self.words(value);
            self.0.push('"');
        }
    }

    fn element(&mut self, tag: &str, attributes: &[(&str, &str)]) {
        self.start(tag, attributes);
        self.0 += "/>\n";
    }

    fn words(&mut self, words: &str) {
        self.0 += &escaped(words);
    }

    /// What follows is drawn within this rectangle only; [`Canvas::end_window`] ends it. `id` is one of the document's own.
    pub(crate) fn window(&mut self, id: &str, (x, y): (f64, f64), (width, height): (f64, f64)) {
        self.open("clipPath", &[("id", id)]);
        let size = [number(x), number(y), number(width), number(height)];
        let [x, y, width, height] = size.each_ref().map(String::as_str);
        self.element("rect", &[("x", x), ("y", y), ("width", width), ("height", height), ("rx", "6")]);
        self.close("clipPath");
        self.open("g", &[("clip-path", &format!("url(#{id})"))]);
    }

    /// Ends what [`Canvas::window`] began.
    pub(crate) fn end_window(&mut self) {
        self.close("g");
    }

    /// A filled rectangle.
    pub(crate) fn panel(&mut self, (x, y): (f64, f64), (width, height): (f64, f64), fill: &str) {
        let size = [number(x), number(y), number(width), number(height)];
        let [x, y, width, height] = size.each_ref().map(String::as_str);
        let shape = [("x", x), ("y", y), ("width", width), ("height", height), ("rx", "6"), ("fill", fill)];
        self.element("rect", &shape);
    }

    /// Words, their baseline's start (or middle, or end) here.
    pub(crate) fn text(&mut self, (x, y): (f64, f64), pen: Pen, words: &str) {
        let numbers = [number(x), number(y), number(pen.size)];
        let [x, y, size] = numbers.each_ref().map(String::as_str);
        let mut attributes = vec![("x", x), ("y", y), ("font-size", size), ("fill", pen.colour)];
        if pen.anchor != "start" {
            attributes.push(("text-anchor", pen.anchor));
        }
        if pen.bold {
            attributes.push(("font-weight", "600"));
        }
        self.start("text", &attributes);
        self.0.push('>');
        self.words(words);
        self.0 += "</text>\n";
    }

    /// A circle; nothing of it is filled where `fill` is `none`.
    pub(crate) fn circle(&mut self, (x, y): (f64, f64), radius: f64, fill: &str, stroke: Option<Stroke>) {
        let numbers = [number(x), number(y), number(radius)];
        let [x, y, radius] = numbers.each_ref().map(String::as_str);
        self.shape("circle", &[("cx", x), ("cy", y), ("r", radius), ("fill", fill)], stroke);
    }

    /// An outline of straight pieces; closed and filled where there is a `fill`.
    pub(crate) fn line(&mut self, points: &[(f64, f64)], stroke: Stroke) {
        if points.len() > 1 {
            self.shape("path", &[("d", &outline(points)), ("fill", "none")], Some(stroke));
        }
    }

    /// A filled outline of straight pieces.
    pub(crate) fn area(&mut self, points: &[(f64, f64)], fill: &str, opacity: f64, stroke: Option<Stroke>) {
        let path = outline(points) + "Z";
        let opacity = number(opacity);
        self.shape("path", &[("d", &path), ("fill", fill), ("fill-opacity", &opacity)], stroke);
    }

    /// Many dots in one element.
    pub(crate) fn dots(&mut self, points: &[(f64, f64)], stroke: Stroke) {
        let mut path = String::new();
        for (x, y) in points {
            let _ = write!(path, "M{} {}h0", number(*x), number(*y));
        }
        if !points.is_empty() {
            self.shape("path", &[("d", &path), ("fill", "none"), ("stroke-linecap", "round")], Some(stroke));
        }
    }

    /// A line that ends in a head.
    pub(crate) fn arrow(&mut self, from: (f64, f64), to: (f64, f64), head: f64, stroke: Stroke) {
        self.arrows(&[(from, to)], head, stroke);
    }

    /// Many of them, in two elements.
    pub(crate) fn arrows(&mut self, arrows: &[Arrow], head: f64, stroke: Stroke) {
        let (mut shafts, mut heads) = (String::new(), String::new());
        for (from, to) in arrows {
            let (dx, dy) = (to.0 - from.0, to.1 - from.1);
            let length = (dx * dx + dy * dy).sqrt().max(1e-6);
            let (ux, uy) = (dx / length, dy / length);
            let neck = (to.0 - head * ux, to.1 - head * uy);
            let wing = 0.5 * head;
            shafts += &outline(&[*from, neck]);
            let wings = [(neck.0 - wing * uy, neck.1 + wing * ux), (neck.0 + wing * uy, neck.1 - wing * ux)];
            heads += &outline(&[*to, wings[0], wings[1]]);
            heads.push('Z');
        }
        if !arrows.is_empty() {
            let opacity = number(stroke.opacity);
            self.shape("path", &[("d", &shafts), ("fill", "none")], Some(stroke));
            self.shape("path", &[("d", &heads), ("fill", stroke.colour), ("fill-opacity", &opacity)], None);
        }
    }

    fn shape(&mut self, tag: &str, attributes: &[(&str, &str)], stroke: Option<Stroke>) {
        let mut all = attributes.to_vec();
        let numbers = stroke.map(|stroke| [number(stroke.width), number(stroke.opacity)]);
        if let (Some(stroke), Some([width, opacity])) = (stroke, &numbers) {
            all.extend([("stroke", stroke.colour), ("stroke-width", width)]);
            if stroke.opacity < 1.0 {
                all.push(("stroke-opacity", opacity));
            }
            if !stroke.dashes.is_empty() {
                all.push(("stroke-dasharray", stroke.dashes));
            }
        }
        self.element(tag, &all);
    }
}

fn outline(points: &[(f64, f64)]) -> String {
    let mut path = String::new();
    for (at, (x, y)) in points.iter().enumerate() {
        let _ = write!(path, "{}{} {}", if at == 0 { 'M' } else { 'L' }, number(*x), number(*y));
    }
    path
}

/// A stranger's words as text or the value of an attribute of XML or HTML: escaped, and without what XML 1.0 does not have
/// (section 2.2, production 2).
#[must_use]
pub fn escaped(words: &str) -> String {
    let mut out = String::with_capacity(words.len());
    for c in words.chars() {
        match c {
            '&' => out += "&amp;",
            '<' => out += "&lt;",
            '>' => out += "&gt;",
            '"' => out += "&quot;",
            '\'' => out += "&#39;",
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => out.push(' '),
            c => out.push(c),
        }
    }
    out
}

/// A number to a hundredth, as short as it can be written. What is no number is 0: a picture is no place to fail.
pub(crate) fn number(value: f64) -> String {
    let rounded = libm::round(value * 100.0) / 100.0;
    // −0 and what is not finite.
    if rounded == 0.0 || !rounded.is_finite() { "0".to_owned() } else { rounded.to_string() }
}

/// As much of a line as there is room for, in this size of letters: about half as wide as high.
pub(crate) fn fitted(words: &str, width: f64, size: f64) -> String {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some dozens of letters")]
    let room = (width / (0.56 * size)).max(1.0) as usize;
    if words.chars().count() <= room {
        words.to_owned()
    } else {
        words.chars().take(room.saturating_sub(1)).chain(['…']).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        let numbers = [0.1 + 0.2, -0.001, 12.0, 1.0 / 3.0, f64::NAN, f64::INFINITY, -7.456].map(number);
        assert_eq!(numbers, ["0.3", "0", "12", "0.33", "0", "0", "-7.46"]);
    }

    #[test]
    fn strangers_words_stay_words() {
        let words = "</title><script>alert('&\"')</script>\u{0}\u{b}\u{ffff}]]>é";
        let mut canvas = Canvas::new();
        canvas.text((1.0, 2.0), Pen::new(3.0), words);
        canvas.window(words, (0.0, 0.0), (1.0, 1.0));
        canvas.end_window();
        let text = canvas.finish((10.0, 10.0), words);
        let document = roxmltree::Document::parse(&text).unwrap();
        let told = "</title><script>alert('&\"')</script>   ]]>é";
        assert!(document.descendants().all(|node| node.tag_name().name() != "script"));
        let svg = |tag: &'static str| ("http://www.w3.org/2000/svg", tag);
        for tag in ["title", "text"] {
            let node = document.descendants().find(|node| node.has_tag_name(svg(tag))).unwrap();
            assert_eq!(node.text(), Some(told));
        }
    }

    #[test]
    fn long_names_are_cut() {
        assert_eq!(fitted("short", 100.0, 10.0), "short");
        let cut = fitted(&"w".repeat(60), 100.0, 10.0);
        assert!(cut.ends_with('…') && cut.chars().count() == 17, "{cut}");
    }
}
