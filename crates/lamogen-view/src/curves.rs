//! Curves of Laban features over time.

use lamogen_laban::{Component, LabanSeries};
use lamogen_motion::{FRAMES_PER_SECOND, TimedCaption};
use plotters::prelude::*;

use crate::printable;
use crate::text::shorten;

/// A Laban series that is drawn as one curve in each of the four panels.
#[derive(Clone, Copy, Debug)]
pub struct LabanCurve<'a> {
    /// The label in the legend.
    pub label: &'a str,
    /// The features to draw.
    pub series: &'a LabanSeries,
    /// The colour as red, green and blue.
    pub colour: [u8; 3],
    /// Whether the curve is dashed, as targets are.
    pub dashed: bool,
}

impl<'a> LabanCurve<'a> {
    /// Creates a grey curve for the baseline, the motion without guidance.
    pub fn baseline(series: &'a LabanSeries) -> Self {
        LabanCurve {
            label: "baseline",
            series,
            colour: [107, 114, 128],
            dashed: false,
        }
    }

    /// Creates a dashed curve for the target of guidance.
    pub fn target(series: &'a LabanSeries) -> Self {
        LabanCurve {
            label: "target",
            series,
            colour: [22, 101, 52],
            dashed: true,
        }
    }

    /// Creates a red curve for the guided motion.
    pub fn guided(series: &'a LabanSeries) -> Self {
        LabanCurve {
            label: "guided",
            series,
            colour: [194, 65, 12],
            dashed: false,
        }
    }
}

/// The error of curves that cannot be drawn.
#[derive(Debug, thiserror::Error)]
#[error("the curves cannot be drawn: {0}")]
pub struct PlotError(pub(crate) String);

/// The width and height of the picture in pixels.
const SIZE: (u32, u32) = (1100, 760);
/// The size of the letters of the title, in pixels.
const TITLE: u32 = 22;

