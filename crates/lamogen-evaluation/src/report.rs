//! The report: the tables of the paper with the figures of this model, the ablations (`studies.rs`), and pictures.

mod studies;

use std::io::Write;
use std::path::{Path, PathBuf};

use lamogen::motion::write_atomically;
use lamogen::{COMPONENTS, Preset};
use lamogen_eval::MetricError;
use lamogen_model::Denoiser;
use lamogen_view::PlotError;
use serde_json::{Map, Value, json};

use super::document::{ReportBlock, html, markdown};
use super::error::EvaluationError;
use super::judge::ScoreBasis;
use super::measure::MeasurementTarget;
use super::paper;
use super::pictures::ReportPictures;
use super::plan::{EvalPlan, Method, Study};
use super::runner::EvalRunner;
use super::summary::{
    BodyMeans, EvalData, FigureCache, MeanEstimate, RealMotionFigures, SettingFigures,
};

/// The names of the components in the tables.
const NAMES: [&str; COMPONENTS] = ["Weight", "Time", "Flow", "Shape"];
/// The colours of the components in the plots, as red, green and blue.
const COLOURS: [[u8; 3]; COMPONENTS] =
    [[194, 65, 12], [3, 105, 161], [22, 101, 52], [126, 34, 206]];

/// A report, ready to be written.
pub struct Report {
    title: String,
    blocks: Vec<ReportBlock>,
    figures: Vec<SettingFigures>,
    /// The figures of studies and real motions for `figures.json`.
    other_figures: Map<String, Value>,
}

impl Report {
    /// Computes the figures and draws the pictures. `missing` is the number of motions that are not generated yet; the
    /// report states it.
    pub fn new<D: Denoiser>(
        plan: &EvalPlan,
        data: &EvalData<'_>,
        runner: &EvalRunner<'_, D>,
        title: &str,
        missing: usize,
    ) -> Result<Report, ReportError> {
        let mut cache = FigureCache::new(data);
        let figures = plan.settings.iter();
        let figures = figures.map(|setting| cache.figures(setting).cloned());
        let figures = figures.collect::<Result<Vec<SettingFigures>, MetricError>>()?;
        let mut report = Report {
            title: title.to_owned(),
            blocks: Vec::new(),
            figures,
            other_figures: Map::new(),
        };
        report.add_introduction(plan, runner, missing);
        report.add_control(plan);
        let real = data.real_motion_figures()?;
        report
            .other_figures
            .insert("real_motions".into(), json!(real));
        let is_public = matches!(data.scores, ScoreBasis::Public(_));
        report.add_fidelity(plan, &real, is_public);
        report.add_quality(plan, &real);
        report.add_side_effects(plan);
        let pictures = ReportPictures::new(plan, runner);
        report.add_pictures(pictures.methods())?;
        report.blocks.push(ReportBlock::heading("One motion"));
        report.add_pictures(pictures.example())?;
        report.add_studies_introduction(plan);
        for (study, rows) in &plan.studies {
            report.blocks.push(ReportBlock::heading(study.title()));
            match study {
                Study::Interpolation => {
                    report.add_interpolation(&rows[0].1, data)?;
                    report.add_pictures(pictures.interpolation())?;
                }
                Study::Finish => {
                    report.add_study(*study, rows, plan, &mut cache)?;
                    report.add_pictures(pictures.study(*study, rows))?;
                }
                _ => report.add_study(*study, rows, plan, &mut cache)?,
            }
        }
        report
            .blocks
            .push(ReportBlock::heading("What smoothing does"));
        report.add_pictures(pictures.smoothing())?;
        report.add_failures();
        Ok(report)
    }

    /// Writes `report.md` with its pictures in `pictures/`, `report.html` and `figures.json`.
    pub fn write(&self, folder: &Path) -> Result<Vec<PathBuf>, EvaluationError> {
        const PICTURES: &str = "pictures";
        let pictures = folder.join(PICTURES);
        std::fs::create_dir_all(&pictures)
            .map_err(|error| EvaluationError::output(&pictures, error))?;
        let text = markdown(&self.title, &self.blocks, PICTURES);
        let page = html(&self.title, &self.blocks);
        let mut figures = self.other_figures.clone();
        figures.insert("settings".into(), json!(self.figures));
        let figures = format!("{:#}\n", Value::from(figures));
        for block in &self.blocks {
            if let ReportBlock::Picture { name, svg, .. } = block {
                write_file(&pictures.join(format!("{name}.svg")), svg)?;
            }
        }
        let files = [
            ("report.md", &text),
            ("report.html", &page),
            ("figures.json", &figures),
        ];
        let written = files.map(|(name, content)| {
            let path = folder.join(name);
            write_file(&path, content).map(|()| path)
        });
        written.into_iter().collect()
    }

