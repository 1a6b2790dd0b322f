//! Plots of lines over two axes.

use std::ops::Range;

use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint};
use plotters::prelude::*;

use crate::curves::PlotError;
use crate::printable;
use crate::text::shorten;

/// An axis of a plot.
#[derive(Clone, Copy, Debug)]
pub struct PlotAxis<'a> {
    /// The label beside the axis.
    pub label: &'a str,
    /// Whether the scale is logarithmic. Numbers that are not above 0 are then left out.
    pub logarithmic: bool,
}

impl<'a> PlotAxis<'a> {
    /// Creates an axis with a linear scale.
    pub fn linear(label: &'a str) -> Self {
        PlotAxis {
            label,
            logarithmic: false,
        }
    }

    /// Creates an axis with a logarithmic scale.
    pub fn logarithmic(label: &'a str) -> Self {
        PlotAxis {
            label,
            logarithmic: true,
        }
    }
}

/// A line of a plot.
#[derive(Clone, Debug)]
pub struct PlotLine<'a> {
    /// The label in the legend. A line with an empty label is not in the legend.
    pub label: &'a str,
    /// The points `[x, y]` from left to right. Points with a number that is not finite are left out.
    pub points: Vec<[f64; 2]>,
    /// The colour as red, green and blue.
    pub colour: [u8; 3],
    /// Whether the points are marked with dots, which is useful for few points.
    pub marked: bool,
}

/// The width and height of the picture in pixels.
const SIZE: (u32, u32) = (900, 480);
/// The size of the letters of the title, in pixels.
const TITLE: u32 = 20;

