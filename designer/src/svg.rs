//! [`SvgCanvas`]: a small writer of SVG documents. Names of layouts are untrusted, so every text and attribute is escaped.

use std::fmt::Write;

/// Background of a picture: dark, to be readable on light and dark pages.
pub(crate) const BACKGROUND: &str = "#11151c";
/// Colour of primary text.
pub(crate) const TEXT: &str = "#d6dde6";
/// Colour of secondary text and of helper lines.
pub(crate) const DIM: &str = "#8594a7";
/// Colour of rules and grids.
pub(crate) const GRID: &str = "#313c4c";

/// Fonts of the text, in order of preference.
const FONTS: &str =
    "ui-sans-serif, system-ui, 'Segoe UI', Roboto, 'Helvetica Neue', 'DejaVu Sans', sans-serif";

/// Point or size on the page.
pub(crate) type Point = (f64, f64);

/// Line with a head at its end.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Arrow {
    pub(crate) from: Point,
    pub(crate) to: Point,
}

/// Content of an SVG document.
#[derive(Debug, Default)]
pub(crate) struct SvgCanvas(String);

/// Position of a text relative to its point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum TextAnchor {
    Start,
    Middle,
    End,
}

/// Style of a text.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TextStyle {
    size: f64,
    colour: &'static str,
    anchor: TextAnchor,
    is_bold: bool,
}

impl TextStyle {
    /// Creates a style of a font size, with the text beginning at its point.
    pub(crate) const fn new(size: f64) -> Self {
        Self { size, colour: TEXT, anchor: TextAnchor::Start, is_bold: false }
    }

    pub(crate) const fn colour(self, colour: &'static str) -> Self {
        Self { colour, ..self }
    }

    pub(crate) const fn anchor(self, anchor: TextAnchor) -> Self {
        Self { anchor, ..self }
    }

    pub(crate) const fn bold(self) -> Self {
        Self { is_bold: true, ..self }
    }
}

/// Style of a line.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stroke {
    pub(crate) colour: &'static str,
    pub(crate) width: f64,
    pub(crate) opacity: f64,
    /// Lengths of dashes and gaps; empty for a solid line.
    pub(crate) dashes: &'static str,
}

impl Stroke {
    /// Creates the style of a solid, opaque line.
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

impl SvgCanvas {
    /// Creates an empty canvas.
    pub(crate) const fn new() -> Self {
        Self(String::new())
    }

    /// Returns the document with a size and a title for screen readers.
    pub(crate) fn finish(self, size: Point, title: &str) -> String {
        let (width, height) = size;
        let mut document = Self::new();
        let view_box = format!("0 0 {} {}", format_number(width), format_number(height));
        document.open(
            "svg",
            &[
                ("xmlns", "http://www.w3.org/2000/svg"),
                ("viewBox", &view_box),
                ("width", &format_number(width)),
                ("height", &format_number(height)),
                ("role", "img"),
                ("font-family", FONTS),
            ],
        );
        document.0 += "<title>";
        document.escaped(title);
        document.0 += "</title>\n";
        document.panel((0.0, 0.0), size, BACKGROUND);
        document.0 += &self.0;
        document.close("svg");
        document.0
    }

    /// Clips everything up to [`SvgCanvas::end_clip`] to a rectangle. `id` must be unique in the document.
    pub(crate) fn begin_clip(&mut self, id: &str, (x, y): Point, (width, height): Point) {
        self.open("clipPath", &[("id", id)]);
        let size = [format_number(x), format_number(y), format_number(width), format_number(height)];
        let [x, y, width, height] = size.each_ref().map(String::as_str);
        self.element("rect", &[("x", x), ("y", y), ("width", width), ("height", height), ("rx", "6")]);
        self.close("clipPath");
        self.open("g", &[("clip-path", &format!("url(#{id})"))]);
    }

    /// Ends the clipping that [`SvgCanvas::begin_clip`] began.
    pub(crate) fn end_clip(&mut self) {
        self.close("g");
    }

    /// Draws a filled rectangle with round corners.
    pub(crate) fn panel(&mut self, (x, y): Point, (width, height): Point, fill: &str) {
        let size = [format_number(x), format_number(y), format_number(width), format_number(height)];
        let [x, y, width, height] = size.each_ref().map(String::as_str);
        let shape = [("x", x), ("y", y), ("width", width), ("height", height), ("rx", "6"), ("fill", fill)];
        self.element("rect", &shape);
    }

    /// Draws a line of text. The anchor of the style says which end of its baseline is at the point.
    pub(crate) fn text(&mut self, (x, y): Point, style: TextStyle, text: &str) {
        let numbers = [format_number(x), format_number(y), format_number(style.size)];
        let [x, y, size] = numbers.each_ref().map(String::as_str);
        let mut attributes = vec![("x", x), ("y", y), ("font-size", size), ("fill", style.colour)];
        match style.anchor {
            TextAnchor::Start => {}
            TextAnchor::Middle => attributes.push(("text-anchor", "middle")),
            TextAnchor::End => attributes.push(("text-anchor", "end")),
        }
        if style.is_bold {
            attributes.push(("font-weight", "600"));
        }
        self.start("text", &attributes);
        self.0.push('>');
        self.escaped(text);
        self.0 += "</text>\n";
    }

    /// Draws a circle; `fill` is a colour or `none`.
    pub(crate) fn circle(&mut self, (x, y): Point, radius: f64, fill: &str, stroke: Option<Stroke>) {
        let numbers = [format_number(x), format_number(y), format_number(radius)];
        let [x, y, radius] = numbers.each_ref().map(String::as_str);
        self.shape("circle", &[("cx", x), ("cy", y), ("r", radius), ("fill", fill)], stroke);
    }

