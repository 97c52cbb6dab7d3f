//! Words in a picture: one of embedded-graphics' built-in fonts, so that no font has to be found.

use embedded_graphics::mono_font::MonoTextStyle;
use embedded_graphics::mono_font::ascii::FONT_7X13;
use embedded_graphics::pixelcolor::BinaryColor;
use embedded_graphics::prelude::*;
use embedded_graphics::text::{Baseline, Text};
use tiny_skia::Pixmap;

use super::{Colour, pixel};

/// Pixels from line to line.
pub(super) const LINE: f32 = 15.0;

struct Ink<'a> {
    pixels: &'a mut Pixmap,
    at: (f32, f32),
    colour: Colour,
}

impl OriginDimensions for Ink<'_> {
    fn size(&self) -> Size {
        Size::new(self.pixels.width(), self.pixels.height())
    }
}

impl DrawTarget for Ink<'_> {
    type Color = BinaryColor;
    type Error = std::convert::Infallible;

    #[expect(clippy::cast_precision_loss, reason = "pixels")]
    fn draw_iter<I: IntoIterator<Item = Pixel<BinaryColor>>>(
        &mut self,
        pixels: I,
    ) -> Result<(), Self::Error> {
        for Pixel(Point { x, y }, colour) in pixels {
            if colour.is_on() {
                pixel(self.pixels, self.at.0 + x as f32, self.at.1 + y as f32, self.colour);
            }
        }
        Ok(())
    }
}

/// One line of text, its upper left corner here.
pub(super) fn write(pixels: &mut Pixmap, at: (f32, f32), words: &str, colour: Colour) {
    let mut ink = Ink { pixels, at: (at.0.round(), at.1.round()), colour };
    let style = MonoTextStyle::new(&FONT_7X13, BinaryColor::On);
    // It cannot fail: the error is none that can be made.
    let _ = Text::with_baseline(words, Point::zero(), style, Baseline::Top).draw(&mut ink);
}
