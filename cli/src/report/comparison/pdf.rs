//! Backend of `plotters` that draws into the contents of a PDF page, and text in the standard font Helvetica.
//!
//! The standard fonts need no file and have the characters of Western Europe. Others are shown as a question mark.

use std::collections::BTreeSet;
use std::convert::Infallible;

use pdf_writer::types::{LineCapStyle, LineJoinStyle};
use pdf_writer::{Content, Name, Str};
use plotters_backend::text_anchor::{HPos, VPos};
use plotters_backend::{
    BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingBackend, DrawingErrorKind,
    FontTransform,
};

/// Name of the font in the resources of a page.
pub(super) const REGULAR: Name<'static> = Name(b"F1");
/// Name of the bold font.
pub(super) const BOLD: Name<'static> = Name(b"F2");
/// Widths of the characters from space to ~ in Helvetica, in thousandths of the size.
const WIDTHS: [u16; 95] = [
    278, 278, 355, 556, 556, 889, 667, 191, 333, 333, 389, 584, 278, 333, 278, 278, 556, 556, 556, 556, 556,
    556, 556, 556, 556, 556, 278, 278, 584, 584, 584, 556, 1015, 667, 667, 722, 722, 667, 611, 778, 722, 278,
    500, 667, 556, 833, 722, 778, 667, 778, 722, 667, 611, 722, 667, 944, 667, 667, 611, 278, 278, 278, 469,
    556, 333, 556, 556, 500, 556, 556, 278, 556, 556, 222, 222, 500, 222, 833, 556, 556, 556, 556, 333, 500,
    278, 556, 500, 722, 500, 500, 500, 334, 260, 334, 584,
];
/// Width of all other characters.
const OTHER_WIDTH: u16 = 556;
/// Characters of the encoding that Unicode has at other places.
const MOVED: [(char, u8); 11] = [
    ('€', 0x80),
    ('…', 0x85),
    ('‘', 0x91),
    ('’', 0x92),
    ('“', 0x93),
    ('”', 0x94),
    ('•', 0x95),
    ('–', 0x96),
    ('—', 0x97),
    ('™', 0x99),
    ('−', b'-'),
];

/// Encodes a text in the encoding of the fonts (WinAnsiEncoding).
pub(super) fn encode(text: &str) -> Vec<u8> {
    let byte = |character: char| match character {
        ' '..='~' | '\u{a0}'..='\u{ff}' => u8::try_from(u32::from(character)).unwrap_or(b'?'),
        other => MOVED.iter().find(|(moved, _)| *moved == other).map_or(b'?', |(_, byte)| *byte),
    };
    text.chars().map(byte).collect()
}

/// Returns the width of a text in points.
pub(super) fn text_width(text: &str, size: f32) -> f32 {
    let width = |byte: u8| {
        let at = usize::from(byte).checked_sub(usize::from(b' '));
        at.and_then(|at| WIDTHS.get(at)).copied().unwrap_or(OTHER_WIDTH)
    };
    let sum: u32 = encode(text).into_iter().map(|byte| u32::from(width(byte))).sum();
    sum as f32 * size / 1000.0
}

/// Backend that draws one figure. Pixels are points of the page's coordinates, and y points down.
pub(super) struct PdfBackend<'a> {
    /// Contents to which the figure is appended.
    content: &'a mut Content,
    /// Opacities in percent that the figure uses.
    opacities: &'a mut BTreeSet<u8>,
    size: (u32, u32),
}

impl<'a> PdfBackend<'a> {
    /// Creates a backend for a figure of this size; the caller has moved the origin of the coordinates to its upper left corner.
    pub(super) fn new(
        content: &'a mut Content,
        opacities: &'a mut BTreeSet<u8>,
        width: u32,
        height: u32,
    ) -> Self {
        content.set_line_cap(LineCapStyle::ButtCap).set_line_join(LineJoinStyle::RoundJoin);
        Self { content, opacities, size: (width, height) }
    }

    fn set_colour(&mut self, colour: BackendColor) {
        let part = |value: u8| f32::from(value) / 255.0;
        let (r, g, b) = (part(colour.rgb.0), part(colour.rgb.1), part(colour.rgb.2));
        self.content.set_stroke_rgb(r, g, b).set_fill_rgb(r, g, b);
        let percent = opacity_percent(colour.alpha);
        self.opacities.insert(percent);
        self.content.set_parameters(Name(opacity_name(percent).as_bytes()));
    }

    /// Begins a path of lines; false if it has fewer than two points.
    fn trace(&mut self, path: impl IntoIterator<Item = BackendCoord>) -> bool {
        let mut n = 0;
        for (x, y) in path {
            let (x, y) = (x as f32, -y as f32);
            if n == 0 {
                self.content.move_to(x, y);
            } else {
                self.content.line_to(x, y);
            }
            n += 1;
        }
        if n == 1 {
            self.content.end_path();
        }
        n > 1
    }
}

