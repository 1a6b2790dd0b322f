//! Plots of training losses.

use crate::curves::PlotError;
use crate::plot::{PlotAxis, PlotLine, plot};

/// The losses of a training as one line of the plot.
#[derive(Clone, Copy, Debug)]
pub struct LossCurve<'a> {
    /// The label in the legend.
    pub label: &'a str,
    /// Pairs of a training step and its loss.
    pub points: &'a [(u64, f64)],
    /// The colour as red, green and blue.
    pub colour: [u8; 3],
}

/// Draws losses over training steps on a logarithmic scale as an SVG document. Losses that are not finite or not above 0
/// are left out.
///
/// # Errors
///
/// If the picture cannot be drawn.
pub fn losses(title: &str, curves: &[LossCurve<'_>]) -> Result<String, PlotError> {
    let (steps, loss) = (PlotAxis::linear("steps"), PlotAxis::logarithmic("loss"));
    let line = |curve: &LossCurve<'_>| {
        let points = curve.points.iter();
        let points = points.map(|&(step, loss)| [step as f64, loss]);
        points.collect()
    };
    let lines: Vec<PlotLine<'_>> = curves
        .iter()
        .map(|curve| PlotLine {
            label: curve.label,
            points: line(curve),
            colour: curve.colour,
            marked: false,
        })
        .collect();
    plot(title, [steps, loss], &lines)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_curve_and_its_label_are_drawn_and_invalid_losses_left_out() {
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
    fn no_curve_and_a_single_point_are_valid() {
        let curve = LossCurve {
            label: "",
            points: &[(5, 0.7)],
            colour: [0; 3],
        };
        losses("one", &[curve]).unwrap();
        losses("none", &[]).unwrap();
    }
}
