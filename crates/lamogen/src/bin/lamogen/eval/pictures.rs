//! Motions that a report shows: made for it, and not among the records.

use burn::tensor::Tensor;
use lamogen::laban::{Gaussian, LabanOptions, Window};
use lamogen::motion::Joint;
use lamogen::{
    COMPONENTS, Component, Device, FRAMES_PER_SECOND, Generation, LabanSeries, Motion, Request,
    Scale, Smoothing, Tag,
};
use lamogen_view::{Axis, Curve, Line, Row, curves, plot, strip};

use super::document::Block;
use super::plan::{Cell, Demand, INTERPOLATION, Plan, Setting, Study};
use super::report::ReportError;
use super::work::Work;

/// Poses of a strip.
const POSES: usize = 12;

/// With what several settings are shown.
const TAGS: [Tag; 2] = [Tag::Strong, Tag::Far];

/// The first sentence's motions.
pub struct Shown<'a> {
    plan: &'a Plan,
    work: &'a Work<'a>,
}

impl<'a> Shown<'a> {
    pub fn new(plan: &'a Plan, work: &'a Work<'a>) -> Self {
        Shown { plan, work }
    }

    fn caption(&self) -> &str {
        self.work.prompts[0].caption(0)
    }

    fn plain(&self) -> Request {
        Request::new(self.caption())
            .frames(self.work.prompts[0].frames)
            .steps(self.plan.basis.steps())
    }

    fn guided(&self, component: Component, factor: f32) -> Request {
        let mut factors = [1.0; COMPONENTS];
        factors[component.index()] = factor;
        let scale = Scale::new(factors).expect("factors are finite");
        let guidance = self.plan.basis.preset.guidance();
        self.plain().scale(scale).guidance(guidance)
    }

    fn generate(&self, request: &Request) -> Result<Generation, ReportError> {
        Ok(self.work.source.model.generate(request)?)
    }

    /// A single motion with all its series.
    pub fn example(&self) -> Result<Vec<Block>, ReportError> {
        let made = self.generate(&self.guided(Component::Weight, 1.5))?;
        let svg = curves(
            &format!("{}, Weight × 1.5", self.caption()),
            &[
                Curve::baseline(&made.baseline_laban),
                Curve::target(&made.target),
                Curve::guided(&made.guided_laban),
            ],
        )?;
        Ok(vec![
            Block::text(format!(
                "\"{}\" with Weight × 1.5, the rest as it is: the paper's figure of text-only and fully conditioned generation.",
                self.caption()
            )),
            Block::picture("One motion", "Weight, Time, Flow and Shape over time", svg),
        ])
    }

    /// What every method makes of the sentence with one tag, below what the sentence alone gives.
    pub fn methods(&self) -> Result<Vec<Block>, ReportError> {
        let methods = self.plan.methods.iter();
        let methods = methods.map(|setting| (setting.method.title(), setting));
        self.side_by_side("every method", methods)
    }

    /// What the rows of a study make of it.
    pub fn study(
        &self,
        study: Study,
        rows: &[(String, Setting)],
    ) -> Result<Vec<Block>, ReportError> {
        let rows = rows.iter().map(|(row, setting)| (row.as_str(), setting));
        self.side_by_side(&study.title().to_lowercase(), rows)
    }

