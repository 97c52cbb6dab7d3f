//! Figures as PNG, rendered from their SVG.

use std::sync::{Arc, LazyLock};

use anyhow::Context;
use resvg::tiny_skia::{Color, Pixmap, Transform};
use resvg::usvg::fontdb::Database;
use resvg::usvg::{Options, Tree};

use super::figure::Figure;

/// Pixels of the picture for a pixel of the figure: a figure as wide as a column of a paper has about 500 pixels per inch.
const SCALE: f32 = 3.0;
/// Font of all text. Characters that it lacks are drawn in a font of the machine.
const FAMILY: &str = "Ubuntu";

/// Fonts of the figures: the one that is part of the program, and those of the machine.
static FONTS: LazyLock<Arc<Database>> = LazyLock::new(|| {
    let mut fonts = Database::new();
    fonts.load_font_data(epaint_default_fonts::UBUNTU_LIGHT.to_vec());
    fonts.load_system_fonts();
    fonts.set_sans_serif_family(FAMILY);
    Arc::new(fonts)
});

/// Renders a figure on a white background.
///
/// # Errors
/// Returns an error if the figure cannot be drawn.
pub(super) fn figure_png(figure: &Figure) -> anyhow::Result<Vec<u8>> {
    let options =
        Options { fontdb: Arc::clone(&FONTS), font_family: FAMILY.to_owned(), ..Options::default() };
    let tree = Tree::from_str(&figure.svg()?, &options)?;
    let size = tree.size().to_int_size().scale_by(SCALE).context("a figure without a size")?;
    let mut picture = Pixmap::new(size.width(), size.height()).context("a figure without a size")?;
    picture.fill(Color::WHITE);
    resvg::render(&tree, Transform::from_scale(SCALE, SCALE), &mut picture.as_mut());
    Ok(picture.encode_png()?)
}
