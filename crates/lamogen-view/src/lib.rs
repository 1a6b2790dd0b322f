//! Pictures of motion: strips of stick figures and Laban features over time as SVG and PNG, animations as
//! GIF, and a page that plays motions.

mod animation;
mod camera;
mod curves;
mod figure;
mod follow;
mod fonts;
mod ground;
mod page;
mod palette;
mod raster;
mod sheet;
mod strip;
mod text;

pub use animation::{GifError, GifOptions, gif};
pub use curves::{Curve, CurveError, curves};
pub use page::{Figure, Page, page};
pub use raster::{RasterError, png};
pub use sheet::sheet;
pub use strip::{Row, strip};

use std::io::Write;
use std::path::Path;

/// Writes a picture whole or not at all: the text of an SVG or the bytes of a PNG or GIF.
///
/// # Errors
///
/// If the file cannot be written; the message names it.
pub fn save(path: impl AsRef<Path>, picture: impl AsRef<[u8]>) -> std::io::Result<()> {
    let path = path.as_ref();
    lamogen_motion::write_atomically(path, |file| file.write_all(picture.as_ref()))
        .map_err(|error| std::io::Error::new(error.kind(), format!("{}: {error}", path.display())))
}
