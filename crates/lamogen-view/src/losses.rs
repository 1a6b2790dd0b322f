//! How the losses of a training fell.

use plotters::prelude::*;

use crate::curves::CurveError;
use crate::printable;
use crate::text::shortened;

/// One line of the picture.
#[derive(Clone, Copy, Debug)]
pub struct LossCurve<'a> {
    /// What the legend calls it.
    pub label: &'a str,
    /// Steps and losses.
    pub points: &'a [(u64, f64)],
    /// Its colour, red, green, blue.
    pub colour: [u8; 3],
}

const SIZE: (u32, u32) = (900, 480);
const TITLE: u32 = 20;

/// Draws losses over steps, on a logarithmic scale, as an SVG document. Losses that are not finite or not above 0 are left out.
///
/// # Errors
///
/// If the picture cannot be drawn.
pub fn losses(title: &str, curves: &[LossCurve<'_>]) -> Result<String, CurveError> {
    let mut svg = String::new();
    draw(&mut svg, title, curves).map_err(|error| CurveError(error.to_string()))?;
    Ok(svg)
}

fn draw(
    svg: &mut String,
    title: &str,
    curves: &[LossCurve<'_>],
) -> Result<(), Box<dyn std::error::Error>> {
    let area = SVGBackend::with_string(svg, SIZE).into_drawing_area();
    area.fill(&WHITE)?;
    let title = shortened(&printable(title), TITLE as f32, SIZE.0 as f32);
    let drawable = |&&(_, loss): &&(u64, f64)| loss.is_finite() && loss > 0.0;
    let points = || {
        curves
            .iter()
            .flat_map(|curve| curve.points.iter().filter(drawable))
    };
    let last = points().map(|(step, _)| *step).max().unwrap_or(1).max(1);
    let least = points()
        .map(|(_, loss)| *loss)
        .fold(f64::INFINITY, f64::min);
    let most = points().map(|(_, loss)| *loss).fold(0.0, f64::max);
    let (least, most) = match least < most {
        true => (0.9 * least, 1.1 * most),
        // One number, or none.
        false if most > 0.0 => (0.5 * most, 2.0 * most),
        false => (0.1, 1.0),
    };
    let mut chart = ChartBuilder::on(&area)
        .caption(title, ("sans-serif", TITLE))
        .margin(12)
        .x_label_area_size(38)
        .y_label_area_size(58)
        .build_cartesian_2d(
            0..last,
            (least..most)
                .log_scale()
                .with_key_points(ticks(least, most)),
        )?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(RGBColor(229, 231, 235))
        .x_desc("steps")
        .y_desc("loss")
        .label_style(("sans-serif", 12))
        .y_label_formatter(&|loss| label(*loss))
        .draw()?;
    for curve in curves {
        let [red, green, blue] = curve.colour;
        let style = RGBColor(red, green, blue).stroke_width(2);
        let points = curve.points.iter().filter(drawable).copied();
        chart
            .draw_series(LineSeries::new(points, style))?
            .label(printable(curve.label))
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], style));
    }
    chart
        .configure_series_labels()
        .background_style(WHITE.mix(0.8))
        .border_style(RGBColor(209, 213, 219))
        .position(SeriesLabelPosition::UpperRight)
        .label_font(("sans-serif", 13))
        .draw()?;
    drop(chart);
    area.present()?;
    Ok(())
}

/// Round numbers within a range, above 0, a handful or two.
fn ticks(least: f64, most: f64) -> Vec<f64> {
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

/// A tick in as many digits as it has.
fn label(tick: f64) -> String {
    let decimals = (1 - tick.log10().floor() as i32).max(0) as usize;
    let text = format!("{tick:.decimals$}");
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').into(),
        false => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_has_round_numbers_whatever_the_range() {
        let labels = |least, most| {
            let ticks = ticks(least, most).into_iter();
            ticks.map(label).collect::<Vec<_>>().join(" ")
        };
        assert_eq!(labels(0.18, 2.1), "0.2 0.3 0.4 0.5 0.7 1 1.5 2");
        assert_eq!(labels(0.009, 12.0), "0.01 0.02 0.05 0.1 0.2 0.5 1 2 5 10");
        assert_eq!(labels(0.6, 1.7), "0.7 1 1.5");
        assert_eq!(labels(1e-6, 2000.0).split(' ').count(), 10);
    }

    #[test]
    fn every_curve_and_its_name_are_drawn_and_broken_losses_left_out() {
        let falling: Vec<(u64, f64)> = (1..100).map(|step| (step, 1.0 / step as f64)).collect();
        let broken = [
            (10, f64::NAN),
            (20, 0.5),
            (30, f64::INFINITY),
            (40, 0.0),
            (50, 0.3),
        ];
        let curves = [("training", &falling[..]), ("validation <&>", &broken[..])];
        let curves = curves.map(|(label, points)| LossCurve {
            label,
            points,
            colour: [1, 2, 3],
        });
        let svg = losses("compact", &curves).unwrap();
        let lines = |svg: &str| svg.matches("<polyline").count();
        let one = losses("compact", &curves[..1]).unwrap();
        assert_eq!(
            lines(&svg) - lines(&one),
            2,
            "a curve, and one in the legend"
        );
        assert!(svg.contains("training") && svg.contains("validation &lt;&amp;&gt;"));
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
    }

    #[test]
    fn nothing_and_a_single_point_are_no_trouble() {
        let curve = LossCurve {
            label: "",
            points: &[(5, 0.7)],
            colour: [0; 3],
        };
        losses("one", &[curve]).unwrap();
        losses("none", &[]).unwrap();
    }
}
