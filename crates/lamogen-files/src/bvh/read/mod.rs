//! Reading of BVH files of any program.
//!
//! The format has no standard, so the reader accepts the variants that occur in practice: keywords in upper or lower
//! case, braces on any line, names with spaces and colons, joints with any channels in any order, `Frame Time` with or
//! without spaces, and files with fewer rows than they announce.

mod frames;
mod hierarchy;

use std::path::Path;

use super::cursor::{BvhError, Cursor};
use crate::clip::Clip;
use frames::{finish_nodes, read_rows};
pub(super) use hierarchy::read_hierarchy;

/// The content of a BVH file.
#[derive(Debug)]
pub(crate) struct ParsedBvh {
    pub(crate) clip: Clip,
    /// The number of frames that the file announces.
    pub(crate) announced_frames: usize,
}

/// The longest allowed time between two frames, in seconds.
const MAX_FRAME_TIME: f64 = 10.0;

/// Parses the text of a BVH file. `path` is used only in error messages.
pub(crate) fn parse(text: &str, path: &Path) -> Result<ParsedBvh, BvhError> {
    let text = text.trim_start_matches('\u{feff}');
    let mut cursor = Cursor::new(text, path);
    cursor.expect_keyword(&["HIERARCHY"], "HIERARCHY")?;
    cursor.expect_keyword(&["ROOT"], "ROOT and the name of the first joint")?;
    let (mut nodes, channels) = read_hierarchy(&mut cursor)?;
    cursor.expect_keyword(&["MOTION"], "MOTION after the hierarchy of one ROOT")?;
    cursor.expect_keyword(&["Frames"], "Frames: and their number")?;
    cursor.skip_colon();
    let announced_frames =
        cursor.parse("the number of frames", |token| token.parse::<usize>().ok())?;
    cursor.expect_keyword(&["Frame", "FrameTime"], "Frame Time: and its seconds")?;
    let next = cursor.peek().split(':').next();
    if next.is_some_and(|word| word.eq_ignore_ascii_case("Time")) {
        cursor.expect_keyword(&["Time"], "Frame Time: and its seconds")?;
    }
    cursor.skip_colon();
    let time_line = cursor.clone();
    let seconds_per_frame = cursor.number("the seconds of a frame")?;

    let width = channels.iter().map(Vec::len).sum::<usize>();
    if width == 0 {
        return Err(cursor.error("joints with CHANNELS", "none in the whole hierarchy"));
    }
    let frames = read_rows(&mut cursor, width, |row| {
        let mut values = row.iter();
        for (node, channels) in nodes.iter_mut().zip(&channels) {
            node.push_frame(channels, &mut values);
        }
    })?;
    if frames == 0 {
        return Err(cursor.error(&format!("a row of {width} numbers"), "the end of the file"));
    }
    let is_valid_time = (0.0..=MAX_FRAME_TIME).contains(&seconds_per_frame)
        && (seconds_per_frame > 0.0 || frames == 1);
    if !is_valid_time {
        return Err(time_line.error(
            &format!("more than 0 and at most {MAX_FRAME_TIME} seconds a frame"),
            &seconds_per_frame.to_string(),
        ));
    }
    Ok(ParsedBvh {
        clip: Clip {
            nodes: finish_nodes(nodes),
            frames,
            seconds_per_frame,
        },
        announced_frames,
    })
}

#[cfg(test)]
mod tests;
