//! Pictures of motions: strips of stick figures and curves of Laban features as SVG and PNG, animations as GIF, and an
//! HTML page that plays motions in 3D.

mod animation;
mod camera;
mod camera_path;
mod captions;
mod copyright;
mod curves;
mod figure;
mod fonts;
mod ground;
mod losses;
mod page;
mod palette;
mod plot;
mod raster;
mod sheet;
mod strip;
mod studio;
mod text;

pub use lamogen_motion::TimedCaption;

pub use animation::{GifError, GifOptions, gif};
pub use curves::{LabanCurve, PlotError, curves};
pub use losses::{LossCurve, losses};
pub use page::{Page, PageFigure, page};
pub use plot::{PlotAxis, PlotLine, plot};
pub use raster::{RasterError, png};
pub use sheet::sheet;
pub use strip::{LabelledMotion, strip};
pub use studio::{Studio, studio};

use std::io::Write;
use std::path::Path;

use text::printable;

/// Writes a picture to a file, whole or not at all: the text of an SVG or HTML document, or the bytes of a PNG or GIF.
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
