//! The report: the paper's tables beside this model's, the ablations, and pictures.

use std::io::Write;
use std::path::{Path, PathBuf};

use lamogen::laban::{Gaussian, LabanOptions};
use lamogen::motion::{Joint, write_atomically};
use lamogen::{
    COMPONENTS, Component, FRAMES_PER_SECOND, LabanSeries, Motion, Request, Scale, Smoothing,
};
use lamogen_eval::MetricError;
use lamogen_view::{Axis, Curve, CurveError, Line, Row, curves, plot, strip};
use serde_json::json;

use super::Plan;
use super::document::{Block, html, markdown};
use super::paper;
use super::plan::{Demand, INTERPOLATION, Prompt, Setting, Study};
use super::summary::{Control, Evidence, Figures, Mean};
use super::work::Work;
use crate::failure::Failure;

/// Names of the components, as the tables have them.
const NAMES: [&str; COMPONENTS] = ["Weight", "Time", "Flow", "Shape"];
const COLOURS: [[u8; 3]; COMPONENTS] =
    [[194, 65, 12], [3, 105, 161], [22, 101, 52], [126, 34, 206]];

/// A report, ready to be written.
pub struct Report {
    title: String,
    blocks: Vec<Block>,
    figures: Vec<Figures>,
}

impl Report {
    /// Computes everything. Motions that are `missing` are said to be.
    pub fn new(
        plan: &Plan,
        evidence: &Evidence<'_>,
        work: &Work<'_>,
        missing: usize,
    ) -> Result<Report, ReportError> {
        let figures = plan
            .settings
            .iter()
            .filter_map(|setting| evidence.figures(setting).transpose())
            .collect::<Result<Vec<Figures>, MetricError>>()?;
        let mut report = Report {
            title: format!("Evidence for the model {}", work.source.name),
            blocks: Vec::new(),
            figures,
        };
        report.basis(plan, work, missing);
        report.control(plan);
        report.fidelity(plan, evidence)?;
        report.quality(plan);
        report.example(plan, work)?;
        for (study, rows) in &plan.studies {
            report.study(*study, rows, plan, evidence)?;
            if *study == Study::Interpolation {
                report.interpolation_strips(plan, work)?;
            }
        }
        report.smoothing(plan, work)?;
        report.failures();
        Ok(report)
    }

    /// Writes `report.md` with its pictures in `pictures/`, `report.html` and `figures.json`.
    pub fn write(&self, folder: &Path) -> Result<Vec<PathBuf>, Failure> {
        const PICTURES: &str = "pictures";
        let pictures = folder.join(PICTURES);
        std::fs::create_dir_all(&pictures).map_err(|error| Failure::output(&pictures, error))?;
        let text = markdown(&self.title, &self.blocks, PICTURES);
        let page = html(&self.title, &self.blocks);
        let figures = serde_json::to_string_pretty(&json!({ "settings": self.figures }));
        let figures = figures.expect("figures are JSON");
        for block in &self.blocks {
            if let Block::Picture { name, svg, .. } = block {
                write(&pictures.join(format!("{name}.svg")), svg)?;
            }
        }
        let files = [
            ("report.md", text),
            ("report.html", page),
            ("figures.json", figures),
        ];
        files
            .into_iter()
            .map(|(name, content)| {
                let path = folder.join(name);
                write(&path, &content)?;
                Ok(path)
            })
            .collect()
    }

    fn of(&self, name: &str) -> Option<&Figures> {
        self.figures.iter().find(|figures| figures.setting == name)
    }

    fn basis(&mut self, plan: &Plan, work: &Work<'_>, missing: usize) {
        let prompts = work.prompts.len();
        let repeats = match plan.repeats {
            1 => "one motion of each".into(),
            repeats => format!(
                "{repeats} motions of each, from {repeats} seeds; ± is the 95 % interval over these"
            ),
        };
        let coherence = match work.source.coherence_frames() {
            Some(frames) => format!("predictions smoothed by {frames} frames"),
            None => "predictions as they are".into(),
        };
        let mut text = format!(
            "{prompts} sentences, {repeats}; {} DDIM steps ({} for start noise), {coherence}. Laban features are compared by their maximum over time, as in the paper. \
             Figures of the paper, with MotionDiffuse on HumanML3D, stand in brackets.",
            plan.basis.steps, plan.basis.noise_steps
        );
        if missing > 0 {
            text.push_str(&format!(
                "\n\n**{missing} motions are not made yet; the figures are of the others.**"
            ));
        }
        self.blocks.push(Block::text(text));
    }

