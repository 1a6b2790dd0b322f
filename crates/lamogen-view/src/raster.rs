//! SVG as pixels.

use resvg::tiny_skia::{Color, Pixmap, Transform};
use resvg::usvg::Tree;

use crate::fonts::{Missing, options};

/// Longest side of a picture in pixels.
const LONGEST_SIDE: u32 = 32_767;
/// Most pixels of a picture: a quarter of a gigabyte while it is drawn.
const MOST_PIXELS: u64 = 1 << 26;

/// A picture that cannot be turned into pixels.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RasterError {
    /// Text that is no SVG document.
    #[error("expected an SVG document: {0}")]
    Svg(#[from] resvg::usvg::Error),
    /// A scale that makes no sense.
    #[error("expected a finite scale above 0, found {0}")]
    Scale(f32),
    /// More pixels than one wants.
    #[error(
        "expected a picture of at most {LONGEST_SIDE} pixels a side and {MOST_PIXELS} in all, \
         found {width} × {height}"
    )]
    #[allow(missing_docs)]
    Size { width: u64, height: u64 },
    /// The encoder's own words.
    #[error("the picture could not be encoded as PNG: {0}")]
    Png(String),
}

/// Turns an SVG document into a PNG file, `scale` pixels for each of its units, on white.
///
/// Letters are those of a font that this crate carries, so a picture is the same on every machine;
/// only characters that it lacks (it has the scripts of Europe) are taken from the machine's fonts.
///
/// # Errors
///
/// If the document is no SVG, the scale is not above 0, or the picture is larger than 32,767 pixels
/// a side or 67 million in all.
pub fn png(svg: &str, scale: f32) -> Result<Vec<u8>, RasterError> {
    render(svg, scale, Missing::FromSystem)?
        .encode_png()
        .map_err(|error| RasterError::Png(error.to_string()))
}

/// The pixels of an SVG document, on white.
pub(crate) fn render(svg: &str, scale: f32, missing: Missing) -> Result<Pixmap, RasterError> {
    if !(scale.is_finite() && scale > 0.0) {
        return Err(RasterError::Scale(scale));
    }
    let tree = Tree::from_str(svg, &options(missing))?;
    let mut pixels = blank(
        f64::from(tree.size().width()) * f64::from(scale),
        f64::from(tree.size().height()) * f64::from(scale),
    )?;
    let transform = Transform::from_scale(scale, scale);
    resvg::render(&tree, transform, &mut pixels.as_mut());
    Ok(pixels)
}

/// Draws an SVG document over what is there, a pixel for each of its units.
pub(crate) fn render_onto(pixels: &mut Pixmap, svg: &str) -> Result<(), RasterError> {
    let tree = Tree::from_str(svg, &options(Missing::FromSystem))?;
    resvg::render(&tree, Transform::identity(), &mut pixels.as_mut());
    Ok(())
}

/// White pixels, if they are not too many.
fn blank(width: f64, height: f64) -> Result<Pixmap, RasterError> {
    // Sizes beyond the integers saturate, and are too large then.
    let [width, height] = [width, height].map(|side| side.ceil().max(1.0) as u64);
    let longest = u64::from(LONGEST_SIDE);
    let too_large = RasterError::Size { width, height };
    if width > longest || height > longest || width * height > MOST_PIXELS {
        return Err(too_large);
    }
    let mut pixels = Pixmap::new(width as u32, height as u32).ok_or(too_large)?;
    pixels.fill(Color::WHITE);
    Ok(pixels)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(width: f32, content: &str) -> String {
        format!(
            "<svg xmlns='http://www.w3.org/2000/svg' width='{width}' height='40'>{content}</svg>"
        )
    }

    fn dark_pixels(svg: &str, scale: f32) -> usize {
        let pixels = render(svg, scale, Missing::Boxes).unwrap();
        pixels.pixels().iter().filter(|p| p.green() < 128).count()
    }

    #[test]
    fn letters_appear_without_any_font_of_the_machine() {
        let text = |text: &str| {
            picture(
                200.0,
                &format!(
                    "<text x='5' y='30' font-size='24' font-family='sans-serif'>{text}</text>"
                ),
            )
        };
        assert_eq!(dark_pixels(&text(""), 1.0), 0);
        // What the font lacks is drawn as a box, not left out.
        let box_like = dark_pixels(&text("人"), 1.0);
        assert!(box_like > 20, "{box_like}");
        for letters in ["jump", "Größe ²³×", "прыжок", "άλμα", "skočí łódź", "→ …"]
        {
            let dark = dark_pixels(&text(letters), 1.0);
            assert!(dark > 40, "{letters}: {dark}");
            // Not as many boxes as letters.
            let boxes = box_like * letters.chars().filter(|c| *c != ' ').count();
            assert_ne!(dark, boxes, "{letters}");
        }
    }

    #[test]
    fn every_family_is_the_same_font() {
        let text = |family: &str| {
            let text = format!("<text y='30' font-size='24' font-family='{family}'>jump</text>");
            png(&picture(100.0, &text), 1.0).unwrap()
        };
        assert_eq!(text("sans-serif"), text("Times New Roman"));
    }

    #[test]
    fn the_scale_multiplies_both_sides() {
        let half = "<rect width='50' height='40'/>";
        let pixels = render(&picture(100.0, half), 2.5, Missing::Boxes).unwrap();
        assert_eq!((pixels.width(), pixels.height()), (250, 100));
        assert_eq!(dark_pixels(&picture(100.0, half), 2.5), 125 * 100);
        let file = png(&picture(100.0, half), 2.5).unwrap();
        assert_eq!(&file[..8], b"\x89PNG\r\n\x1a\n");
        assert_eq!(Pixmap::decode_png(&file).unwrap(), pixels);
    }

    #[test]
    fn absurd_pictures_are_errors_that_name_their_size() {
        for scale in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            assert!(matches!(
                png(&picture(100.0, ""), scale),
                Err(RasterError::Scale(_))
            ));
        }
        let message = |svg: &str, scale| png(svg, scale).unwrap_err().to_string();
        let long = message(&picture(40_000.0, ""), 1.0);
        assert!(long.contains("40000 × 40"), "{long}");
        let many = message(&picture(100.0, ""), 300.0);
        assert!(many.contains("30000 × 12000"), "{many}");
        assert!(message(&picture(1e30, ""), 1e30).contains("at most"));
        assert!(message("<html/>", 1.0).contains("expected an SVG"));
        assert!(message("", 1.0).contains("expected an SVG"));
    }

    #[test]
    fn the_largest_pictures_are_drawn_to_their_far_corner() {
        let corner = picture(30_000.0, "<rect x='29990' y='30' width='10' height='10'/>");
        assert_eq!(dark_pixels(&corner, 1.0), 100);
    }
}