    /// Returns the figures of the setting with this name.
    fn figures_of(&self, name: &str) -> Option<&SettingFigures> {
        self.figures.iter().find(|figures| figures.setting == name)
    }

    /// Adds the introduction: what the report is about, and how motions were generated and measured.
    fn add_introduction<D: Denoiser>(
        &mut self,
        plan: &EvalPlan,
        runner: &EvalRunner<'_, D>,
        missing: usize,
    ) {
        let prompts = runner.prompts.len();
        let repeats = match plan.repeats {
            1 => "one motion of each".into(),
            repeats => format!(
                "{repeats} motions of each, from {repeats} seeds; ± is the 95 % interval over these (in the table of control the deviation over motions)"
            ),
        };
        let temporal_smoothing = match runner
            .model
            .temporal_smoothing()
            .map(|smoothing| smoothing.frames)
        {
            Some(1.0) => "predictions smoothed by a Gaussian of one frame".into(),
            Some(frames) => format!("predictions smoothed by a Gaussian of {frames} frames"),
            None => "predictions as they are".into(),
        };
        let mut text = format!(
            "{prompts} sentences, {repeats}; preset {}, {} DDIM steps ({} for Laban guidance of the embedding, {} for start noise), {temporal_smoothing}. {} Laban features are compared by their maximum over time, as in the paper. \
             Figures of the paper, with MotionDiffuse on HumanML3D, stand in brackets.",
            plan.defaults.preset.name(),
            plan.defaults.steps(),
            plan.defaults.steps_of(Preset::Fast),
            plan.defaults.noise_steps,
            match runner.measure {
                MeasurementTarget::Rig =>
                    "Everything is measured on what users get (`--measure rig`): every motion, real ones too, is written as BVH and read back.",
                MeasurementTarget::Joints =>
                    "Motions are measured on their joints as generated (`--measure joints`), whose bones change their length unless the preset has a rigid body; what turns, on the rotations that would be written.",
            }
        );
        if missing > 0 {
            text.push_str(&format!(
                "\n\n{missing} motions are not made yet; the figures are of the others."
            ));
        }
        self.blocks.push(ReportBlock::text(text));
    }

    /// Adds the table of control (table 1 of the paper).
    fn add_control(&mut self, plan: &EvalPlan) {
        let mut rows = Vec::new();
        for setting in &plan.methods {
            if setting.method == Method::Text {
                continue;
            }
            let figures = self.figures_of(&setting.name);
            let Some(control) = figures.and_then(|figures| figures.control.as_ref()) else {
                let mut row = vec![setting.method.title().to_owned(), String::new()];
                row.resize(row.len() + COMPONENTS + 1, NO_VALUE.into());
                rows.push(row);
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
                    format!("{} ± {std:.3}{paper}", format_number(mean, 3))
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
            ReportBlock::heading("Control"),
            ReportBlock::text(
                "Mean relative change (large - small) / small of every component when one is asked for by its two tags, with the standard deviation \
                 over motions. The tags ask for 2.0 of Weight and Shape and for 0.5 of Time and Flow. Diagonality is the share of the squares on the diagonal. \
                 Laban guidance has the numbers of its preset, that of the embedding and start noise those of the preset fast; raw frame update and \
                 classifier guidance have the paper's numbers, and its loss relative to each frame, without emphasis.",
            ),
            ReportBlock::table(["method", "asked", "Weight", "Time", "Flow", "Shape", "diagonality"], rows),
        ]);
    }