    /// The paper's table 1.
    fn control(&mut self, plan: &Plan) {
        let mut rows = Vec::new();
        for setting in &plan.methods {
            let Some(control) = self
                .of(&setting.name)
                .and_then(|figures| figures.control.as_ref())
            else {
                continue;
            };
            let paper = paper::control(setting.method);
            for (asked, name) in NAMES.iter().enumerate() {
                let mut row = vec![
                    if asked == 0 {
                        setting.method.title().into()
                    } else {
                        String::new()
                    },
                    (*name).to_owned(),
                ];
                row.extend((0..COMPONENTS).map(|measured| {
                    let (mean, std) = (control.mean[asked][measured], control.std[asked][measured]);
                    let paper = paper.as_ref().map(|paper| paper.cells[asked][measured]);
                    let paper = paper.map_or(String::new(), |(mean, std)| {
                        format!(" ({mean:.3} ± {std:.3})")
                    });
                    format!("{mean:.3} ± {std:.3}{paper}")
                }));
                row.push(match asked {
                    0 => {
                        let paper = paper.as_ref().map_or(String::new(), |paper| {
                            format!(" ({:.3})", paper.diagonality)
                        });
                        format!("{:.3}{paper}", control.diagonality)
                    }
                    _ => String::new(),
                });
                rows.push(row);
            }
        }
        if rows.is_empty() {
            return;
        }
        self.blocks.extend([
            Block::heading("Control"),
            Block::text(
                "Mean relative change (large - small) / small of every component when one is asked for by its two tags, with the standard deviation \
                 over motions. The tags ask for 2.0 of Weight and Shape and for 0.5 of Time and Flow. Diagonality is the share of the squares on the diagonal.",
            ),
            Block::table(["method", "asked", "Weight", "Time", "Flow", "Shape", "diagonality"], rows),
        ]);
    }

    /// The paper's table 2.
    fn fidelity(&mut self, plan: &Plan, evidence: &Evidence<'_>) -> Result<(), MetricError> {
        let with = |value: Option<Mean>, paper: Option<f64>, digits: usize| match value {
            None => "–".to_owned(),
            Some(value) => {
                let paper = paper.map_or(String::new(), |paper| format!(" ({paper:.digits$})"));
                format!("{}{paper}", shown(value, digits))
            }
        };
        let mut rows = Vec::new();
        let real = evidence.of_real()?;
        let mut add = |title: &str,
                       figures: (Option<[Mean; 3]>, [Option<Mean>; 3]),
                       paper: Option<[f64; 5]>| {
            let (ranks, [fid, diversity, matching]) = figures;
            let mut row = vec![title.to_owned()];
            row.extend([0, 1, 2].map(|rank| {
                with(
                    ranks.map(|ranks| ranks[rank]),
                    paper.map(|paper| paper[rank]),
                    3,
                )
            }));
            row.push(with(fid, paper.map(|paper| paper[3]), 3));
            row.push(with(diversity, paper.map(|paper| paper[4]), 2));
            row.push(with(matching, None, 3));
            rows.push(row);
        };
        add("Real motions", (real.0, [None, real.2, real.1]), None);
        for setting in &plan.methods {
            if let Some(figures) = self.of(&setting.name) {
                let others = [figures.fid, figures.diversity, figures.matching];
                add(
                    setting.method.title(),
                    (figures.r_precision, others),
                    paper::fidelity(setting.method),
                );
            }
        }
        self.blocks.extend([
            Block::heading("Text and fidelity"),
            Block::text(
                "R-precision in batches of 32 with distinct captions, FID against the real motions of the same sentences, Diversity, and the distance \
                 from a text to its motion; means over the eight tags. FID falls with the number of motions: it is to be compared within the table. \
                 Motions of edited prompts are held against the sentence as it was.",
            ),
            Block::table(["method", "top 1", "top 2", "top 3", "FID", "Diversity", "distance to text"], rows),
        ]);
        Ok(())
    }