/// Draws lines as an SVG document. The first axis is the horizontal one.
///
/// # Errors
///
/// If the picture cannot be drawn.
pub fn plot(
    title: &str,
    axes: [PlotAxis<'_>; 2],
    lines: &[PlotLine<'_>],
) -> Result<String, PlotError> {
    let mut svg = String::new();
    draw_plot(&mut svg, title, axes, lines).map_err(|error| PlotError(error.to_string()))?;
    Ok(svg)
}

/// Draws the plot into `svg`.
fn draw_plot(
    svg: &mut String,
    title: &str,
    axes: [PlotAxis<'_>; 2],
    lines: &[PlotLine<'_>],
) -> Result<(), Box<dyn std::error::Error>> {
    let area = SVGBackend::with_string(svg, SIZE).into_drawing_area();
    area.fill(&WHITE)?;
    let title = shorten(&printable(title), TITLE as f32, SIZE.0 as f32);
    // The points of each line in coordinates of the axes.
    let plotted: Vec<Vec<(f64, f64)>> = lines
        .iter()
        .map(|line| {
            let points = line.points.iter();
            let coordinates = |&[x, y]: &[f64; 2]| (axes[0].coordinate(x), axes[1].coordinate(y));
            let points = points.map(coordinates);
            let points = points.filter(|(x, y)| x.is_finite() && y.is_finite());
            points.collect()
        })
        .collect();
    let all = || plotted.iter().flatten();
    // Without a margin, marks at the ends would be cut in half.
    let margin = match lines.iter().any(|line| line.marked) {
        true => 0.03,
        false => 0.0,
    };
    let x = axes[0].scale(all().map(|point| point.0), margin);
    let y = axes[1].scale(all().map(|point| point.1), 0.04);
    let corner = free_corner(lines, &plotted, [&x.range, &y.range]);
    let mut chart = ChartBuilder::on(&area)
        .caption(title, ("sans-serif", TITLE))
        .margin(12)
        // Half of the last number of the axis is to the right of the axis.
        .margin_right(30)
        .x_label_area_size(38)
        .y_label_area_size(58)
        .build_cartesian_2d(x, y)?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(RGBColor(229, 231, 235))
        .x_desc(printable(axes[0].label))
        .y_desc(printable(axes[1].label))
        .label_style(("sans-serif", 12))
        .x_label_formatter(&|tick| axes[0].tick_label(*tick))
        .y_label_formatter(&|tick| axes[1].tick_label(*tick))
        .draw()?;
    for (line, points) in lines.iter().zip(plotted) {
        let [red, green, blue] = line.colour;
        let colour = RGBColor(red, green, blue);
        let style = colour.stroke_width(2);
        let drawn = chart.draw_series(LineSeries::new(points.iter().copied(), style))?;
        if !line.label.is_empty() {
            drawn
                .label(printable(line.label))
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], style));
        }
        if line.marked {
            let marks = points
                .iter()
                .map(|&point| Circle::new(point, 3, colour.filled()));
            chart.draw_series(marks)?;
        }
    }
    if lines.iter().any(|line| !line.label.is_empty()) {
        chart
            .configure_series_labels()
            .background_style(WHITE.mix(0.8))
            .border_style(RGBColor(209, 213, 219))
            .position(corner)
            .label_font(("sans-serif", 13))
            .draw()?;
    }
    drop(chart);
    area.present()?;
    Ok(())
}

/// Returns the corner in which the legend covers the least of the lines; the upper right one if it is as good as others.
fn free_corner(
    lines: &[PlotLine<'_>],
    plotted: &[Vec<(f64, f64)>],
    ranges: [&Range<f64>; 2],
) -> SeriesLabelPosition {
    /// The number of samples on a line between two of its points.
    const SAMPLES: usize = 16;
    let labels = lines.iter().map(|line| line.label.chars().count());
    let longest = labels.clone().max().unwrap_or(0) as f64;
    let entries = labels.filter(|length| *length > 0).count() as f64;
    // Estimates relative to the size of the plot, for the stroke before the text, one letter, and one line of text.
    let (width, height) = (0.06 + 0.009 * longest, 0.02 + 0.05 * entries);
    let relative = |&(x, y): &(f64, f64)| {
        let relative =
            |coordinate, range: &Range<f64>| (coordinate - range.start) / (range.end - range.start);
        (relative(x, ranges[0]), relative(y, ranges[1]))
    };
    let mut samples: Vec<(f64, f64)> = Vec::new();
    for points in plotted {
        let points: Vec<(f64, f64)> = points.iter().map(relative).collect();
        for pair in points.windows(2) {
            let [from, to] = [pair[0], pair[1]];
            samples.extend((0..SAMPLES).map(|sample| {
                let part = sample as f64 / SAMPLES as f64;
                (
                    from.0 + part * (to.0 - from.0),
                    from.1 + part * (to.1 - from.1),
                )
            }));
        }
        samples.extend(points.last());
    }
    let corners = [
        (SeriesLabelPosition::UpperRight, true, true),
        (SeriesLabelPosition::UpperLeft, false, true),
        (SeriesLabelPosition::LowerRight, true, false),
        (SeriesLabelPosition::LowerLeft, false, false),
    ];
    let covered = |right: bool, upper: bool| {
        let within = |coordinate: f64, far: bool, size: f64| match far {
            true => coordinate > 1.0 - size,
            false => coordinate < size,
        };
        let covers = |&&(x, y): &&(f64, f64)| within(x, right, width) && within(y, upper, height);
        samples.iter().filter(covers).count()
    };
    let best = corners
        .into_iter()
        .min_by_key(|(_, right, upper)| covered(*right, *upper));
    best.map_or(SeriesLabelPosition::UpperRight, |(corner, ..)| corner)
}

impl PlotAxis<'_> {
    /// Returns the coordinate of a number on the axis; it is not finite if the number has none.
    fn coordinate(self, number: f64) -> f64 {
        match self.logarithmic {
            // The logarithm of 0 is infinite, and that of a negative number is NaN.
            true => number.log10(),
            false => number,
        }
    }

    /// Returns a scale for coordinates. `margin` is the space at each end, relative to their range.
    fn scale(self, coordinates: impl Iterator<Item = f64>, margin: f64) -> AxisScale {
        let (least, most) = coordinates.fold(
            (f64::INFINITY, f64::NEG_INFINITY),
            |(least, most), coordinate| (least.min(coordinate), most.max(coordinate)),
        );
        let range = match most - least {
            width if width > 0.0 && width.is_finite() => {
                least - margin * width..most + margin * width
            }
            // There is only one number, or none.
            0.0 => least - 0.5..least + 0.5,
            _ => 0.0..1.0,
        };
        let ticks = match self.logarithmic {
            true => {
                let numbers = logarithmic_ticks(10f64.powf(range.start), 10f64.powf(range.end));
                numbers.into_iter().map(f64::log10).collect()
            }
            false => linear_ticks(range.start, range.end),
        };
        AxisScale { range, ticks }
    }

    /// Returns the label of a tick at a coordinate.
    fn tick_label(self, coordinate: f64) -> String {
        match self.logarithmic {
            true => format_number(10f64.powf(coordinate)),
            false => format_number(coordinate),
        }
    }
}

/// The range and the ticks of an axis.
struct AxisScale {
    range: Range<f64>,
    ticks: Vec<f64>,
}

impl Ranged for AxisScale {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, coordinate: &f64, (first, last): (i32, i32)) -> i32 {
        let Range { start, end } = self.range;
        let relative = (coordinate - start) / (end - start);
        first + (relative * f64::from(last - first)).round() as i32
    }

    fn key_points<H: KeyPointHint>(&self, _: H) -> Vec<f64> {
        self.ticks.clone()
    }

    fn range(&self) -> Range<f64> {
        self.range.clone()
    }
}

/// Returns about four to nine round numbers at equal intervals.
fn linear_ticks(least: f64, most: f64) -> Vec<f64> {
    let rough = (most - least) / 8.0;
    let decade = 10f64.powf(rough.log10().floor());
    let steps = [1.0, 2.0, 5.0, 10.0].map(|digit| digit * decade);
    let step = steps.into_iter().find(|step| *step >= rough);
    let step = step.unwrap_or(10.0 * decade);
    let multiples = (least / step).ceil() as i64..=(most / step).floor() as i64;
    multiples.map(|multiple| multiple as f64 * step).collect()
}

