//! The font of pictures, and the widths of its letters.

use std::sync::LazyLock;

use ttf_parser::Face;

/// The font in which pictures are laid out and drawn, as a TrueType file: DejaVu Sans with the scripts of Europe. Its origin
/// and its licence are described in the folder `fonts` of this crate.
pub const EMBEDDED_FONT: &[u8] = include_bytes!("../fonts/DejaVuSans-subset.ttf");

/// The embedded font, parsed.
static FACE: LazyLock<Face<'static>> =
    LazyLock::new(|| Face::parse(EMBEDDED_FONT, 0).expect("the embedded font is valid"));

/// Computes how far a letter moves the pen, relative to the size of the letters.
pub(crate) fn advance(letter: char) -> f32 {
    // The embedded font lacks the letters of East Asia, which are as wide as a dash.
    let letter = match letter {
        '\u{1100}'..'\u{1e00}' | '\u{2e80}'.. => '—',
        _ => letter,
    };
    // A letter that is missing has the box of glyph 0.
    let glyph = FACE.glyph_index(letter).unwrap_or_default();
    f32::from(FACE.glyph_hor_advance(glyph).unwrap_or(0)) / f32::from(FACE.units_per_em())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_embedded_font_is_small_and_has_the_letters_of_europe() {
        assert!(EMBEDDED_FONT.len() < 200_000);
        let missing = '\u{10ff}';
        assert!(FACE.glyph_index(missing).is_none() && advance(missing) > 0.3);
        // What tests of pictures draw, which needs no font of the system.
        for letter in "jump Größe ²³× прыжок άλμα skočí łódź → …".chars() {
            assert!(FACE.glyph_index(letter).is_some(), "{letter}");
            assert!((0.2..1.1).contains(&advance(letter)), "{letter}");
        }
        assert!(advance('i') < advance('m'));
        // An accent that is put on the letter before it takes no room.
        assert_eq!(advance('\u{301}'), 0.0);
    }
}