    /// What no network judges.
    fn quality(&mut self, plan: &Plan) {
        let mut rows = Vec::new();
        for setting in &plan.methods {
            if let Some(figures) = self.of(&setting.name) {
                rows.push(vec![
                    setting.method.title().into(),
                    shown(figures.distance, 3),
                    shown(figures.sliding, 3),
                    shown(figures.ankles, 1),
                    shown(figures.jerk, 0),
                    shown(figures.drift, 3),
                    figures.error.map_or("–".into(), |error| shown(error, 3)),
                    format!(
                        "{} of {}",
                        figures.failed.len(),
                        figures.failed.len() + figures.motions
                    ),
                ]);
            }
        }
        self.blocks.extend([
            Block::heading("The motions themselves"),
            Block::text(
                "Mean distance of the joints from the motion of the sentence alone (m); share of steps in which a standing foot slides; second difference of the ankles \
                 (mm a frame²); jerk (m/s³); how far the worst bone is from its length (m); how far the component that was asked for is from what was asked, relative to \
                 the baseline; motions that could not be made.",
            ),
            Block::table(
                ["method", "distance", "sliding", "ankles", "jerk", "bone drift", "error", "failed"],
                rows,
            ),
        ]);
    }

    /// An ablation.
    fn study(
        &mut self,
        study: Study,
        rows: &[(String, Setting)],
        plan: &Plan,
        evidence: &Evidence<'_>,
    ) -> Result<(), ReportError> {
        self.blocks.push(Block::heading(study.title()));
        if study == Study::Interpolation {
            return self.interpolation(&plan.generated(&rows[0].1), evidence);
        }
        let mut table = Vec::new();
        let mut points: Vec<(f64, f64, Option<f64>)> = Vec::new();
        for (label, setting) in rows {
            // Over the sentences of the study alone, so that its rows can be compared.
            let Some(figures) = evidence.figures(&plan.generated(setting))? else {
                continue;
            };
            let (diagonality, diagonal) = match &figures.control {
                Some(Control {
                    mean, diagonality, ..
                }) => (
                    format!("{diagonality:.3}"),
                    (0..COMPONENTS)
                        .map(|i| format!("{:.2}", mean[i][i]))
                        .collect::<Vec<_>>()
                        .join(" "),
                ),
                None => ("–".into(), "–".into()),
            };
            let top = figures.r_precision.map(|ranks| ranks[2]);
            table.push(vec![
                label.clone(),
                diagonality,
                diagonal,
                figures.error.map_or("–".into(), |error| shown(error, 3)),
                top.map_or("–".into(), |top| shown(top, 3)),
                figures.fid.map_or("–".into(), |fid| shown(fid, 3)),
                shown(figures.distance, 3),
                shown(figures.jerk, 0),
                figures.failed.len().to_string(),
            ]);
            let number = label.split(' ').find_map(|word| word.parse::<f64>().ok());
            if let (Some(number), Some(error)) = (number, figures.error) {
                points.push((number, error.mean, top.map(|top| top.mean)));
            }
        }
        self.blocks.push(Block::table(
            [
                "",
                "diagonality",
                "diagonal",
                "error",
                "top 3",
                "FID",
                "distance",
                "jerk",
                "failed",
            ],
            table,
        ));
        if matches!(study, Study::Steps | Study::LearningRate) && points.len() > 1 {
            let line = |label, colour, values: Vec<[f64; 2]>| Line {
                label,
                points: values,
                colour,
                marked: true,
            };
            let errors = points.iter().map(|(x, error, _)| [*x, *error]);
            let tops = points.iter().filter_map(|(x, _, top)| Some([*x, (*top)?]));
            let (tops, errors): (Vec<_>, Vec<_>) = (tops.collect(), errors.collect());
            let axes = |label| {
                [
                    Axis {
                        label,
                        logarithmic: true,
                    },
                    Axis {
                        label: "",
                        logarithmic: false,
                    },
                ]
            };
            let label = match study {
                Study::Steps => "DDIM steps",
                _ => "learning rate",
            };
            let mut lines = vec![line("Laban error", COLOURS[0], errors)];
            if !tops.is_empty() {
                lines.push(line("R-precision, top 3", COLOURS[1], tops));
            }
            let svg = plot(study.title(), axes(label), &lines)?;
            let caption = format!("Laban error and R-precision by {label}");
            self.picture(study.title(), caption, svg);
        }
        Ok(())
    }