/// Returns round numbers above 0, usually between three and twelve.
fn logarithmic_ticks(least: f64, most: f64) -> Vec<f64> {
    const FEW: [f64; 3] = [1.0, 2.0, 5.0];
    const MANY: [f64; 7] = [1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0];
    let decades = least.log10().floor() as i32..=most.log10().floor() as i32;
    let within = |digits: &[f64]| -> Vec<f64> {
        let all = { decades.clone() }
            .flat_map(|decade| digits.iter().map(move |digit| digit * 10f64.powi(decade)));
        all.filter(|tick| (least..=most).contains(tick)).collect()
    };
    let few = within(&FEW);
    match few.len() {
        ..6 => within(&MANY),
        6..12 => few,
        _ => within(&FEW[..1]),
    }
}

/// Formats a number with at most four significant digits and without trailing zeros.
fn format_number(number: f64) -> String {
    if number == 0.0 {
        return "0".into();
    }
    let decimals = (3 - number.abs().log10().floor() as i32).max(0) as usize;
    let text = format!("{number:.decimals$}");
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').into(),
        false => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(ticks: Vec<f64>) -> String {
        let labels = ticks.into_iter().map(format_number);
        labels.collect::<Vec<_>>().join(" ")
    }

    #[test]
    fn the_legend_is_in_a_corner_without_lines() {
        let line = |points: Vec<[f64; 2]>| PlotLine {
            label: "asked",
            points,
            colour: [0; 3],
            marked: true,
        };
        let legend_corner = |lines: &[PlotLine<'_>]| {
            let svg = plot("", [PlotAxis::linear("x"), PlotAxis::linear("y")], lines).unwrap();
            // The last text is that of the legend. The origin of coordinates is at the upper left.
            let text = svg.rsplit("<text ").next().unwrap();
            let place = |name: &str| -> f64 {
                let rest = text.split(&format!("{name}=\"")).nth(1).unwrap();
                rest.split('"').next().unwrap().parse().unwrap()
            };
            (place("x") > 450.0, place("y") < 240.0)
        };
        let rises = [[0.0, 0.0], [1.0, 1.0]].to_vec();
        let falls = [[0.0, 1.0], [1.0, 0.0]].to_vec();
        assert_eq!(legend_corner(&[line(falls.clone())]), (true, true));
        assert_eq!(legend_corner(&[line(rises.clone())]), (false, true));
        let both = [rises, vec![[0.0, 1.0], [0.5, 0.5]]].map(line);
        assert_eq!(legend_corner(&both), (true, false));
    }

    #[test]
    fn scales_have_round_numbers_whatever_the_range() {
        assert_eq!(
            labels(logarithmic_ticks(0.18, 2.1)),
            "0.2 0.3 0.4 0.5 0.7 1 1.5 2"
        );
        assert_eq!(
            labels(logarithmic_ticks(0.009, 12.0)),
            "0.01 0.02 0.05 0.1 0.2 0.5 1 2 5 10"
        );
        assert_eq!(labels(logarithmic_ticks(0.6, 1.7)), "0.7 1 1.5");
        assert_eq!(logarithmic_ticks(1e-6, 2000.0).len(), 10);
        assert_eq!(
            labels(linear_ticks(0.0, 20000.0)),
            "0 5000 10000 15000 20000"
        );
        assert_eq!(labels(linear_ticks(-0.31, 0.52)), "-0.2 0 0.2 0.4");
        assert_eq!(
            labels(linear_ticks(3.0, 3.004)),
            "3 3.001 3.002 3.003 3.004"
        );
    }

    #[test]
    fn lines_are_drawn_without_points_that_have_no_coordinates() {
        let axis = |label, logarithmic| PlotAxis { label, logarithmic };
        let line = |label, points: &[[f64; 2]]| PlotLine {
            label,
            points: points.to_vec(),
            colour: [1, 2, 3],
            marked: true,
        };
        let points = [[1.0, 0.5], [10.0, f64::NAN], [100.0, -1.0], [1000.0, 0.1]];
        let axes = [axis("steps <", true), axis("error", false)];
        let svg = plot("a & b", axes, &[line("one", &points), line("", &points)]).unwrap();
        assert_eq!(
            svg.matches("<circle").count(),
            2 * 3,
            "a point is not finite"
        );
        assert!(svg.contains("a &amp; b") && svg.contains("steps &lt;") && svg.contains("one"));
        let both = [axis("", true), axis("", true)];
        let svg = plot("", both, &[line("", &points)]).unwrap();
        assert_eq!(svg.matches("<circle").count(), 2, "nor below 0");
        plot("", both, &[line("", &[[5.0, 0.7]])]).unwrap();
        plot("", both, &[]).unwrap();
    }
}