    /// The sentence with each of [`TAGS`], in several settings.
    fn side_by_side<'s>(
        &self,
        name: &str,
        settings: impl Iterator<Item = (&'s str, &'s Setting)> + Clone,
    ) -> Result<Vec<Block>, ReportError> {
        let prompt = &self.work.prompts[0];
        let (mut labels, mut requests) = (Vec::new(), Vec::new());
        for tag in TAGS {
            let asked = Some((tag.component(), tag.scale()));
            for (label, setting) in settings.clone() {
                let own = |demand: &&Demand| [None, asked].contains(&demand.factor());
                for &demand in setting.demands.iter().filter(own) {
                    let cell = Cell {
                        setting,
                        demand,
                        prompt: 0,
                        repeat: 0,
                    };
                    labels.push((tag, label));
                    requests.push(cell.request(prompt));
                }
            }
        }
        let made = self.work.source.model.generate_all(&requests)?;
        let blocks = TAGS.map(|tag| {
            let rows = labels.iter().zip(&made);
            let rows = rows.filter(|((of, _), _)| *of == tag);
            let rows = rows.map(|((_, label), made)| Row {
                label,
                motion: &made.guided,
            });
            let svg = strip(&rows.collect::<Vec<_>>(), POSES);
            let caption = format!("\"{}\", {tag}: {name}", self.caption());
            Block::picture(&format!("{name} {tag}"), caption, svg)
        });
        Ok(blocks.into())
    }

    /// Five factors on Weight, and on Shape.
    pub fn interpolation(&self) -> Result<Vec<Block>, ReportError> {
        let mut blocks = Vec::new();
        for component in [Component::Weight, Component::Shape] {
            let requests = INTERPOLATION.map(|factor| self.guided(component, factor));
            let made = self.work.source.model.generate_all(&requests)?;
            let labels =
                INTERPOLATION.map(|factor| format!("{}, {component} × {factor}", self.caption()));
            let rows = labels.iter().zip(&made).map(|(label, made)| Row {
                label,
                motion: &made.guided,
            });
            let svg = strip(&rows.collect::<Vec<_>>(), POSES);
            let title = format!("Interpolation of {component}");
            let caption = format!("{component} from half to one and a half");
            blocks.push(Block::picture(&title, caption, svg));
        }
        Ok(blocks)
    }

    /// What smoothing does to Laban features, and to the root.
    pub fn smoothing(&self) -> Result<Vec<Block>, ReportError> {
        let motion = self.generate(&self.plain())?.baseline;
        let series = |smoothing: Smoothing| {
            let options = LabanOptions {
                smoothing,
                ..LabanOptions::default()
            };
            LabanSeries::of(&motion, &options, self.work.device)
        };
        let (with, without) = (series(Smoothing::default()), series(Smoothing::None));
        let svg = curves(
            "Laban features with and without smoothing",
            &[
                Curve {
                    label: "without smoothing",
                    ..Curve::baseline(&without)
                },
                Curve {
                    label: "with smoothing",
                    ..Curve::guided(&with)
                },
            ],
        )?;
        let mut blocks = vec![
            Block::text(
                "Laban features of one motion, and the velocity, acceleration and jerk of its root, with the Gaussian of 11 frames and variance 10 and without.",
            ),
            Block::picture(
                "Smoothing",
                "Laban features with and without smoothing",
                svg,
            ),
        ];
        let raw = roots(&motion);
        let smooth = smoothed(&raw, self.work.device);
        for (order, name, unit) in [
            (1, "velocity", "m/s"),
            (2, "acceleration", "m/s²"),
            (3, "jerk", "m/s³"),
        ] {
            let line = |label, colour, places: &[[f32; 3]]| Line {
                label,
                points: differences(places, order),
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
                [Axis::linear("seconds"), Axis::linear(unit)],
                &lines,
            )?;
            let caption = format!("{title} with and without smoothing");
            blocks.push(Block::picture(&title, caption, svg));
        }
        Ok(blocks)
    }
}

/// Where the root is.
fn roots(motion: &Motion) -> Vec<[f32; 3]> {
    let frames = 0..motion.frames();
    frames
        .map(|frame| motion.position(frame, Joint::Pelvis))
        .collect()
}

/// The same, smoothed as Laban features are.
fn smoothed(places: &[[f32; 3]], device: &Device) -> Vec<[f32; 3]> {
    let frames = places.len();
    let window = Window::new(&Gaussian::PAPER, frames, [frames].into_iter(), device);
    let places = Tensor::<1>::from_floats(places.as_flattened(), device);
    let smooth = window.smooth(places.reshape([1, frames, 3]));
    let smooth: Vec<f32> = smooth.try_into_vec_as().expect("floats convert to f32");
    smooth.as_chunks().0.to_vec()
}

/// Time in seconds and length of a difference over frames, per second, per second², per second³.
fn differences(places: &[[f32; 3]], order: usize) -> Vec<[f64; 2]> {
    let mut series: Vec<[f32; 3]> = places.to_vec();
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
        let smooth = smoothed(&line, &Device::flex());
        for frame in 5..25 {
            assert!((smooth[frame][0] - line[frame][0]).abs() < 1e-5);
        }
        assert!(smooth[0][0] > 0.0, "the first frame repeats");
        assert_eq!(differences(&line, 3).len(), 27);
    }
}
