//! Pictures of motions as text: strips of stick figures, curves of Laban features and frames of animations as SVG, and an HTML
//! page that plays motions in 3D. `lamogen-raster` makes PNG and GIF files of them.

mod animation;
mod camera;
mod camera_path;
mod captions;
mod copyright;
mod curves;
mod figure;
mod font;
mod ground;
mod losses;
mod page;
mod plot;
mod sheet;
mod strip;
mod studio;
mod text;

pub use lamogen_motion::TimedCaption;

pub use animation::{Animation, AnimationError};
pub use copyright::copyright_in_svg;
pub use curves::{LabanCurve, PlotError, curves};
pub use figure::COLOURS as FIGURE_COLOURS;
pub use font::EMBEDDED_FONT;
pub use losses::{LossCurve, losses};
pub use page::{Page, PageFigure, page};
pub use plot::{PlotAxis, PlotLine, plot};
pub use sheet::sheet;
pub use strip::{LabelledMotion, strip};
pub use studio::{Studio, studio};

use std::io::Write;
use std::path::Path;

use text::printable;

/// Writes a picture to a file, whole or not at all: the text of an SVG or HTML document, or the bytes of a PNG or GIF file.
///
/// # Errors
///
/// If the file cannot be written. The message names the file.
pub fn save(path: impl AsRef<Path>, picture: &(impl AsRef<[u8]> + ?Sized)) -> std::io::Result<()> {
    let path = path.as_ref();
    lamogen_motion::write_atomically(path, |file| file.write_all(picture.as_ref()))
        .map_err(|error| std::io::Error::new(error.kind(), format!("{}: {error}", path.display())))
}

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_saved_as_they_are_and_errors_name_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let [text, bytes] = ["a.svg", "a.png"].map(|name| folder.path().join(name));
        save(&text, "<svg/>").unwrap();
        save(&bytes, &vec![0, 255]).unwrap();
        assert_eq!(std::fs::read(text).unwrap(), b"<svg/>");
        assert_eq!(std::fs::read(bytes).unwrap(), [0, 255]);
        let nowhere = folder.path().join("no folder/a.svg");
        let message = save(nowhere, "<svg/>").unwrap_err().to_string();
        assert!(message.contains("a.svg"), "{message}");
    }
}
