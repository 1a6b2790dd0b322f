//! Pictures of motion: as SVG strips of stick figures and Laban features over time, and a page that plays motions.

mod curves;
mod page;
mod strip;

pub use curves::{Curve, CurveError, curves};
pub use page::{Figure, Page, page};
pub use strip::{Row, strip};

use std::io::Write;
use std::path::Path;

/// Writes a picture whole or not at all.
///
/// # Errors
///
/// If the file cannot be written; the message names it.
pub fn save(path: impl AsRef<Path>, svg: &str) -> std::io::Result<()> {
    let path = path.as_ref();
    lamogen_motion::write_atomically(path, |file| file.write_all(svg.as_bytes()))
        .map_err(|error| std::io::Error::new(error.kind(), format!("{}: {error}", path.display())))
}

/// Text without the characters that XML 1.0 has no place for.
fn printable(text: &str) -> String {
    let has_a_place = |c: &char| !c.is_control() && !matches!(c, '\u{fffe}' | '\u{ffff}');
    text.chars().filter(has_a_place).collect()
}

#[cfg(test)]
mod tests {
    #[test]
    fn control_characters_are_left_out() {
        assert_eq!(
            super::printable("a \u{1}\u{b}person\njumps ü 😀"),
            "a personjumps ü 😀"
        );
    }
}