/// Returns an opacity in percent.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to 100")]
fn opacity_percent(alpha: f64) -> u8 {
    (100.0 * alpha.clamp(0.0, 1.0)).round() as u8
}

/// Returns the name of an opacity in the resources of a page.
pub(super) fn opacity_name(percent: u8) -> String {
    format!("A{percent}")
}

type DrawingResult = Result<(), DrawingErrorKind<Infallible>>;

impl DrawingBackend for PdfBackend<'_> {
    type ErrorType = Infallible;

    fn get_size(&self) -> (u32, u32) {
        self.size
    }

    fn ensure_prepared(&mut self) -> DrawingResult {
        Ok(())
    }

    fn present(&mut self) -> DrawingResult {
        Ok(())
    }

    fn draw_pixel(&mut self, point: BackendCoord, colour: BackendColor) -> DrawingResult {
        self.draw_rect(point, (point.0 + 1, point.1 + 1), &colour, true)
    }

    fn draw_line<S: BackendStyle>(
        &mut self,
        from: BackendCoord,
        to: BackendCoord,
        style: &S,
    ) -> DrawingResult {
        self.draw_path([from, to], style)
    }

    fn draw_rect<S: BackendStyle>(
        &mut self,
        (left, top): BackendCoord,
        (right, bottom): BackendCoord,
        style: &S,
        is_filled: bool,
    ) -> DrawingResult {
        let corners = [(left, top), (right, top), (right, bottom), (left, bottom), (left, top)];
        if is_filled { self.fill_polygon(corners, style) } else { self.draw_path(corners, style) }
    }

    fn draw_path<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        path: I,
        style: &S,
    ) -> DrawingResult {
        if style.color().alpha > 0.0 {
            self.set_colour(style.color());
            self.content.set_line_width(style.stroke_width() as f32);
            if self.trace(path) {
                self.content.stroke();
            }
        }
        Ok(())
    }

    fn draw_circle<S: BackendStyle>(
        &mut self,
        (x, y): BackendCoord,
        radius: u32,
        style: &S,
        is_filled: bool,
    ) -> DrawingResult {
        let corner = |i: u32| {
            let angle = f64::from(i) * std::f64::consts::TAU / 24.0;
            let offset = |part: f64| (f64::from(radius) * part).round();
            #[expect(clippy::cast_possible_truncation, reason = "pixels of a picture")]
            let (dx, dy) = (offset(libm::cos(angle)) as i32, offset(libm::sin(angle)) as i32);
            (x + dx, y + dy)
        };
        let corners = (0..=24).map(corner);
        if is_filled { self.fill_polygon(corners, style) } else { self.draw_path(corners, style) }
    }

    fn fill_polygon<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        corners: I,
        style: &S,
    ) -> DrawingResult {
        if style.color().alpha > 0.0 {
            self.set_colour(style.color());
            if self.trace(corners) {
                self.content.close_path().fill_nonzero();
            }
        }
        Ok(())
    }

    fn draw_text<S: BackendTextStyle>(
        &mut self,
        text: &str,
        style: &S,
        (x, y): BackendCoord,
    ) -> DrawingResult {
        if style.color().alpha == 0.0 {
            return Ok(());
        }
        self.set_colour(style.color());
        // The same size and anchors as in SVG.
        let size = style.size() as f32 / 1.24;
        let width = text_width(text, size);
        let along = match style.anchor().h_pos {
            HPos::Left => 0.0,
            HPos::Center => -width / 2.0,
            HPos::Right => -width,
        };
        let across = match style.anchor().v_pos {
            VPos::Top => -0.76 * size,
            VPos::Center => -0.26 * size,
            VPos::Bottom => 0.26 * size,
        };
        let (cos, sin) = match style.transform() {
            FontTransform::None => (1.0, 0.0),
            FontTransform::Rotate90 => (0.0, -1.0),
            FontTransform::Rotate180 => (-1.0, 0.0),
            FontTransform::Rotate270 => (0.0, 1.0),
        };
        let (x, y) = (x as f32 + cos * along - sin * across, -y as f32 + sin * along + cos * across);
        self.content.begin_text().set_font(REGULAR, size).set_text_matrix([cos, sin, -sin, cos, x, y]);
        self.content.show(Str(&encode(text))).end_text();
        Ok(())
    }

    fn estimate_text_size<S: BackendTextStyle>(
        &self,
        text: &str,
        style: &S,
    ) -> Result<(u32, u32), DrawingErrorKind<Infallible>> {
        let size = style.size() as f32 / 1.24;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "pixels of a picture")]
        let pixels = |length: f32| length.ceil() as u32;
        Ok((pixels(text_width(text, size)), pixels(size)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_encoded_for_the_standard_fonts() {
        assert_eq!(encode("a–é − 猫"), b"a\x96\xe9 - ?");
        assert!((text_width("1,200", 10.0) - 25.02).abs() < 1e-3);
    }
}
