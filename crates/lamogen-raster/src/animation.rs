//! Motions side by side as an animated GIF.

use gif::{Encoder, Extension, Repeat};
use lamogen_view::{Animation, AnimationError, LabelledMotion};

use crate::delta::{delta_frame, palette_indices};
use crate::palette::Palette;
use crate::render::{RasterError, render, render_onto};

/// Options for drawing an animation.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GifOptions {
    /// The width of all motions together in pixels. By default it is 320 pixels for each motion, but at most 4096 in all.
    /// The height follows from the width and from the movements.
    pub width: Option<u32>,
}

/// The error of an animation that cannot be drawn.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GifError {
    /// There is no motion, or the width is out of range.
    #[error(transparent)]
    Animation(#[from] AnimationError),
    /// A frame cannot be drawn.
    #[error("frame {frame}: {error}")]
    #[allow(missing_docs)]
    Frame { frame: usize, error: RasterError },
    /// The encoder reports an error.
    #[error("the animation could not be encoded as GIF: {0}")]
    Encoding(#[from] gif::EncodingError),
}

/// Draws motions side by side as an animated GIF that runs in real time, 20 frames per second, and repeats for ever. A
/// motion that is shorter than the longest one stays in its last pose.
///
/// All motions have the same scale and are viewed from the front left. The camera stands still for movements in place and
/// follows a walk, over a ground with squares of half a metre. Below it stands the caption of the moment, if the motion has
/// captions. After every frame, `progress` is called with the number of frames that are done and the number of all frames.
/// The same motions always give the same bytes.
///
/// # Errors
///
/// If there is no motion, or the width is less than 80 pixels for each motion or more than 4096.
pub fn gif(
    rows: &[LabelledMotion<'_>],
    options: &GifOptions,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Vec<u8>, GifError> {
    let animation = Animation::new(rows, options.width)?;
    let frame_error = |frame| move |error| GifError::Frame { frame, error };
    let backdrop = render(&animation.backdrop(), 1.0).map_err(frame_error(0))?;
    let (width, height) = (backdrop.width() as u16, backdrop.height() as u16);

    let mut palette = Palette::new();
    let mut encoder = Encoder::new(Vec::new(), width, height, palette.bytes())?;
    encoder.set_repeat(Repeat::Infinite)?;
    if let Some(copyright) = animation.copyright() {
        // A comment is stored in blocks of at most 255 bytes.
        let blocks: Vec<&[u8]> = copyright.as_bytes().chunks(255).collect();
        encoder.write_raw_extension(Extension::Comment.into(), &blocks)?;
    }
    let frames = animation.frames();
    let mut before = Vec::new();
    for frame in 0..frames {
        let mut pixels = backdrop.clone();
        render_onto(&mut pixels, &animation.frame(frame)).map_err(frame_error(frame))?;
        let now = palette_indices(&pixels, &mut palette);
        encoder.write_frame(&delta_frame(&before, &now, width))?;
        before = now;
        progress(frame + 1, frames);
    }
    Ok(encoder.into_inner()?)
}

#[cfg(test)]
mod tests;
