//! The pictures of a report. Their motions are generated for the report; they are not among the records.

use burn::tensor::Tensor;
use lamogen::laban::{GaussianKernel, LabanOptions, SmoothingWindow};
use lamogen::motion::Joint;
use lamogen::{
    COMPONENTS, Component, Device, FRAMES_PER_SECOND, Generation, LabanSeries, Motion, Request,
    Scale, Smoothing, Tag,
};
use lamogen_model::Denoiser;
use lamogen_view::{LabanCurve, LabelledMotion, PlotAxis, PlotLine, curves, plot, strip};

use super::document::ReportBlock;
use super::plan::{Condition, EvalPlan, INTERPOLATION, MethodSetting, PlannedMotion, Study};
use super::report::ReportError;
use super::runner::EvalRunner;

/// The number of poses on a strip.
const POSES: usize = 12;

/// The tags of pictures that compare settings.
const TAGS: [Tag; 2] = [Tag::Strong, Tag::Far];

/// Draws pictures of motions of the first sentence.
pub struct ReportPictures<'a, D> {
    plan: &'a EvalPlan,
    runner: &'a EvalRunner<'a, D>,
}

impl<'a, D: Denoiser> ReportPictures<'a, D> {
    pub fn new(plan: &'a EvalPlan, runner: &'a EvalRunner<'a, D>) -> Self {
        ReportPictures { plan, runner }
    }

    /// Returns the sentence.
    fn caption(&self) -> &str {
        self.runner.prompts[0].caption(0)
    }

    /// Returns the request for the motion of the sentence alone.
    fn unguided_request(&self) -> Request {
        Request::new(self.caption())
            .frames(self.runner.prompts[0].frames(0))
            .steps(self.plan.defaults.steps())
    }

    /// Returns the request for a motion with a factor on one component.
    fn guided_request(&self, component: Component, factor: f32) -> Request {
        let mut factors = [1.0; COMPONENTS];
        factors[component.index()] = factor;
        let scale = Scale::new(factors).expect("factors are finite");
        let guidance = self.plan.defaults.preset.guidance();
        self.unguided_request().scale(scale).guidance(guidance)
    }

    /// Generates a motion.
    fn generate(&self, request: &Request) -> Result<Generation, ReportError> {
        Ok(self.runner.model.generate(request)?)
    }

    /// Draws the Laban series of a single motion.
    pub fn example(&self) -> Result<Vec<ReportBlock>, ReportError> {
        let generation = self.generate(&self.guided_request(Component::Weight, 1.5))?;
        let svg = curves(
            &format!("{}, Weight × 1.5", self.caption()),
            &[
                LabanCurve::baseline(&generation.baseline_laban),
                LabanCurve::target(&generation.target),
                LabanCurve::guided(&generation.guided_laban),
            ],
        )?;
        Ok(vec![
            ReportBlock::text(format!(
                "\"{}\" with Weight × 1.5, the rest as it is: the paper's figure of text-only and fully conditioned generation.",
                self.caption()
            )),
            ReportBlock::picture("One motion", "Weight, Time, Flow and Shape over time", svg),
        ])
    }

    /// Draws the motions of all methods with one tag, below the motion of the sentence alone.
    pub fn methods(&self) -> Result<Vec<ReportBlock>, ReportError> {
        let methods = self.plan.methods.iter();
        let methods = methods.map(|setting| (setting.method.title(), setting));
        self.side_by_side("every method", methods)
    }

    /// Draws the motions of the rows of a study.
    pub fn study(
        &self,
        study: Study,
        rows: &[(String, MethodSetting)],
    ) -> Result<Vec<ReportBlock>, ReportError> {
        let rows = rows.iter().map(|(row, setting)| (row.as_str(), setting));
        self.side_by_side(&study.title().to_lowercase(), rows)
    }