/// Draws Weight, Time, Flow and Shape over time in four panels as an SVG document. Numbers that are not finite are left
/// out.
///
/// # Errors
///
/// If the picture cannot be drawn.
pub fn curves(title: &str, curves: &[LabanCurve<'_>]) -> Result<String, PlotError> {
    panels(title, curves, &[], SIZE)
}

/// Draws the panels of [`curves`] in a picture of a size in pixels, with a line where a caption begins after another one. An
/// empty title is left out.
pub(crate) fn panels(
    title: &str,
    curves: &[LabanCurve<'_>],
    captions: &[TimedCaption],
    size: (u32, u32),
) -> Result<String, PlotError> {
    let mut svg = String::new();
    draw_panels(&mut svg, title, curves, captions, size)
        .map_err(|error| PlotError(error.to_string()))?;
    Ok(svg)
}

/// Draws the panels into `svg`.
fn draw_panels(
    svg: &mut String,
    title: &str,
    curves: &[LabanCurve<'_>],
    captions: &[TimedCaption],
    size: (u32, u32),
) -> Result<(), Box<dyn std::error::Error>> {
    let mut area = SVGBackend::with_string(svg, size).into_drawing_area();
    area.fill(&WHITE)?;
    if !title.is_empty() {
        let title = shorten(&printable(title), TITLE as f32, size.0 as f32);
        area = area.titled(&title, ("sans-serif", TITLE))?;
    }
    let panels = area.split_evenly((2, 2));
    for (component, panel) in Component::ALL.into_iter().zip(&panels) {
        let values = || curves.iter().flat_map(|c| c.series.component(component));
        let largest = values().filter(|x| x.is_finite()).fold(0.0, f32::max);
        let frames = curves.iter().map(|c| c.series.frames().len()).max();
        let seconds = frames.unwrap_or(1).saturating_sub(1).max(1) as f32 / FRAMES_PER_SECOND;
        // Reserve space for the legend above the curves. Both heights are estimates in pixels.
        let legend_height = 18.0 * curves.len() as f32 + 20.0;
        let plot_height = panel.dim_in_pixel().1 as f32 - 85.0;
        let top = largest.max(1e-6) / (1.0 - legend_height / plot_height).max(0.5);
        let mut chart = ChartBuilder::on(panel)
            .caption(
                format!("{component} ({})", component.unit()),
                ("sans-serif", 17),
            )
            .margin(10)
            .x_label_area_size(34)
            .y_label_area_size(58)
            .build_cartesian_2d(0.0..seconds, 0.0..top)?;
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(RGBColor(229, 231, 235))
            .x_desc("seconds")
            .label_style(("sans-serif", 12))
            .y_label_formatter(&|value| tick_label(*value, top))
            .draw()?;
        let starts = { captions.iter().skip(1) }
            .map(|caption| caption.frames.start as f32 / FRAMES_PER_SECOND);
        let borders = starts
            .filter(|start| *start <= seconds)
            .map(|x| PathElement::new([(x, 0.0), (x, top)], RGBColor(156, 163, 175)));
        chart.draw_series(borders)?;
        for curve in curves {
            let [red, green, blue] = curve.colour;
            let style = RGBColor(red, green, blue).stroke_width(2);
            let points = curve
                .series
                .component(component)
                .enumerate()
                .map(|(frame, value)| (frame as f32 / FRAMES_PER_SECOND, value))
                .filter(|(_, value)| value.is_finite());
            let drawn = match curve.dashed {
                true => chart.draw_series(DashedLineSeries::new(points, 6, 4, style))?,
                false => chart.draw_series(LineSeries::new(points, style))?,
            };
            // In the legend, dashed lines have a gap too.
            let gap = if curve.dashed { 4 } else { 0 };
            drawn.label(printable(curve.label)).legend(move |(x, y)| {
                EmptyElement::at((x, y))
                    + PathElement::new([(0, 0), (9 - gap / 2, 0)], style)
                    + PathElement::new([(9 + gap / 2, 0), (18, 0)], style)
            });
        }
        chart
            .configure_series_labels()
            .background_style(WHITE.mix(0.8))
            .border_style(RGBColor(209, 213, 219))
            .position(SeriesLabelPosition::UpperRight)
            .label_font(("sans-serif", 12))
            .draw()?;
    }
    area.present()?;
    Ok(())
}

/// Formats a number of an axis that ends at `top`, with enough decimals to distinguish the ticks.
fn tick_label(value: f32, top: f32) -> String {
    let size = top.log10().floor();
    match (value == 0.0, size < -4.0) {
        (true, _) => "0".into(),
        (_, true) => format!("{value:.1e}"),
        _ => {
            let text = format!("{value:.*}", (1.0 - size).max(0.0) as usize);
            match text.contains('.') {
                true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
                false => text,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Device;
    use lamogen_laban::LabanOptions;
    use lamogen_motion::{JOINTS, Motion};

    #[test]
    fn four_panels_are_drawn_with_a_legend() {
        let frames = (0..20)
            .map(|t| std::array::from_fn(|j| [j as f32 * 0.1, (t * j) as f32 * 0.01, 0.3]))
            .collect::<Vec<[[f32; 3]; JOINTS]>>();
        let motion = Motion::from_joints(frames).unwrap();
        let series = LabanSeries::of(&motion, &LabanOptions::default(), &Device::flex());
        let all = [
            LabanCurve::baseline(&series),
            LabanCurve::target(&series),
            LabanCurve::guided(&series),
        ];
        let svg = curves("a person <jumps>", &all).unwrap();
        for component in Component::ALL {
            assert!(svg.contains(&format!("{component} (")), "{component}");
        }
        assert!(svg.contains("baseline") && svg.contains("a person &lt;jumps&gt;"));
    }

    #[test]
    fn a_long_title_is_shortened() {
        let svg = curves(&"jump ".repeat(60), &[]).unwrap();
        assert!(svg.contains("jump jump…"), "{svg}");
    }

    #[test]
    fn small_numbers_are_distinguished_on_the_axis() {
        assert_eq!(tick_label(0.01, 0.07), "0.01");
        assert_eq!(tick_label(0.35, 0.4), "0.35");
        assert_eq!(tick_label(20.0, 60.0), "20");
        assert_eq!(tick_label(2e-6, 7e-6), "2.0e-6");
        assert_eq!(tick_label(0.0, 7e-6), "0");
        assert_eq!(tick_label(0.0004, 0.0007), "0.0004");
    }

    #[test]
    fn nothing_to_draw_is_no_error() {
        assert!(curves("empty", &[]).is_ok());
    }
}