    /// Adds the table of text and fidelity (table 2 of the paper).
    fn add_fidelity(&mut self, plan: &EvalPlan, real: &RealMotionFigures, is_public: bool) {
        let with = |value: Option<MeanEstimate>, paper: Option<f64>, digits: usize| match value {
            None => NO_VALUE.to_owned(),
            Some(_) => {
                let paper = paper.map_or(String::new(), |paper| format!(" ({paper:.digits$})"));
                format!("{}{paper}", format_mean(value, digits))
            }
        };
        let row = |title: &str, figures: &TextFigures, paper: Option<[f64; 5]>| {
            let of_paper = |place: usize| paper.map(|paper| paper[place]);
            let mut row = vec![title.to_owned()];
            row.extend([0, 1, 2].map(|rank| {
                let value = figures.r_precision.map(|ranks| ranks[rank]);
                with(value, of_paper(rank), 3)
            }));
            row.push(with(figures.fid, of_paper(3), 3));
            row.push(with(figures.diversity, of_paper(4), 2));
            row.push(with(figures.matching, None, 3));
            if is_public {
                row.push(with(figures.multimodality, None, 3));
            }
            row
        };
        let mut rows = vec![row(
            "Real motions",
            &TextFigures {
                r_precision: real.r_precision,
                fid: real.fid,
                diversity: real.diversity,
                matching: real.matching,
                multimodality: None,
            },
            None,
        )];
        for setting in &plan.methods {
            if let Some(figures) = self.figures_of(&setting.name) {
                let text_figures = TextFigures {
                    r_precision: figures.r_precision,
                    fid: figures.fid,
                    diversity: figures.diversity,
                    matching: figures.matching,
                    multimodality: figures.multimodality,
                };
                let paper = paper::fidelity(setting.method);
                rows.push(row(setting.method.title(), &text_figures, paper));
            }
        }
        let text = match is_public {
            true => PUBLIC_FIDELITY,
            false => {
                "R-precision in batches of 32 with distinct captions, FID against the real motions of the same sentences, Diversity (of up to 300 motions \
                 over all pairs, of more over 300), and the distance from a text to its motion; means over the eight tags. FID falls with the number of motions: it is to be compared within the table. \
                 That of the real motions is theirs to as many real motions of other sentences (of the other splits; ± is the 95 % interval over sets), and shows what the choice of sentences alone makes of it. \
                 Motions of edited prompts are held against the sentence as it was."
            }
        };
        let mut header = vec![
            "method",
            "top 1",
            "top 2",
            "top 3",
            "FID",
            "Diversity",
            "distance to text",
        ];
        if is_public {
            header[6] = "MM-Dist";
            header.push("MultiModality");
        }
        self.blocks.extend([
            ReportBlock::heading("Text and fidelity"),
            ReportBlock::text(text),
            ReportBlock::Table {
                header: header.into_iter().map(str::to_owned).collect(),
                rows,
            },
        ]);
    }

    /// Adds the table of measurements that need no evaluator.
    fn add_quality(&mut self, plan: &EvalPlan, real: &RealMotionFigures) {
        let row = |title: &str, distance, bodies: &BodyMeans, error, failed: String| {
            vec![
                title.to_owned(),
                format_mean(distance, 3),
                format_mean(bodies.sliding, 3),
                format_mean(bodies.sliding_speed, 2),
                format_mean(bodies.ankles, 1),
                format_mean(bodies.jerk, 0),
                format_mean(bodies.drift, 3),
                format_mean(bodies.below_floor, 3),
                format_mean(bodies.turning.mean, 2),
                format_mean(bodies.turning.largest, 0),
                bodies.turning.pelvis_snaps.to_string(),
                format_mean(error, 3),
                failed,
            ]
        };
        let mut rows = vec![row(
            "Real motions",
            None,
            &real.bodies,
            None,
            NO_VALUE.into(),
        )];
        for setting in &plan.methods {
            if let Some(figures) = self.figures_of(&setting.name) {
                let failed = figures.failed.len();
                rows.push(row(
                    setting.method.title(),
                    figures.distance,
                    &figures.bodies,
                    figures.error,
                    format!("{failed} of {}", failed + figures.motions),
                ));
            }
        }
        self.blocks.extend([
            ReportBlock::heading("The motions themselves"),
            ReportBlock::text(
                "Mean distance of the joints from the motion of the sentence alone (m); share of steps in which a standing foot slides, and how fast standing feet move (m/s); \
                 second difference of the ankles (mm a frame²); jerk (m/s³); how far the worst bone is from its length (m); how deep the deepest joint is below the floor (m, but \
                 for a frame in a hundred); how far joints turn from one frame to the next, in the frame of the joint they hang from (degrees): all but the pelvis on average, and the \
                 largest turn of a motion; how often the pelvis turns by more than 60° between two frames, in all motions together; how far the component that was asked for is from what was asked, relative to \
                 the baseline; motions that could not be made.",
            ),
            ReportBlock::table(
                [
                    "method",
                    "distance",
                    "sliding",
                    "sliding speed",
                    "ankles",
                    "jerk",
                    "bone drift",
                    "below floor",
                    "turning",
                    "largest turn",
                    "pelvis snaps",
                    "error",
                    "failed",
                ],
                rows,
            ),
        ]);
    }

    /// Adds the table of side effects and worst motions.
    fn add_side_effects(&mut self, plan: &EvalPlan) {
        let mut rows = Vec::new();
        for setting in &plan.methods {
            let Some(figures) = self.figures_of(&setting.name) else {
                continue;
            };
            let Some(side_effects) = figures.side_effects else {
                continue;
            };
            for (place, worst) in figures.worst.iter().enumerate() {
                let method_cells = match place {
                    0 => [
                        setting.method.title().to_owned(),
                        format_mean(Some(side_effects.mean), 3),
                        format!("{:.3}", side_effects.percentile_95),
                    ],
                    _ => [const { String::new() }; 3],
                };
                let tag_cells = [
                    worst.condition.clone(),
                    format!("{:.2}", worst.ratio),
                    format_number(worst.share, 2),
                    worst.prompt.clone(),
                ];
                rows.push(method_cells.into_iter().chain(tag_cells).collect());
            }
        }
        if rows.is_empty() {
            return;
        }
        self.blocks.extend([
            ReportBlock::heading("What stays, and the worst motion"),
            ReportBlock::text(
                "How much the components change that were not asked for: guided over baseline, less 1, without its sign, on average, and what 95 of 100 of these changes are below. \
                 For every tag the motion that follows it least: guided over baseline, and how much of the change that was asked for this is (1 is all of it, 0 nothing, below 0 it went the other way). \
                 All by the maximum over time.",
            ),
            ReportBlock::table(["method", "others change", "95 % below", "tag", "worst ratio", "share", "sentence"], rows),
        ]);
    }

