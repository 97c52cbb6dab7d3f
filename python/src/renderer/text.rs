//! Text in an image, in a built-in font of `embedded-graphics`, so that no font file is needed.

use embedded_graphics::mono_font::MonoTextStyle;
use embedded_graphics::mono_font::ascii::FONT_7X13;
use embedded_graphics::pixelcolor::BinaryColor;
use embedded_graphics::prelude::*;
use embedded_graphics::text::{Baseline, Text};
use tiny_skia::Pixmap;

use super::{PixelPosition, Rgba, fill_pixel};

/// Distance between lines, pixels.
pub(super) const LINE_HEIGHT: f32 = 15.0;

/// Draws one line of text; `at` is its upper left corner.
pub(super) fn draw_text(pixels: &mut Pixmap, at: PixelPosition, text: &str, color: Rgba) {
    let mut target = TextTarget { pixels, at: PixelPosition { x: at.x.round(), y: at.y.round() }, color };
    let style = MonoTextStyle::new(&FONT_7X13, BinaryColor::On);
    // The error type is uninhabited.
    let _ = Text::with_baseline(text, Point::zero(), style, Baseline::Top).draw(&mut target);
}

/// Draws the set pixels of a font into an image.
struct TextTarget<'a> {
    pixels: &'a mut Pixmap,
    at: PixelPosition,
    color: Rgba,
}

impl OriginDimensions for TextTarget<'_> {
    fn size(&self) -> Size {
        Size::new(self.pixels.width(), self.pixels.height())
    }
}

impl DrawTarget for TextTarget<'_> {
    type Color = BinaryColor;
    type Error = std::convert::Infallible;

    #[expect(clippy::cast_precision_loss, reason = "pixels")]
    fn draw_iter<I: IntoIterator<Item = Pixel<BinaryColor>>>(
        &mut self,
        pixels: I,
    ) -> Result<(), Self::Error> {
        for Pixel(Point { x, y }, value) in pixels {
            if value.is_on() {
                let position = PixelPosition { x: self.at.x + x as f32, y: self.at.y + y as f32 };
                fill_pixel(self.pixels, position, self.color);
            }
        }
        Ok(())
    }
}
