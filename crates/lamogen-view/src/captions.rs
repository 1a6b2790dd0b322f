//! Captions in pictures: what is said beside a motion, and when.

use lamogen_motion::TimedCaption;
use svg::node::element::{Group, Line};

use crate::text::{LINE_HEIGHT, text_block, wrap};

/// The most lines of a caption.
pub(crate) const CAPTION_LINES: usize = 2;
/// The gap between the bars of two captions, and between a bar and the text below it, in pixels.
const GAP: f32 = 3.0;
/// The least width of a caption with text, relative to the size of the letters. Narrower ones have a bar only.
const NARROWEST: f32 = 3.0;

/// Returns the height of captions with letters of a size, in pixels; 0 if there are none.
pub(crate) fn captions_height(captions: &[TimedCaption], size: f32) -> f32 {
    match captions {
        [] => 0.0,
        _ => CAPTION_LINES as f32 * size * LINE_HEIGHT + 2.0 * GAP,
    }
}

/// Draws the captions of a motion of `frames` frames side by side: a bar for each, as long as its frames take, and its text
/// below. `x` returns the place of a frame; the bars are at the height `y`.
pub(crate) fn draw_captions(
    (captions, frames): (&[TimedCaption], usize),
    x: impl Fn(f32) -> f32,
    y: f32,
    size: f32,
) -> Group {
    let shown = { captions.iter() }.filter(|caption| caption.frames.start < frames);
    shown.fold(Group::new(), |group, caption| {
        let end = caption.frames.end.min(frames);
        let [left, right] = [caption.frames.start, end].map(|at| x(at as f32));
        let width = right - left - GAP;
        let bar = Line::new()
            .set("x1", left)
            .set("x2", left + width.max(1.0))
            .set("y1", y)
            .set("y2", y)
            .set("stroke", "#9ca3af")
            .set("stroke-width", 2);
        let lines = match width < NARROWEST * size {
            true => Vec::new(),
            false => wrap(&caption.text, size, width, CAPTION_LINES),
        };
        let baseline = y + GAP + size;
        group
            .add(bar)
            .add(text_block(&lines, [left, baseline], size, "#374151"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_are_as_long_as_captions_and_narrow_ones_have_no_text() {
        let captions = [
            TimedCaption::new("a person <walks>", 0..60),
            TimedCaption::new("jumps", 60..62),
        ];
        let draw = |frames| {
            draw_captions((&captions, frames), |frame| 5.0 * frame, 10.0, 14.0).to_string()
        };
        let svg = draw(62);
        assert_eq!(svg.matches("<line").count(), 2);
        assert!(
            svg.contains("x2=\"297\"") && svg.contains("x1=\"300\""),
            "{svg}"
        );
        assert!(
            svg.contains("a person &lt;walks&gt;") && !svg.contains("jumps"),
            "{svg}"
        );
        // What is past the end of the motion is left out.
        let svg = draw(50);
        assert_eq!(svg.matches("<line").count(), 1);
        assert!(svg.contains("x2=\"247\""), "{svg}");
    }

    #[test]
    fn only_captions_take_room() {
        let captions = [TimedCaption::new("walks", 0..3)];
        assert_eq!(captions_height(&[], 14.0), 0.0);
        assert!(captions_height(&captions, 14.0) > 28.0);
    }
}
