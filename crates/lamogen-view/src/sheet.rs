//! Everything about a motion in one picture.

use svg::node::{Blob, element::Group};

use crate::curves::{Curve, CurveError, panels};
use crate::strip::{Drawing, Row, draw, page};
use crate::text::{LINE, block, wrapped};

/// Pixels around the parts.
const MARGIN: f32 = 24.0;
/// Letters of the title, in pixels, and most lines of it.
const TITLE: f32 = 24.0;
const TITLE_LINES: usize = 2;
/// Least width of what lies between the margins: four panels of curves need so much.
const LEAST_WIDTH: f32 = 900.0;
/// Height of the panels, in pixels.
const PANELS: u32 = 640;

/// Draws a title, [`strip`](crate::strip()) and, below, [`curves`](crate::curves()) as one SVG
/// document. Without curves there are no panels, and without a title there is none.
///
/// # Errors
///
/// If the curves cannot be drawn.
pub fn sheet(
    title: &str,
    rows: &[Row<'_>],
    poses: usize,
    curves: &[Curve<'_>],
) -> Result<String, CurveError> {
    let strip = draw(rows, poses, LEAST_WIDTH);
    let width = strip.width;
    let title = wrapped(title, TITLE, width, TITLE_LINES);
    let mut height = MARGIN;
    let mut parts = Group::new();
    if !title.is_empty() {
        parts = parts.add(block(&title, [MARGIN, height + TITLE], TITLE, "#111827"));
        height += title.len() as f32 * TITLE * LINE + 0.5 * TITLE;
    }
    let Drawing { content, .. } = strip;
    // Labels stand a little to the right of the strip's edge; they should be in line with the
    // title.
    let left = MARGIN - crate::strip::LEFT;
    parts = parts.add(content.set("transform", format!("translate({left} {height})")));
    height += strip.height;
    if !curves.is_empty() {
        let svg = panels("", curves, (width as u32, PANELS))?;
        let place = format!("<svg x=\"{MARGIN}\" y=\"{height}\" ");
        parts = parts.add(Blob::new(svg.replacen("<svg ", &place, 1)));
        height += PANELS as f32;
    }
    let page = page(width + 2.0 * MARGIN, height + MARGIN);
    Ok(page.add(parts).to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Device;
    use lamogen_laban::{Component, LabanOptions, LabanSeries};
    use lamogen_motion::{JOINTS, Motion};

    use crate::fonts::Missing;
    use crate::raster::render;

    fn motion() -> Motion {
        let poses = (0..20).map(|t| [[0.1, 0.9 + 0.01 * t as f32, 0.2]; JOINTS]);
        Motion::from_joints(poses.collect()).unwrap()
    }

    #[test]
    fn title_figures_and_panels_are_all_there() {
        let motion = motion();
        let series = LabanSeries::of(&motion, &LabanOptions::default(), &Device::flex());
        let rows = [Row {
            label: "text alone",
            motion: &motion,
        }];
        let lines = [Curve::baseline(&series)];
        let svg = sheet("a person <jumps>", &rows, 6, &lines).unwrap();
        assert!(svg.contains("a person &lt;jumps&gt;") && svg.contains("text alone"));
        for component in Component::ALL {
            assert!(svg.contains(&format!("{component} (")), "{component}");
        }
        // Every part is drawn, down to the lowest: the name of the time axis.
        let pixels = render(&svg, 1.0, Missing::Boxes).unwrap();
        let (width, height) = (pixels.width(), pixels.height());
        let drawn = |from: u32, to: u32| {
            let rows = pixels.pixels().chunks(width as usize);
            let rows = rows.skip(from as usize).take((to - from) as usize);
            rows.flatten().any(|p| p.red() < 200)
        };
        assert!(drawn(0, 60) && drawn(60, height - 640) && drawn(height - 60, height));
        assert!(!drawn(height - 20, height), "the lower margin is free");
    }

    #[test]
    fn without_curves_or_title_less_is_drawn() {
        let motion = motion();
        let rows = [Row {
            label: "",
            motion: &motion,
        }];
        let height = |title: &str| {
            let svg = sheet(title, &rows, 3, &[]).unwrap();
            render(&svg, 1.0, Missing::Boxes).unwrap().height()
        };
        assert!(height("") < height("jump") && height("jump") < height(&"jump ".repeat(50)));
        assert!(height("jump") < 640);
    }
}
