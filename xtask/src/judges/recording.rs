//! An animation of screenshots, for the README.

use std::borrow::Cow;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use gif::{DisposalMethod, Encoder, Frame, Repeat};

use super::Result;

/// How carefully colours are chosen, from 1, the best, to 30.
const SPEED: i32 = 1;
/// The time from one frame to the next, and after the last one, in hundredths of a second.
const DELAY: u16 = 11;
const LAST_DELAY: u16 = 180;

/// Writes the PNG files of a folder, in the order of their names, as an animation.
pub fn write_recording(folder: &Path, path: &Path) -> Result<()> {
    let mut names: Vec<PathBuf> = std::fs::read_dir(folder)?
        .map(|entry| Ok(entry?.path()))
        .collect::<Result<_>>()?;
    names.retain(|name| name.extension().is_some_and(|ending| ending == "png"));
    names.sort();
    let Some(first) = names.first() else {
        return Err(format!("{}: expected PNG files, found none", folder.display()).into());
    };
    let first = Picture::read(first)?;
    let size = (u16::try_from(first.width)?, u16::try_from(first.height)?);
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, size.0, size.1, &[])?;
    encoder.set_repeat(Repeat::Infinite)?;
    let mut before: Option<Picture> = None;
    for (place, name) in names.iter().enumerate() {
        let now = Picture::read(name)?;
        let mut frame = now.difference(before.as_ref())?;
        let is_last = place + 1 == names.len();
        frame.delay = if is_last { LAST_DELAY } else { DELAY };
        frame.dispose = DisposalMethod::Keep;
        encoder.write_frame(&frame)?;
        before = Some(now);
    }
    drop(encoder);
    Ok(std::fs::write(path, bytes)?)
}

/// The pixels of a screenshot.
struct Picture {
    width: usize,
    height: usize,
    pixels: Vec<[u8; 4]>,
}

impl Picture {
    fn read(path: &Path) -> Result<Picture> {
        let mut decoder = png::Decoder::new(BufReader::new(File::open(path)?));
        decoder.set_transformations(png::Transformations::ALPHA | png::Transformations::STRIP_16);
        let mut reader = decoder.read_info()?;
        let size = reader
            .output_buffer_size()
            .ok_or("expected a smaller PNG file")?;
        let mut bytes = vec![0; size];
        let info = reader.next_frame(&mut bytes)?;
        let (pixels, _) = bytes[..info.buffer_size()].as_chunks::<4>();
        Ok(Picture {
            width: info.width as usize,
            height: info.height as usize,
            pixels: pixels.to_vec(),
        })
    }

    /// Returns a frame with what is other than in the picture before.
    fn difference(&self, before: Option<&Picture>) -> Result<Frame<'static>> {
        let before = before.filter(|before| before.pixels.len() == self.pixels.len());
        let is_changed =
            |at: usize| before.is_none_or(|before| before.pixels[at] != self.pixels[at]);
        let changed: Vec<usize> = (0..self.pixels.len())
            .filter(|at| is_changed(*at))
            .collect();
        let columns = || changed.iter().map(|at| at % self.width);
        let rows = || changed.iter().map(|at| at / self.width);
        let (left, right) = (columns().min().unwrap_or(0), columns().max().unwrap_or(0));
        let (top, bottom) = (rows().min().unwrap_or(0), rows().max().unwrap_or(0));
        let mut pixels = Vec::new();
        for row in top..=bottom {
            for column in left..=right {
                let at = row * self.width + column;
                let [red, green, blue, _] = self.pixels[at];
                pixels.extend([red, green, blue, if is_changed(at) { 255 } else { 0 }]);
            }
        }
        let (width, height) = (
            u16::try_from(right - left + 1)?,
            u16::try_from(bottom - top + 1)?,
        );
        let frame = Frame::from_rgba_speed(width, height, &mut pixels, SPEED);
        Ok(Frame {
            left: u16::try_from(left)?,
            top: u16::try_from(top)?,
            buffer: Cow::Owned(frame.buffer.into_owned()),
            ..frame
        })
    }
}
