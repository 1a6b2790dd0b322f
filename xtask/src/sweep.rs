//! Measures and plots how the time grows with frames, batch size and steps.

use std::error::Error;
use std::path::Path;

use burn::tensor::Device;
use lamogen_motion::write_atomically;
use plotters::prelude::*;

use crate::bench::{self, Options, Size, Times};

/// The quantity that is varied.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Axis {
    Frames,
    Batch,
    Steps,
}

impl Axis {
    const ALL: [Axis; 3] = [Axis::Frames, Axis::Batch, Axis::Steps];

    /// The values at which the time is measured.
    fn values(self) -> &'static [u64] {
        match self {
            Axis::Frames => &[20, 40, 60, 80, 100, 120, 140, 160, 180, 196],
            Axis::Batch => &[1, 2, 4, 8, 16],
            Axis::Steps => &[1, 2, 5, 10, 20, 40],
        }
    }

    /// The title of the panel.
    fn title(self) -> &'static str {
        match self {
            Axis::Frames => "one motion: ms a step by frames",
            Axis::Batch => "80 frames: ms a step and motion by motions at once",
            Axis::Steps => "80 frames: ms a pass by steps",
        }
    }

    /// The options of the benchmark at a value.
    fn options(self, size: Size, value: u64) -> Options {
        let options = Options {
            size,
            model: None,
            mdm: false,
            frames: 80,
            batch: 1,
            steps: 4,
            // Short measurements need more repetitions.
            repeat: match size {
                Size::Compact => 21,
                Size::Full => 3,
            },
        };
        match self {
            Axis::Frames => Options {
                frames: value,
                ..options
            },
            Axis::Batch => Options {
                batch: value,
                ..options
            },
            Axis::Steps => Options {
                steps: value,
                ..options
            },
        }
    }

    /// Returns the milliseconds of the baseline pass and of the guided pass, in the unit of the title.
    fn milliseconds(self, value: u64, times: Times) -> [f64; 2] {
        let factor = match self {
            Axis::Frames => 1.0,
            Axis::Batch => 1.0 / value as f64,
            Axis::Steps => value as f64,
        };
        [times.baseline_step, times.guided_step].map(|seconds| 1e3 * factor * seconds)
    }
}

/// One panel of the plot, with its measured points.
struct Panel {
    axis: Axis,
    /// The values, with the milliseconds of the baseline pass and of the guided pass.
    points: Vec<(u64, [f64; 2])>,
}

/// Measures a network and writes the plot as SVG. `report` receives one line of text for each point.
///
/// # Errors
///
/// If a pass fails or the file cannot be written.
pub fn run(
    size: Size,
    device: &Device,
    out: &Path,
    report: &mut dyn FnMut(&str),
) -> Result<(), Box<dyn Error>> {
    // A missing folder is an error now, not after minutes of measurements.
    let folder = out.parent().filter(|folder| !folder.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new("."));
    if !folder.is_dir() {
        return Err(format!("{}: there is no such folder", folder.display()).into());
    }
    let mut panels = Vec::new();
    for axis in Axis::ALL {
        let mut points = Vec::new();
        for &value in axis.values() {
            let times = bench::run(&axis.options(size, value), device)?;
            let [baseline, guided] = axis.milliseconds(value, times);
            report(&format!(
                "{:55} {value:4}  baseline {baseline:8.2}  guided {guided:8.2}",
                axis.title()
            ));
            points.push((value, [baseline, guided]));
        }
        panels.push(Panel { axis, points });
    }
    let mut svg = String::new();
    draw(&panels, &mut svg)?;
    write_atomically(out, |file| std::io::Write::write_all(file, svg.as_bytes()))
        .map_err(|error| format!("{}: {error}", out.display()))?;
    Ok(())
}

/// The colours of the baseline pass and of the guided pass.
const COLOURS: [RGBColor; 2] = [RGBColor(70, 110, 170), RGBColor(200, 80, 60)];

/// Draws the panels side by side.
fn draw(panels: &[Panel], svg: &mut String) -> Result<(), Box<dyn Error>> {
    let root = SVGBackend::with_string(svg, (1080, 320)).into_drawing_area();
    root.fill(&WHITE)?;
    let areas = root.split_evenly((1, panels.len()));
    for (panel, area) in panels.iter().zip(areas) {
        let largest = |value: fn(&(u64, [f64; 2])) -> f64| {
            panel.points.iter().map(value).fold(0.0f64, f64::max)
        };
        let (right, top) = (largest(|p| p.0 as f64), largest(|p| p.1[1].max(p.1[0])));
        let mut chart = ChartBuilder::on(&area)
            .caption(panel.axis.title(), ("sans-serif", 14))
            .margin(10)
            .x_label_area_size(28)
            .y_label_area_size(44)
            .build_cartesian_2d(0.0..right * 1.03, 0.0..top * 1.1)?;
        chart
            .configure_mesh()
            .x_labels(6)
            .y_labels(6)
            .x_label_formatter(&|x| format!("{x:.0}"))
            .y_label_formatter(&|y| format!("{y:.0}"))
            .light_line_style(TRANSPARENT)
            .draw()?;
        for (pass, (colour, name)) in COLOURS.into_iter().zip(["baseline", "guided"]).enumerate() {
            let points: Vec<(f64, f64)> = panel
                .points
                .iter()
                .map(|(x, y)| (*x as f64, y[pass]))
                .collect();
            chart
                .draw_series(LineSeries::new(points.clone(), colour.stroke_width(2)))?
                .label(name)
                .legend(move |(x, y)| {
                    PathElement::new([(x, y), (x + 16, y)], colour.stroke_width(2))
                });
            let dots = points
                .into_iter()
                .map(|point| Circle::new(point, 3, colour.filled()));
            chart.draw_series(dots)?;
        }
        chart
            .configure_series_labels()
            .position(match panel.axis {
                Axis::Batch => SeriesLabelPosition::UpperRight,
                _ => SeriesLabelPosition::UpperLeft,
            })
            .border_style(TRANSPARENT)
            .draw()?;
    }
    root.present()?;
    drop(root);
    Ok(())
}