    fn interpolation(
        &mut self,
        setting: &Setting,
        evidence: &Evidence<'_>,
    ) -> Result<(), ReportError> {
        let ratios = evidence.ratios(setting);
        let mean = |component: Component, factor: f32| {
            ratios.iter().find_map(|(demand, mean)| {
                (*demand == Demand::Factor(component, factor)).then_some(*mean)
            })
        };
        let mut table = Vec::new();
        let mut lines = vec![Line {
            label: "asked",
            points: INTERPOLATION.map(|factor| [f64::from(factor); 2]).into(),
            colour: [156, 163, 175],
            marked: false,
        }];
        for component in Component::ALL {
            let found = INTERPOLATION.map(|factor| mean(component, factor));
            let place = component.index();
            let mut row = vec![NAMES[place].to_owned()];
            row.extend(found.map(|mean| mean.map_or("–".into(), |mean| shown(mean, 3))));
            table.push(row);
            let points = INTERPOLATION.iter().zip(found);
            let points = points.filter_map(|(factor, mean)| Some([f64::from(*factor), mean?.mean]));
            lines.push(Line {
                label: NAMES[place],
                points: points.collect(),
                colour: COLOURS[place],
                marked: true,
            });
        }
        let mut header = vec!["asked".to_owned()];
        header.extend(INTERPOLATION.map(|factor| format!("{factor}")));
        let axis = |label| Axis {
            label,
            logarithmic: false,
        };
        let svg = plot(
            "Scale interpolation",
            [axis("factor asked for"), axis("factor that came out")],
            &lines,
        )?;
        self.blocks.push(Block::text(
            "What came out, guided over baseline by the mean over time, when a component alone is asked for by a factor.",
        ));
        self.blocks.push(Block::Table {
            header,
            rows: table,
        });
        self.picture(
            "Scale interpolation",
            "The factor that came out over the one asked for".into(),
            svg,
        );
        Ok(())
    }

    /// One sentence with five factors on Weight, and on Shape.
    fn interpolation_strips(&mut self, plan: &Plan, work: &Work<'_>) -> Result<(), ReportError> {
        for component in [Component::Weight, Component::Shape] {
            let name = NAMES[component.index()];
            let prompt = &work.prompts[0];
            let request = |factor: f32| {
                let mut factors = [1.0; COMPONENTS];
                factors[component.index()] = factor;
                let scale = Scale::new(factors).expect("factors are finite");
                let guidance = plan.basis.preset.guidance();
                self.plain(plan, prompt).scale(scale).guidance(guidance)
            };
            let requests: Vec<Request> = INTERPOLATION.map(request).into();
            let made = work.source.model.generate_all(&requests)?;
            let labels =
                INTERPOLATION.map(|factor| format!("{}, {name} × {factor}", prompt.caption(0)));
            let rows = labels.iter().zip(&made).map(|(label, made)| Row {
                label,
                motion: &made.guided,
            });
            let svg = strip(&rows.collect::<Vec<_>>(), POSES);
            let title = format!("Interpolation of {name}");
            self.picture(&title, format!("{name} from half to one and a half"), svg);
        }
        Ok(())
    }

    fn plain(&self, plan: &Plan, prompt: &Prompt) -> Request {
        Request::new(prompt.caption(0))
            .frames(prompt.frames)
            .steps(plan.basis.steps)
    }

    /// A single motion with all its series.
    fn example(&mut self, plan: &Plan, work: &Work<'_>) -> Result<(), ReportError> {
        let prompt = &work.prompts[0];
        let scale = Scale::new([1.5, 1.0, 1.0, 1.0]).expect("factors are finite");
        let request = self.plain(plan, prompt).scale(scale);
        let made = work
            .source
            .model
            .generate(&request.guidance(plan.basis.preset.guidance()))?;
        let svg = curves(
            prompt.caption(0),
            &[
                Curve::baseline(&made.baseline_laban),
                Curve::target(&made.target),
                Curve::guided(&made.guided_laban),
            ],
        )?;
        self.blocks.push(Block::heading("One motion"));
        self.blocks.push(Block::text(format!(
            "\"{}\" with Weight × 1.5, the rest as it is: the paper's figure of text-only and fully conditioned generation.",
            prompt.caption(0)
        )));
        self.picture(
            "One motion",
            "Weight, Time, Flow and Shape over time".into(),
            svg,
        );
        Ok(())
    }

