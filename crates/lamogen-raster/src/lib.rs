//! Pictures of motions in pixels: PNG files of the SVG documents that `lamogen-view` draws, and animated GIFs.

mod animation;
mod delta;
mod fonts;
mod palette;
mod render;

pub use animation::{GifError, GifOptions, gif};
pub use render::{RasterError, png};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
