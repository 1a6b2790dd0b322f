//! Rendering of SVG documents to pixels.

use lamogen_view::copyright_in_svg;
use resvg::tiny_skia::{Color, Pixmap, Transform};
use resvg::usvg::Tree;

use crate::fonts::svg_options;

/// The largest width and height of a picture in pixels.
const LONGEST_SIDE: u32 = 32_767;
/// The most pixels of a picture, which take a quarter of a gigabyte while it is drawn.
const MAX_PIXELS: u64 = 1 << 26;

/// The error of a picture that cannot be rendered to pixels.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RasterError {
    /// The text is not an SVG document.
    #[error("expected an SVG document: {0}")]
    Svg(#[from] resvg::usvg::Error),
    /// The scale is not a finite number above 0.
    #[error("expected a finite scale above 0, found {0}")]
    Scale(f32),
    /// The picture would have too many pixels.
    #[error(
        "expected a picture of at most {LONGEST_SIDE} pixels a side and {MAX_PIXELS} in all, \
         found {width} × {height}"
    )]
    #[allow(missing_docs)]
    Size { width: u64, height: u64 },
    /// The encoder reports an error.
    #[error("the picture could not be encoded as PNG: {0}")]
    Png(String),
}

/// Renders an SVG document on white to the bytes of a PNG file, with `scale` pixels for each unit of the document.
///
/// Letters are drawn in the font that `lamogen-view` lays pictures out with, so that a picture is the same on every machine. Only
/// characters that this font lacks (it has the scripts of Europe) are drawn in fonts of the system.
///
/// # Errors
///
/// If the document is not SVG, the scale is not a finite number above 0, or the picture is larger than 32,767 pixels per
/// side or 67 million pixels in all.
pub fn png(svg: &str, scale: f32) -> Result<Vec<u8>, RasterError> {
    let pixels = render(svg, scale)?;
    let copyright = copyright_in_svg(svg);
    encode(&pixels, copyright.as_deref()).map_err(|error| RasterError::Png(error.to_string()))
}

/// Encodes a picture without transparency.
fn encode(pixels: &Pixmap, copyright: Option<&str>) -> Result<Vec<u8>, png::EncodingError> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, pixels.width(), pixels.height());
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    if let Some(copyright) = copyright {
        encoder.add_itxt_chunk("Copyright".into(), copyright.into())?;
    }
    let colours: Vec<u8> = { pixels.pixels().iter() }
        .flat_map(|pixel| [pixel.red(), pixel.green(), pixel.blue()])
        .collect();
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&colours)?;
    writer.finish()?;
    Ok(bytes)
}

/// Renders an SVG document on white.
pub(crate) fn render(svg: &str, scale: f32) -> Result<Pixmap, RasterError> {
    if !(scale.is_finite() && scale > 0.0) {
        return Err(RasterError::Scale(scale));
    }
    let tree = Tree::from_str(svg, &svg_options())?;
    let mut pixels = blank_picture(
        f64::from(tree.size().width()) * f64::from(scale),
        f64::from(tree.size().height()) * f64::from(scale),
    )?;
    let transform = Transform::from_scale(scale, scale);
    resvg::render(&tree, transform, &mut pixels.as_mut());
    Ok(pixels)
}

/// Draws an SVG document on top of a picture, with one pixel for each unit of the document.
pub(crate) fn render_onto(pixels: &mut Pixmap, svg: &str) -> Result<(), RasterError> {
    let tree = Tree::from_str(svg, &svg_options())?;
    resvg::render(&tree, Transform::identity(), &mut pixels.as_mut());
    Ok(())
}

/// Creates a white picture, or returns an error if it is too large.
fn blank_picture(width: f64, height: f64) -> Result<Pixmap, RasterError> {
    // Sizes beyond the range of integers saturate and are then too large.
    let [width, height] = [width, height].map(|side| side.ceil().max(1.0) as u64);
    let longest = u64::from(LONGEST_SIDE);
    let too_large = RasterError::Size { width, height };
    if width > longest || height > longest || width * height > MAX_PIXELS {
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
        let pixels = render(svg, scale).unwrap();
        pixels.pixels().iter().filter(|p| p.green() < 128).count()
    }

    #[test]
    fn letters_are_drawn_and_missing_ones_are_boxes() {
        let text = |text: &str| {
            picture(
                200.0,
                &format!(
                    "<text x='5' y='30' font-size='24' font-family='sans-serif'>{text}</text>"
                ),
            )
        };
        assert_eq!(dark_pixels(&text(""), 1.0), 0);
        // Characters that every font lacks are drawn as boxes and not left out.
        let box_like = dark_pixels(&text("\u{e8ff}"), 1.0);
        assert!(box_like > 20, "{box_like}");
        for letters in ["jump", "Größe ²³×", "прыжок", "άλμα", "skočí łódź", "→ …"]
        {
            let dark = dark_pixels(&text(letters), 1.0);
            assert!(dark > 40, "{letters}: {dark}");
            // The letters are not all drawn as boxes.
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
        let pixels = render(&picture(100.0, half), 2.5).unwrap();
        assert_eq!((pixels.width(), pixels.height()), (250, 100));
        assert_eq!(dark_pixels(&picture(100.0, half), 2.5), 125 * 100);
        let file = png(&picture(100.0, half), 2.5).unwrap();
        assert_eq!(&file[..8], b"\x89PNG\r\n\x1a\n");
        assert_eq!(Pixmap::decode_png(&file).unwrap(), pixels);
    }

    #[test]
    fn pictures_of_invalid_sizes_are_errors_that_name_the_size() {
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