    /// Adds the table of motions that could not be generated.
    fn add_failures(&mut self) {
        /// The largest number of motions that the table lists.
        const MAX_LISTED: usize = 20;
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
            .take(MAX_LISTED)
            .map(|(id, reason)| vec![id.clone(), reason.clone()])
            .collect();
        if all.len() > MAX_LISTED {
            rows.push(vec![
                format!("and {} more", all.len() - MAX_LISTED),
                String::new(),
            ]);
        }
        self.blocks
            .push(ReportBlock::heading("Motions that could not be made"));
        self.blocks
            .push(ReportBlock::table(["motion", "why"], rows));
    }

    /// Adds pictures. If a motion for them cannot be generated, a sentence is added instead, so that the report is still
    /// written.
    fn add_pictures(
        &mut self,
        pictures: Result<Vec<ReportBlock>, ReportError>,
    ) -> Result<(), ReportError> {
        match pictures {
            Ok(blocks) => self.blocks.extend(blocks),
            Err(ReportError::Generate(error)) => {
                let text = format!("The motions to be shown here could not be made: {error}.");
                self.blocks.push(ReportBlock::text(text));
            }
            Err(error) => return Err(error),
        }
        Ok(())
    }
}

/// Why a report cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    #[error(transparent)]
    Metric(#[from] MetricError),
    #[error(transparent)]
    Picture(#[from] PlotError),
    #[error(transparent)]
    Generate(#[from] lamogen::Error),
}

/// The figures of a row of the table of text and fidelity.
struct TextFigures {
    r_precision: Option<[MeanEstimate; 3]>,
    fid: Option<MeanEstimate>,
    diversity: Option<MeanEstimate>,
    matching: Option<MeanEstimate>,
    multimodality: Option<MeanEstimate>,
}

/// What the table of text and fidelity says of the public evaluation.
const PUBLIC_FIDELITY: &str = "The paper's table 2, by the public evaluation of HumanML3D with the evaluator that it publishes (Guo et al. 2022). In each repeat every motion of the split \
    has one of its captions and a length that is a multiple of 4 frames, both drawn anew; motions are generated for these. R-precision and MM-Dist (the distance from a text to its motion) are those of \
    batches of 32 in a drawn order; the last batch is dropped, and FID and Diversity are of the others. FID is against real motions with cuts of another draw, also in the first row. \
    Diversity is the mean distance of 300 drawn pairs (of 300 motions and fewer, of all pairs), MultiModality that of 10 drawn pairs of motions of one text (of 10 motions and fewer, of all pairs). \
    ± is 1.96 σ / √n over the repeats. Rows with tags are means over the eight tags; in MultiModality each text has one tag, in turn. Motions of edited prompts are held against the sentence as it was.";

/// The text of a table cell without a value.
const NO_VALUE: &str = "–";

/// Formats a number; a negative number that is rounded to zero has no sign.
fn format_number(number: f64, digits: usize) -> String {
    let text = format!("{number:.digits$}");
    match text.strip_prefix('-') {
        Some(zero) if zero.chars().all(|c| "0.".contains(c)) => zero.into(),
        _ => text,
    }
}

/// Formats a mean with its interval, if it has one.
fn format_mean(mean: Option<MeanEstimate>, digits: usize) -> String {
    let Some(MeanEstimate { mean, interval }) = mean else {
        return NO_VALUE.into();
    };
    match interval {
        Some(interval) => format!("{mean:.digits$} ± {interval:.digits$}"),
        None => format!("{mean:.digits$}"),
    }
}

/// Writes a text file. An error leaves no incomplete file.
fn write_file(path: &Path, text: &str) -> Result<(), EvaluationError> {
    write_atomically(path, |file| file.write_all(text.as_bytes()))
        .map_err(|error| EvaluationError::output(path, error))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_that_are_rounded_to_zero_have_no_sign() {
        assert_eq!(format_number(-0.0004, 3), "0.000");
        assert_eq!(format_number(-0.0006, 3), "-0.001");
        assert_eq!(format_number(-10.0, 0), "-10");
    }
}
