//! A sheet: a title, a strip and curves in one picture.

use svg::node::{Blob, element::Group};

use crate::curves::{LabanCurve, PlotError, panels};
use crate::strip::{LabelledMotion, StripDrawing, blank_page, draw_strip, with_copyright};
use crate::text::{LINE_HEIGHT, text_block, wrap};

/// The margin around the parts in pixels.
const MARGIN: f32 = 24.0;
/// The size of the letters of the title, in pixels.
const TITLE: f32 = 24.0;
/// The most lines of the title.
const TITLE_LINES: usize = 2;
/// The least width between the margins in pixels, which the four panels of curves need.
const MIN_WIDTH: f32 = 900.0;
/// The height of the panels of curves in pixels.
const PANELS_HEIGHT: u32 = 640;

/// Draws a title, a [`strip`](crate::strip()) and, below it, [`curves`](crate::curves()) as one SVG document. An empty title
/// is left out, and so are the panels if there are no curves. The captions of the last motion are marked in the panels.
///
/// # Errors
///
/// If the curves cannot be drawn.
pub fn sheet(
    title: &str,
    rows: &[LabelledMotion<'_>],
    poses: usize,
    curves: &[LabanCurve<'_>],
) -> Result<String, PlotError> {
    let strip = draw_strip(rows, poses, MIN_WIDTH);
    let width = strip.width;
    let title = wrap(title, TITLE, width, TITLE_LINES);
    let mut height = MARGIN;
    let mut parts = Group::new();
    if !title.is_empty() {
        parts = parts.add(text_block(
            &title,
            [MARGIN, height + TITLE],
            TITLE,
            "#111827",
        ));
        height += title.len() as f32 * TITLE * LINE_HEIGHT + 0.5 * TITLE;
    }
    let StripDrawing { content, .. } = strip;
    // Labels start a little to the right of the strip's edge. The strip is moved so that they are aligned with the title.
    let left = MARGIN - crate::strip::LABEL_LEFT;
    parts = parts.add(content.set("transform", format!("translate({left} {height})")));
    height += strip.height;
    if !curves.is_empty() {
        let captions = rows.last().map_or(&[][..], |row| row.captions);
        let svg = panels("", curves, captions, (width as u32, PANELS_HEIGHT))?;
        let place = format!("<svg x=\"{MARGIN}\" y=\"{height}\" ");
        parts = parts.add(Blob::new(svg.replacen("<svg ", &place, 1)));
        height += PANELS_HEIGHT as f32;
    }
    let page = blank_page(width + 2.0 * MARGIN, height + MARGIN);
    Ok(with_copyright(page.add(parts), rows).to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Device;
    use lamogen_laban::{Component, LabanOptions, LabanSeries};
    use lamogen_motion::{JOINTS, Motion};

    fn motion() -> Motion {
        let poses = (0..20).map(|t| [[0.1, 0.9 + 0.01 * t as f32, 0.2]; JOINTS]);
        Motion::from_joints(poses.collect()).unwrap()
    }

    #[test]
    fn title_labels_and_panels_are_all_there() {
        let motion = motion();
        let series = LabanSeries::of(&motion, &LabanOptions::default(), &Device::flex());
        let rows = [LabelledMotion::new("text alone", &motion)];
        let lines = [LabanCurve::baseline(&series)];
        let svg = sheet("a person <jumps>", &rows, 6, &lines).unwrap();
        assert!(svg.contains("a person &lt;jumps&gt;") && svg.contains("text alone"));
        for component in Component::ALL {
            assert!(svg.contains(&format!("{component} (")), "{component}");
        }
    }

    #[test]
    fn where_a_caption_follows_another_every_panel_has_a_line() {
        let motion = motion();
        let series = LabanSeries::of(&motion, &LabanOptions::default(), &Device::flex());
        let caption = lamogen_motion::TimedCaption::new;
        let captions = [caption("stands", 0..12), caption("rises", 12..20)];
        let lines = |captions| {
            let row = LabelledMotion {
                captions,
                ..LabelledMotion::new("", &motion)
            };
            let svg = sheet("", &[row], 6, &[LabanCurve::guided(&series)]).unwrap();
            svg.matches("#9CA3AF").count()
        };
        assert_eq!((lines(&[]), lines(&captions)), (0, 4));
    }

    #[test]
    fn without_curves_or_title_less_is_drawn() {
        let motion = motion();
        let rows = [LabelledMotion::new("", &motion)];
        let height = |title: &str| {
            let svg = sheet(title, &rows, 3, &[]).unwrap();
            let (_, rest) = svg.split_once(" height=\"").unwrap();
            rest.split('"').next().unwrap().parse::<u32>().unwrap()
        };
        assert!(height("") < height("jump") && height("jump") < height(&"jump ".repeat(50)));
        assert!(height("jump") < 640);
    }
}
