//! The frames of a GIF, which hold only the pixels that change.

use std::borrow::Cow;

use gif::{DisposalMethod, Frame};
use lamogen_motion::FRAMES_PER_SECOND;
use resvg::tiny_skia::Pixmap;

use crate::palette::Palette;

/// The time in hundredths of a second for which a frame is shown.
const DELAY: u16 = (100.0 / FRAMES_PER_SECOND) as u16;

/// Returns the palette index of every pixel.
pub(crate) fn palette_indices(pixels: &Pixmap, palette: &mut Palette) -> Vec<u8> {
    let colours = pixels.pixels().iter();
    colours
        .map(|pixel| palette.index([pixel.red(), pixel.green(), pixel.blue()]))
        .collect()
}

/// Returns the smallest rectangle that contains all changed pixels as a frame. Unchanged pixels in it are transparent.
/// For the first frame `before` is empty, so that all pixels count as changed.
pub(crate) fn delta_frame(before: &[u8], now: &[u8], width: u16) -> Frame<'static> {
    let columns = usize::from(width);
    let changed = |at: &usize| before.get(*at) != Some(&now[*at]);
    let (mut left, mut right, mut top, mut bottom) = (columns, 0, usize::MAX, 0);
    for at in (0..now.len()).filter(changed) {
        let (row, column) = (at / columns, at % columns);
        (left, right) = (left.min(column), right.max(column));
        (top, bottom) = (top.min(row), row);
    }
    if top == usize::MAX {
        // A frame must have at least one pixel, changed or not.
        (left, right, top, bottom) = (0, 0, 0, 0);
    }
    let rectangle = (top..=bottom).flat_map(|row| (left..=right).map(move |x| row * columns + x));
    let buffer: Vec<u8> = rectangle
        .map(|at| match changed(&at) {
            true => now[at],
            false => Palette::TRANSPARENT,
        })
        .collect();
    Frame {
        delay: DELAY,
        dispose: DisposalMethod::Keep,
        transparent: Some(Palette::TRANSPARENT),
        left: left as u16,
        top: top as u16,
        width: (right - left + 1) as u16,
        height: (bottom - top + 1) as u16,
        buffer: Cow::Owned(buffer),
        ..Frame::default()
    }
}