    /// Draws the motions of several settings with each of [`TAGS`].
    fn side_by_side<'s>(
        &self,
        name: &str,
        settings: impl Iterator<Item = (&'s str, &'s MethodSetting)> + Clone,
    ) -> Result<Vec<ReportBlock>, ReportError> {
        let prompt = &self.runner.prompts[0];
        let (mut labels, mut requests) = (Vec::new(), Vec::new());
        for tag in TAGS {
            let factor = Some((tag.component(), tag.scale()));
            for (label, setting) in settings.clone() {
                let is_of_tag =
                    |condition: &&Condition| [None, factor].contains(&condition.factor());
                for &condition in setting.conditions.iter().filter(is_of_tag) {
                    let planned = PlannedMotion {
                        variant: 0,
                        setting,
                        condition,
                        prompt: 0,
                        repeat: 0,
                    };
                    labels.push((tag, label));
                    requests.push(planned.request(prompt));
                }
            }
        }
        let generations = self.runner.model.generate_all(&requests)?;
        let blocks = TAGS.map(|tag| {
            let rows = labels.iter().zip(&generations);
            let rows = rows.filter(|((row_tag, _), _)| *row_tag == tag);
            let rows =
                rows.map(|((_, label), generation)| LabelledMotion::new(label, &generation.guided));
            let svg = strip(&rows.collect::<Vec<_>>(), POSES);
            let caption = format!("\"{}\", {tag}: {name}", self.caption());
            ReportBlock::picture(&format!("{name} {tag}"), caption, svg)
        });
        Ok(blocks.into())
    }

    /// Draws the motions of five factors on Weight, and on Shape.
    pub fn interpolation(&self) -> Result<Vec<ReportBlock>, ReportError> {
        let mut blocks = Vec::new();
        for component in [Component::Weight, Component::Shape] {
            let requests = INTERPOLATION.map(|factor| self.guided_request(component, factor));
            let generations = self.runner.model.generate_all(&requests)?;
            let labels =
                INTERPOLATION.map(|factor| format!("{}, {component} × {factor}", self.caption()));
            let rows = labels.iter().zip(&generations);
            let rows =
                rows.map(|(label, generation)| LabelledMotion::new(label, &generation.guided));
            let svg = strip(&rows.collect::<Vec<_>>(), POSES);
            let title = format!("Interpolation of {component}");
            let caption = format!("{component} from half to one and a half");
            blocks.push(ReportBlock::picture(&title, caption, svg));
        }
        Ok(blocks)
    }

    /// Draws the effect of smoothing on Laban features, and on the derivatives of the root's position.
    pub fn smoothing(&self) -> Result<Vec<ReportBlock>, ReportError> {
        let motion = self.generate(&self.unguided_request())?.baseline;
        let series = |smoothing: Smoothing| {
            let options = LabanOptions {
                smoothing,
                ..LabanOptions::default()
            };
            LabanSeries::of(&motion, &options, self.runner.device)
        };
        let (with, without) = (series(Smoothing::default()), series(Smoothing::None));
        let svg = curves(
            "Laban features with and without smoothing",
            &[
                LabanCurve {
                    label: "without smoothing",
                    ..LabanCurve::baseline(&without)
                },
                LabanCurve {
                    label: "with smoothing",
                    ..LabanCurve::guided(&with)
                },
            ],
        )?;
        let mut blocks = vec![
            ReportBlock::text(
                "Laban features of one motion, and the velocity, acceleration and jerk of its root, with the Gaussian of 11 frames and variance 10 and without.",
            ),
            ReportBlock::picture(
                "Smoothing",
                "Laban features with and without smoothing",
                svg,
            ),
        ];
        let raw = root_positions(&motion);
        let smooth = smooth_positions(&raw, self.runner.device);
        for (order, name, unit) in [
            (1, "velocity", "m/s"),
            (2, "acceleration", "m/s²"),
            (3, "jerk", "m/s³"),
        ] {
            let line = |label, colour, positions: &[[f32; 3]]| PlotLine {
                label,
                points: differences(positions, order),
                colour,
                marked: false,
            };
            let lines = [
                line("without smoothing", [107, 114, 128], &raw),
                line("with smoothing", [194, 65, 12], &smooth),
            ];
            let title = format!("Root {name}");
            let svg = plot(
                &title,
                [PlotAxis::linear("seconds"), PlotAxis::linear(unit)],
                &lines,
            )?;
            let caption = format!("{title} with and without smoothing");
            blocks.push(ReportBlock::picture(&title, caption, svg));
        }
        Ok(blocks)
    }
}

/// Returns the positions of the root.
fn root_positions(motion: &Motion) -> Vec<[f32; 3]> {
    let frames = 0..motion.frames();
    frames
        .map(|frame| motion.position(frame, Joint::Pelvis))
        .collect()
}

/// Smooths positions as Laban features do.
fn smooth_positions(positions: &[[f32; 3]], device: &Device) -> Vec<[f32; 3]> {
    let frames = positions.len();
    let window = SmoothingWindow::new(&GaussianKernel::PAPER, frames, [frames].into_iter(), device);
    let positions = Tensor::<1>::from_floats(positions.as_flattened(), device);
    let smooth = window.smooth(positions.reshape([1, frames, 3]));
    let smooth: Vec<f32> = smooth.try_into_vec_as().expect("floats convert to f32");
    smooth.as_chunks().0.to_vec()
}

/// Returns the time in seconds and the length of the n-th difference of positions over frames, for `order` n. The
/// lengths are per second (order 1), per second² (order 2) or per second³ (order 3).
fn differences(positions: &[[f32; 3]], order: usize) -> Vec<[f64; 2]> {
    let mut series: Vec<[f32; 3]> = positions.to_vec();
    for _ in 0..order {
        let pairs = series.windows(2);
        series = pairs
            .map(|pair| [0, 1, 2].map(|axis| pair[1][axis] - pair[0][axis]))
            .collect();
    }
    let rate = f64::from(FRAMES_PER_SECOND);
    let lengths = series
        .iter()
        .map(|step| step.iter().map(|x| f64::from(x * x)).sum::<f64>().sqrt());
    let points = lengths.enumerate();
    points
        .map(|(frame, length)| {
            [
                (frame + order) as f64 / rate,
                length * rate.powi(order as i32),
            ]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_are_per_second_and_smoothing_keeps_a_line() {
        let line: Vec<[f32; 3]> = (0..30)
            .map(|frame| [0.1 * frame as f32, 0.0, 1.0])
            .collect();
        for [_, speed] in differences(&line, 1) {
            assert!((speed - 2.0).abs() < 1e-4, "{speed}");
        }
        let smooth = smooth_positions(&line, &Device::flex());
        for frame in 5..25 {
            assert!((smooth[frame][0] - line[frame][0]).abs() < 1e-5);
        }
        assert!(smooth[0][0] > 0.0, "the first frame repeats");
        assert_eq!(differences(&line, 3).len(), 27);
    }
}
