//! The report: the paper's tables beside this model's, the ablations (`studies.rs`), and pictures.

mod studies;

use std::io::Write;
use std::path::{Path, PathBuf};

use lamogen::motion::write_atomically;
use lamogen::{COMPONENTS, Preset};
use lamogen_eval::MetricError;
use lamogen_view::CurveError;
use serde_json::{Map, Value, json};

use super::document::{Block, html, markdown};
use super::measure::Measure;
use super::paper;
use super::pictures::Shown;
use super::plan::{Method, Plan, Study};
use super::summary::{Bodies, Evidence, Figures, Known, Mean, OfReal};
use super::work::Work;
use crate::failure::Failure;
use crate::source::EMBEDDED;

/// Names of the components, as the tables have them.
const NAMES: [&str; COMPONENTS] = ["Weight", "Time", "Flow", "Shape"];
const COLOURS: [[u8; 3]; COMPONENTS] =
    [[194, 65, 12], [3, 105, 161], [22, 101, 52], [126, 34, 206]];

/// A report, ready to be written.
pub struct Report {
    title: String,
    blocks: Vec<Block>,
    figures: Vec<Figures>,
    /// What `figures.json` holds of studies and real motions.
    others: Map<String, Value>,
}

impl Report {
    /// Computes everything. Motions that are `missing` are said to be.
    pub fn new(
        plan: &Plan,
        evidence: &Evidence<'_>,
        work: &Work<'_>,
        missing: usize,
    ) -> Result<Report, ReportError> {
        let mut known = Known::new(evidence);
        let figures = plan.settings.iter();
        let figures = figures.map(|setting| known.figures(setting).cloned());
        let figures = figures.collect::<Result<Vec<Figures>, MetricError>>()?;
        let mut report = Report {
            title: match work.source.name.as_str() {
                EMBEDDED => "Report on the embedded model".into(),
                name => format!("Report on the model {name}"),
            },
            blocks: Vec::new(),
            figures,
            others: Map::new(),
        };
        report.basis(plan, work, missing);
        report.control(plan);
        let real = evidence.of_real()?;
        report.others.insert("real_motions".into(), json!(real));
        report.fidelity(plan, &real);
        report.quality(plan, &real);
        report.stays(plan);
        let shown = Shown::new(plan, work);
        report.pictures(shown.methods())?;
        report.blocks.push(Block::heading("One motion"));
        report.pictures(shown.example())?;
        report.studies(plan);
        for (study, rows) in &plan.studies {
            report.blocks.push(Block::heading(study.title()));
            match study {
                Study::Interpolation => {
                    report.interpolation(&rows[0].1, evidence)?;
                    report.pictures(shown.interpolation())?;
                }
                Study::Finish => {
                    report.study(*study, rows, plan, &mut known)?;
                    report.pictures(shown.study(*study, rows))?;
                }
                _ => report.study(*study, rows, plan, &mut known)?,
            }
        }
        report.blocks.push(Block::heading("What smoothing does"));
        report.pictures(shown.smoothing())?;
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
        let mut figures = self.others.clone();
        figures.insert("settings".into(), json!(self.figures));
        let figures = format!("{:#}\n", Value::from(figures));
        for block in &self.blocks {
            if let Block::Picture { name, svg, .. } = block {
                write(&pictures.join(format!("{name}.svg")), svg)?;
            }
        }
        let files = [
            ("report.md", &text),
            ("report.html", &page),
            ("figures.json", &figures),
        ];
        let written = files.map(|(name, content)| {
            let path = folder.join(name);
            write(&path, content).map(|()| path)
        });
        written.into_iter().collect()
    }

    fn of(&self, name: &str) -> Option<&Figures> {
        self.figures.iter().find(|figures| figures.setting == name)
    }

