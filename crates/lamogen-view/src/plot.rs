//! Lines over an axis.

use std::ops::Range;

use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint};
use plotters::prelude::*;

use crate::curves::CurveError;
use crate::printable;
use crate::text::shortened;

/// A direction of a plot.
#[derive(Clone, Copy, Debug)]
pub struct Axis<'a> {
    /// What stands beside it.
    pub label: &'a str,
    /// Whether its scale is logarithmic; numbers that are not above 0 are then left out.
    pub logarithmic: bool,
}

impl<'a> Axis<'a> {
    /// One whose numbers stand at equal distances.
    pub fn linear(label: &'a str) -> Self {
        Axis {
            label,
            logarithmic: false,
        }
    }

    /// One whose equal distances are equal factors.
    pub fn logarithmic(label: &'a str) -> Self {
        Axis {
            label,
            logarithmic: true,
        }
    }
}

/// One line of a plot.
#[derive(Clone, Debug)]
pub struct Line<'a> {
    /// What the legend calls it; nothing stands there if it is empty.
    pub label: &'a str,
    /// Where it goes, from left to right. Points with a number that is not finite are left out.
    pub points: Vec<[f64; 2]>,
    /// Its colour, red, green, blue.
    pub colour: [u8; 3],
    /// Whether its points are marked: where there are few.
    pub marked: bool,
}

const SIZE: (u32, u32) = (900, 480);
const TITLE: u32 = 20;

/// Draws lines as an SVG document; the first axis goes to the right.
///
/// # Errors
///
/// If the picture cannot be drawn.
pub fn plot(title: &str, axes: [Axis<'_>; 2], lines: &[Line<'_>]) -> Result<String, CurveError> {
    let mut svg = String::new();
    draw(&mut svg, title, axes, lines).map_err(|error| CurveError(error.to_string()))?;
    Ok(svg)
}