    /// What smoothing does to differences.
    fn smoothing(&mut self, plan: &Plan, work: &Work<'_>) -> Result<(), ReportError> {
        let made = work
            .source
            .model
            .generate(&self.plain(plan, &work.prompts[0]))?;
        let series = |smoothing: Smoothing| {
            let options = LabanOptions {
                smoothing,
                ..LabanOptions::default()
            };
            LabanSeries::of(&made.baseline, &options, work.device)
        };
        let (with, without) = (series(Smoothing::default()), series(Smoothing::None));
        let svg = curves(
            "with (red) and without smoothing",
            &[
                Curve {
                    label: "without",
                    ..Curve::baseline(&without)
                },
                Curve {
                    label: "with",
                    ..Curve::guided(&with)
                },
            ],
        )?;
        self.blocks.push(Block::heading("What smoothing does"));
        self.blocks.push(Block::text(
            "Laban features of one motion, and the velocity, acceleration and jerk of its root, with the Gaussian of 11 frames and variance 10 and without.",
        ));
        self.picture(
            "Smoothing",
            "Laban features with and without smoothing".into(),
            svg,
        );
        let smooth = smoothed(&roots(&made.baseline));
        let raw = roots(&made.baseline);
        for (order, name) in [(1, "velocity"), (2, "acceleration"), (3, "jerk")] {
            let line = |label, colour, positions: &[[f32; 3]]| Line {
                label,
                points: differences(positions, order),
                colour,
                marked: false,
            };
            let axis = |label| Axis {
                label,
                logarithmic: false,
            };
            let unit = ["m/s", "m/s²", "m/s³"][order - 1];
            let lines = [
                line("without", [107, 114, 128], &raw),
                line("with", [194, 65, 12], &smooth),
            ];
            let title = format!("Root {name}");
            let svg = plot(&title, [axis("seconds"), axis(unit)], &lines)?;
            self.picture(&title, format!("{title} with and without smoothing"), svg);
        }
        Ok(())
    }

    fn failures(&mut self) {
        /// As many as are named.
        const NAMED: usize = 20;
        let all: Vec<&(String, String)> = self
            .figures
            .iter()
            .flat_map(|figures| &figures.failed)
            .collect();
        if all.is_empty() {
            return;
        }
        let mut rows: Vec<Vec<String>> = all
            .iter()
            .take(NAMED)
            .map(|(id, reason)| vec![id.clone(), reason.clone()])
            .collect();
        if all.len() > NAMED {
            rows.push(vec![
                format!("and {} more", all.len() - NAMED),
                String::new(),
            ]);
        }
        self.blocks
            .push(Block::heading("Motions that could not be made"));
        self.blocks.push(Block::table(["motion", "why"], rows));
    }

    fn picture(&mut self, title: &str, caption: String, svg: String) {
        let name = title.to_lowercase().replace(' ', "-");
        self.blocks.push(Block::Picture { name, caption, svg });
    }
}

/// Poses of a strip.
const POSES: usize = 12;

/// What keeps a report from being made.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    #[error(transparent)]
    Metric(#[from] MetricError),
    #[error(transparent)]
    Picture(#[from] CurveError),
    #[error(transparent)]
    Generate(#[from] lamogen::Error),
}

/// A mean with its interval, where there is one.
fn shown(mean: Mean, digits: usize) -> String {
    let Mean { mean, interval } = mean;
    match interval > 0.0 {
        true => format!("{mean:.digits$} ± {interval:.digits$}"),
        false => format!("{mean:.digits$}"),
    }
}

fn write(path: &Path, text: &str) -> Result<(), Failure> {
    write_atomically(path, |file| file.write_all(text.as_bytes()))
        .map_err(|error| Failure::output(path, error))
}

/// Where the root is.
fn roots(motion: &Motion) -> Vec<[f32; 3]> {
    let frames = 0..motion.frames();
    frames
        .map(|frame| motion.position(frame, Joint::Pelvis))
        .collect()
}

/// The same, smoothed as Laban features are: the ends repeat.
fn smoothed(places: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let kernel = Gaussian::PAPER.kernel();
    let last = places.len() - 1;
    let reach = kernel.len() / 2;
    { 0..places.len() }
        .map(|frame| {
            let mut sum = [0.0; 3];
            for (offset, weight) in kernel.iter().enumerate() {
                let from = (frame + offset).saturating_sub(reach).min(last);
                for (sum, place) in sum.iter_mut().zip(places[from]) {
                    *sum += weight * place;
                }
            }
            sum
        })
        .collect()
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
        let smooth = smoothed(&line);
        for frame in 5..25 {
            assert!((smooth[frame][0] - line[frame][0]).abs() < 1e-5);
        }
        assert!(smooth[0][0] > 0.0, "the first frame repeats");
        assert_eq!(differences(&line, 3).len(), 27);
    }
}