    fn basis(&mut self, plan: &Plan, work: &Work<'_>, missing: usize) {
        let prompts = work.prompts.len();
        let repeats = match plan.repeats {
            1 => "one motion of each".into(),
            repeats => format!(
                "{repeats} motions of each, from {repeats} seeds; ± is the 95 % interval over these (in the table of control the deviation over motions)"
            ),
        };
        let temporal_smoothing = match work.source.temporal_smoothing_frames() {
            Some(1.0) => "predictions smoothed by a Gaussian of one frame".into(),
            Some(frames) => format!("predictions smoothed by a Gaussian of {frames} frames"),
            None => "predictions as they are".into(),
        };
        let mut text = format!(
            "{prompts} sentences, {repeats}; preset {}, {} DDIM steps ({} for Laban guidance of the embedding, {} for start noise), {temporal_smoothing}. {} Laban features are compared by their maximum over time, as in the paper. \
             Figures of the paper, with MotionDiffuse on HumanML3D, stand in brackets.",
            plan.basis.preset.name(),
            plan.basis.steps(),
            plan.basis.steps_of(Preset::Fast),
            plan.basis.noise_steps,
            match work.measure {
                Measure::Rig =>
                    "Everything is measured on what users get (`--measure rig`): every motion, real ones too, is written as BVH and read back.",
                Measure::Joints =>
                    "Motions are measured on their joints as generated, whose bones change their length (`--measure joints`); what turns, on the rotations that would be written.",
            }
        );
        if missing > 0 {
            text.push_str(&format!(
                "\n\n{missing} motions are not made yet; the figures are of the others."
            ));
        }
        self.blocks.push(Block::text(text));
    }