    /// Draws an open polyline.
    pub(crate) fn line(&mut self, points: &[Point], stroke: Stroke) {
        if points.len() > 1 {
            self.shape("path", &[("d", &outline(points)), ("fill", "none")], Some(stroke));
        }
    }

    /// Draws a filled polygon.
    pub(crate) fn area(&mut self, points: &[Point], fill: &str, opacity: f64, stroke: Option<Stroke>) {
        let path = outline(points) + "Z";
        let opacity = format_number(opacity);
        self.shape("path", &[("d", &path), ("fill", fill), ("fill-opacity", &opacity)], stroke);
    }

    /// Draws many dots in one element.
    pub(crate) fn dots(&mut self, points: &[Point], stroke: Stroke) {
        let mut path = String::new();
        for (x, y) in points {
            let _ = write!(path, "M{} {}h0", format_number(*x), format_number(*y));
        }
        if !points.is_empty() {
            self.shape("path", &[("d", &path), ("fill", "none"), ("stroke-linecap", "round")], Some(stroke));
        }
    }

    /// Draws one arrow with a head of length `head`.
    pub(crate) fn arrow(&mut self, arrow: Arrow, head: f64, stroke: Stroke) {
        self.arrows(&[arrow], head, stroke);
    }

    /// Draws many arrows in two elements.
    pub(crate) fn arrows(&mut self, arrows: &[Arrow], head: f64, stroke: Stroke) {
        let (mut shafts, mut heads) = (String::new(), String::new());
        for Arrow { from, to } in arrows {
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
            let opacity = format_number(stroke.opacity);
            self.shape("path", &[("d", &shafts), ("fill", "none")], Some(stroke));
            self.shape("path", &[("d", &heads), ("fill", stroke.colour), ("fill-opacity", &opacity)], None);
        }
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
            self.escaped(value);
            self.0.push('"');
        }
    }

    fn element(&mut self, tag: &str, attributes: &[(&str, &str)]) {
        self.start(tag, attributes);
        self.0 += "/>\n";
    }

    fn escaped(&mut self, text: &str) {
        self.0 += &escape_xml(text);
    }

    fn shape(&mut self, tag: &str, attributes: &[(&str, &str)], stroke: Option<Stroke>) {
        let mut all = attributes.to_vec();
        let numbers = stroke.map(|stroke| [format_number(stroke.width), format_number(stroke.opacity)]);
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

fn outline(points: &[Point]) -> String {
    let mut path = String::new();
    for (at, (x, y)) in points.iter().enumerate() {
        let _ =
            write!(path, "{}{} {}", if at == 0 { 'M' } else { 'L' }, format_number(*x), format_number(*y));
    }
    path
}

/// Escapes untrusted text for text nodes and attribute values of XML and HTML. Characters that XML 1.0 does not allow
/// (section 2.2, production 2) become spaces.
#[must_use]
pub fn escape_xml(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
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

/// Formats a number with at most two decimals. A number that is not finite becomes 0, so that a picture never fails.
pub(crate) fn format_number(value: f64) -> String {
    let rounded = libm::round(value * 100.0) / 100.0;
    // This also covers −0.
    if rounded == 0.0 || !rounded.is_finite() { "0".to_owned() } else { rounded.to_string() }
}

/// Cuts a text to a width on the page. Letters are assumed to be 0.56 times as wide as high.
pub(crate) fn truncate_to_width(text: &str, width: f64, font_size: f64) -> String {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some dozens of letters")]
    let room = (width / (0.56 * font_size)).max(1.0) as usize;
    if text.chars().count() <= room {
        text.to_owned()
    } else {
        text.chars().take(room.saturating_sub(1)).chain(['…']).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_at_most_two_decimals() {
        let numbers =
            [0.1 + 0.2, -0.001, 12.0, 1.0 / 3.0, f64::NAN, f64::INFINITY, -7.456].map(format_number);
        assert_eq!(numbers, ["0.3", "0", "12", "0.33", "0", "0", "-7.46"]);
    }

    #[test]
    fn untrusted_text_is_escaped() {
        let text = "</title><script>alert('&\"')</script>\u{0}\u{b}\u{ffff}]]>é";
        let mut canvas = SvgCanvas::new();
        canvas.text((1.0, 2.0), TextStyle::new(3.0), text);
        canvas.begin_clip(text, (0.0, 0.0), (1.0, 1.0));
        canvas.end_clip();
        let svg = canvas.finish((10.0, 10.0), text);
        let document = roxmltree::Document::parse(&svg).unwrap();
        let shown = "</title><script>alert('&\"')</script>   ]]>é";
        assert!(document.descendants().all(|node| node.tag_name().name() != "script"));
        let svg_tag = |tag: &'static str| ("http://www.w3.org/2000/svg", tag);
        for tag in ["title", "text"] {
            let node = document.descendants().find(|node| node.has_tag_name(svg_tag(tag))).unwrap();
            assert_eq!(node.text(), Some(shown));
        }
    }

    #[test]
    fn long_text_is_cut_with_an_ellipsis() {
        assert_eq!(truncate_to_width("short", 100.0, 10.0), "short");
        let cut = truncate_to_width(&"w".repeat(60), 100.0, 10.0);
        assert!(cut.ends_with('…') && cut.chars().count() == 17, "{cut}");
    }
}