fn draw(
    svg: &mut String,
    title: &str,
    axes: [Axis<'_>; 2],
    lines: &[Line<'_>],
) -> Result<(), Box<dyn std::error::Error>> {
    let area = SVGBackend::with_string(svg, SIZE).into_drawing_area();
    area.fill(&WHITE)?;
    let title = shortened(&printable(title), TITLE as f32, SIZE.0 as f32);
    let placed: Vec<Vec<(f64, f64)>> = lines
        .iter()
        .map(|line| {
            let points = line.points.iter();
            let place = |&[x, y]: &[f64; 2]| (axes[0].place(x), axes[1].place(y));
            let points = points.map(place);
            let points = points.filter(|(x, y)| x.is_finite() && y.is_finite());
            points.collect()
        })
        .collect();
    let all = || placed.iter().flatten();
    // Marks at the ends would be cut in half.
    let room = match lines.iter().any(|line| line.marked) {
        true => 0.03,
        false => 0.0,
    };
    let x = axes[0].scale(all().map(|point| point.0), room);
    let y = axes[1].scale(all().map(|point| point.1), 0.04);
    let corner = free_corner(lines, &placed, [&x.range, &y.range]);
    let mut chart = ChartBuilder::on(&area)
        .caption(title, ("sans-serif", TITLE))
        .margin(12)
        // The last number of the axis stands half beyond it.
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
        .x_label_formatter(&|place| axes[0].name(*place))
        .y_label_formatter(&|place| axes[1].name(*place))
        .draw()?;
    for (line, points) in lines.iter().zip(placed) {
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

/// Where the legend covers least of the lines; at the upper right, if that is as good as others.
fn free_corner(
    lines: &[Line<'_>],
    placed: &[Vec<(f64, f64)>],
    ranges: [&Range<f64>; 2],
) -> SeriesLabelPosition {
    /// Between two points.
    const SAMPLES: usize = 16;
    let labels = lines.iter().map(|line| line.label.chars().count());
    let longest = labels.clone().max().unwrap_or(0) as f64;
    let entries = labels.filter(|length| *length > 0).count() as f64;
    // In shares of the plot: a letter, the stroke before it, a line of text.
    let (width, height) = (0.06 + 0.009 * longest, 0.02 + 0.05 * entries);
    let share = |&(x, y): &(f64, f64)| {
        let share = |place, range: &Range<f64>| (place - range.start) / (range.end - range.start);
        (share(x, ranges[0]), share(y, ranges[1]))
    };
    let mut seen: Vec<(f64, f64)> = Vec::new();
    for points in placed {
        let points: Vec<(f64, f64)> = points.iter().map(share).collect();
        for pair in points.windows(2) {
            let [from, to] = [pair[0], pair[1]];
            seen.extend((0..SAMPLES).map(|sample| {
                let way = sample as f64 / SAMPLES as f64;
                (
                    from.0 + way * (to.0 - from.0),
                    from.1 + way * (to.1 - from.1),
                )
            }));
        }
        seen.extend(points.last());
    }
    let corners = [
        (SeriesLabelPosition::UpperRight, true, true),
        (SeriesLabelPosition::UpperLeft, false, true),
        (SeriesLabelPosition::LowerRight, true, false),
        (SeriesLabelPosition::LowerLeft, false, false),
    ];
    let covered = |right: bool, upper: bool| {
        let within = |place: f64, far: bool, size: f64| match far {
            true => place > 1.0 - size,
            false => place < size,
        };
        let covers = |&&(x, y): &&(f64, f64)| within(x, right, width) && within(y, upper, height);
        seen.iter().filter(covers).count()
    };
    let best = corners
        .into_iter()
        .min_by_key(|(_, right, upper)| covered(*right, *upper));
    best.map_or(SeriesLabelPosition::UpperRight, |(corner, ..)| corner)
}

impl Axis<'_> {
    /// Where a number stands; not finite if it stands nowhere.
    fn place(self, number: f64) -> f64 {
        match self.logarithmic {
            // The logarithm of 0 is infinite, that of less is none.
            true => number.log10(),
            false => number,
        }
    }

    /// A scale for places, with some room at its ends.
    fn scale(self, places: impl Iterator<Item = f64>, room: f64) -> Scale {
        let (least, most) = places.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), place| {
            (a.min(place), b.max(place))
        });
        let range = match most - least {
            width if width > 0.0 && width.is_finite() => least - room * width..most + room * width,
            // One number, or none.
            0.0 => least - 0.5..least + 0.5,
            _ => 0.0..1.0,
        };
        let ticks = match self.logarithmic {
            true => {
                let numbers = logarithmic(10f64.powf(range.start), 10f64.powf(range.end));
                numbers.into_iter().map(f64::log10).collect()
            }
            false => linear(range.start, range.end),
        };
        Scale { range, ticks }
    }

    /// What stands at a tick.
    fn name(self, place: f64) -> String {
        match self.logarithmic {
            true => name(10f64.powf(place)),
            false => name(place),
        }
    }
}

/// A range with ticks.
struct Scale {
    range: Range<f64>,
    ticks: Vec<f64>,
}

impl Ranged for Scale {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, place: &f64, (first, last): (i32, i32)) -> i32 {
        let Range { start, end } = self.range;
        let share = (place - start) / (end - start);
        first + (share * f64::from(last - first)).round() as i32
    }

    fn key_points<H: KeyPointHint>(&self, _: H) -> Vec<f64> {
        self.ticks.clone()
    }

    fn range(&self) -> Range<f64> {
        self.range.clone()
    }
}

/// Round numbers at equal distances, a handful or two.
fn linear(least: f64, most: f64) -> Vec<f64> {
    let rough = (most - least) / 8.0;
    let decade = 10f64.powf(rough.log10().floor());
    let steps = [1.0, 2.0, 5.0, 10.0].map(|digit| digit * decade);
    let step = steps.into_iter().find(|step| *step >= rough);
    let step = step.unwrap_or(10.0 * decade);
    let places = (least / step).ceil() as i64..=(most / step).floor() as i64;
    places.map(|place| place as f64 * step).collect()
}

/// Round numbers above 0, a handful or two.
fn logarithmic(least: f64, most: f64) -> Vec<f64> {
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

/// A number in as many digits as it has, but no more than four.
fn name(number: f64) -> String {
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

    fn names(ticks: Vec<f64>) -> String {
        ticks.into_iter().map(name).collect::<Vec<_>>().join(" ")
    }

    #[test]
    fn the_legend_stands_where_no_line_goes() {
        let line = |points: Vec<[f64; 2]>| Line {
            label: "asked",
            points,
            colour: [0; 3],
            marked: true,
        };
        let stands = |lines: &[Line<'_>]| {
            let svg = plot("", [Axis::linear("x"), Axis::linear("y")], lines).unwrap();
            // The last text is the legend's; the origin is at the upper left.
            let text = svg.rsplit("<text ").next().unwrap();
            let place = |name: &str| -> f64 {
                let rest = text.split(&format!("{name}=\"")).nth(1).unwrap();
                rest.split('"').next().unwrap().parse().unwrap()
            };
            (place("x") > 450.0, place("y") < 240.0)
        };
        let rises = [[0.0, 0.0], [1.0, 1.0]].to_vec();
        let falls = [[0.0, 1.0], [1.0, 0.0]].to_vec();
        assert_eq!(stands(&[line(falls.clone())]), (true, true));
        assert_eq!(stands(&[line(rises.clone())]), (false, true));
        let both = [rises, vec![[0.0, 1.0], [0.5, 0.5]]].map(line);
        assert_eq!(stands(&both), (true, false));
    }

    #[test]
    fn scales_have_round_numbers_whatever_the_range() {
        assert_eq!(names(logarithmic(0.18, 2.1)), "0.2 0.3 0.4 0.5 0.7 1 1.5 2");
        assert_eq!(
            names(logarithmic(0.009, 12.0)),
            "0.01 0.02 0.05 0.1 0.2 0.5 1 2 5 10"
        );
        assert_eq!(names(logarithmic(0.6, 1.7)), "0.7 1 1.5");
        assert_eq!(logarithmic(1e-6, 2000.0).len(), 10);
        assert_eq!(names(linear(0.0, 20000.0)), "0 5000 10000 15000 20000");
        assert_eq!(names(linear(-0.31, 0.52)), "-0.2 0 0.2 0.4");
        assert_eq!(names(linear(3.0, 3.004)), "3 3.001 3.002 3.003 3.004");
    }

    #[test]
    fn lines_are_drawn_and_what_stands_nowhere_is_left_out() {
        let axis = |label, logarithmic| Axis { label, logarithmic };
        let line = |label, points: &[[f64; 2]]| Line {
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