    /// The paper's table 1.
    fn control(&mut self, plan: &Plan) {
        let mut rows = Vec::new();
        for setting in &plan.methods {
            if setting.method == Method::Text {
                continue;
            }
            let figures = self.of(&setting.name);
            let Some(control) = figures.and_then(|figures| figures.control.as_ref()) else {
                let mut row = vec![setting.method.title().to_owned(), String::new()];
                row.resize(row.len() + COMPONENTS + 1, NOTHING.into());
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
                    format!("{} ± {std:.3}{paper}", rounded(mean, 3))
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
                 over motions. The tags ask for 2.0 of Weight and Shape and for 0.5 of Time and Flow. Diagonality is the share of the squares on the diagonal. \
                 Laban guidance has the numbers of its preset, that of the embedding and start noise those of the preset fast; raw frame update and \
                 classifier guidance have the paper's numbers, and its loss relative to each frame, without emphasis.",
            ),
            Block::table(["method", "asked", "Weight", "Time", "Flow", "Shape", "diagonality"], rows),
        ]);
    }

    /// The paper's table 2.
    fn fidelity(&mut self, plan: &Plan, real: &OfReal) {
        let with = |value: Option<Mean>, paper: Option<f64>, digits: usize| match value {
            None => NOTHING.to_owned(),
            Some(_) => {
                let paper = paper.map_or(String::new(), |paper| format!(" ({paper:.digits$})"));
                format!("{}{paper}", shown(value, digits))
            }
        };
        let mut rows = Vec::new();
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
        let others = [None, real.diversity, real.matching];
        add("Real motions", (real.r_precision, others), None);
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
                "R-precision in batches of 32 with distinct captions, FID against the real motions of the same sentences, Diversity (of up to 300 motions \
                 over all pairs, of more over 300), and the distance from a text to its motion; means over the eight tags. FID falls with the number of motions: it is to be compared within the table. \
                 Motions of edited prompts are held against the sentence as it was.",
            ),
            Block::table(["method", "top 1", "top 2", "top 3", "FID", "Diversity", "distance to text"], rows),
        ]);
    }

    /// What no network judges.
    fn quality(&mut self, plan: &Plan, real: &OfReal) {
        let row = |title: &str, distance, bodies: &Bodies, error, failed: String| {
            vec![
                title.to_owned(),
                shown(distance, 3),
                shown(bodies.sliding, 3),
                shown(bodies.sliding_speed, 2),
                shown(bodies.ankles, 1),
                shown(bodies.jerk, 0),
                shown(bodies.drift, 3),
                shown(bodies.below_floor, 3),
                shown(bodies.turning.mean, 2),
                shown(bodies.turning.largest, 0),
                bodies.turning.pelvis_snaps.to_string(),
                shown(error, 3),
                failed,
            ]
        };
        let mut rows = vec![row(
            "Real motions",
            None,
            &real.bodies,
            None,
            NOTHING.into(),
        )];
        for setting in &plan.methods {
            if let Some(figures) = self.of(&setting.name) {
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
            Block::heading("The motions themselves"),
            Block::text(
                "Mean distance of the joints from the motion of the sentence alone (m); share of steps in which a standing foot slides, and how fast standing feet move (m/s); \
                 second difference of the ankles (mm a frame²); jerk (m/s³); how far the worst bone is from its length (m); how deep the deepest joint is below the floor (m, but \
                 for a frame in a hundred); how far joints turn from one frame to the next, in the frame of the joint they hang from (degrees): all but the pelvis on average, and the \
                 largest turn of a motion; how often the pelvis turns by more than 60° between two frames, in all motions together; how far the component that was asked for is from what was asked, relative to \
                 the baseline; motions that could not be made.",
            ),
            Block::table(
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

    /// What guidance leaves alone, and where it does least.
    fn stays(&mut self, plan: &Plan) {
        let mut rows = Vec::new();
        for setting in &plan.methods {
            let Some(figures) = self.of(&setting.name) else {
                continue;
            };
            let Some(stays) = figures.stays else {
                continue;
            };
            for (place, worst) in figures.worst.iter().enumerate() {
                let of_method = match place {
                    0 => [
                        setting.method.title().to_owned(),
                        shown(Some(stays.mean), 3),
                        format!("{:.3}", stays.most),
                    ],
                    _ => [const { String::new() }; 3],
                };
                let of_tag = [
                    worst.demand.clone(),
                    format!("{:.2}", worst.ratio),
                    rounded(worst.share, 2),
                    worst.prompt.clone(),
                ];
                rows.push(of_method.into_iter().chain(of_tag).collect());
            }
        }
        if rows.is_empty() {
            return;
        }
        self.blocks.extend([
            Block::heading("What stays, and the worst motion"),
            Block::text(
                "How much the components change that were not asked for: guided over baseline, less 1, without its sign, on average, and what 95 of 100 of these changes are below. \
                 For every tag the motion that follows it least: guided over baseline, and how much of the change that was asked for this is (1 is all of it, 0 nothing, below 0 it went the other way). \
                 All by the maximum over time.",
            ),
            Block::table(["method", "others change", "95 % below", "tag", "worst ratio", "share", "sentence"], rows),
        ]);
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

    /// Adds what is shown; a motion that cannot be made leaves a sentence, and no report behind.
    fn pictures(&mut self, shown: Result<Vec<Block>, ReportError>) -> Result<(), ReportError> {
        match shown {
            Ok(blocks) => self.blocks.extend(blocks),
            Err(ReportError::Generate(error)) => {
                let text = format!("The motions to be shown here could not be made: {error}.");
                self.blocks.push(Block::text(text));
            }
            Err(error) => return Err(error),
        }
        Ok(())
    }
}

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

/// What stands where nothing could be measured.
const NOTHING: &str = "–";

/// A number without the sign of one that is rounded to nothing.
fn rounded(number: f64, digits: usize) -> String {
    let text = format!("{number:.digits$}");
    match text.strip_prefix('-') {
        Some(zero) if zero.chars().all(|c| "0.".contains(c)) => zero.into(),
        _ => text,
    }
}

/// A mean with its interval, where there is one.
fn shown(mean: Option<Mean>, digits: usize) -> String {
    let Some(Mean { mean, interval }) = mean else {
        return NOTHING.into();
    };
    match interval {
        Some(interval) => format!("{mean:.digits$} ± {interval:.digits$}"),
        None => format!("{mean:.digits$}"),
    }
}

fn write(path: &Path, text: &str) -> Result<(), Failure> {
    write_atomically(path, |file| file.write_all(text.as_bytes()))
        .map_err(|error| Failure::output(path, error))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_has_no_sign() {
        assert_eq!(rounded(-0.0004, 3), "0.000");
        assert_eq!(rounded(-0.0006, 3), "-0.001");
        assert_eq!(rounded(-10.0, 0), "-10");
    }
}
