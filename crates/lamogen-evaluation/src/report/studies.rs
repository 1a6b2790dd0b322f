//! The ablations (studies): a table for each, and a plot for some.

use lamogen::{COMPONENTS, Component};
use lamogen_view::{PlotAxis, PlotLine, plot};
use serde_json::json;

use super::super::document::ReportBlock;
use super::super::plan::{EvalPlan, INTERPOLATION, Method, MethodSetting, PlanDefaults, Study};
use super::super::summary::{ControlTable, EvalData, FactorRatio, FigureCache, SettingFigures};
use super::{COLOURS, NAMES, NO_VALUE, Report, ReportError, format_mean, format_number};

/// Returns the text that explains the table of a study.
fn study_note(study: Study, defaults: &PlanDefaults) -> Option<String> {
    let text = match study {
        // `add_interpolation` adds a text itself.
        Study::Interpolation => return None,
        Study::LearningRate => {
            let guidance = defaults.preset.guidance();
            let times = guidance.final_learning_rate? / guidance.learning_rate;
            return Some(format!(
                "The rate of the first step; it goes to {times} times that over the steps, as in the preset."
            ));
        }
        Study::Presets => {
            let steps = match defaults.given_steps {
                Some(_) => " but for its steps, which were given",
                None => "",
            };
            return Some(format!(
                "Precise moves scales and shifts, then the finished motion; fast and paper move the embedding. Paper has the paper's numbers{steps}, and its loss \
                 relative to each frame."
            ));
        }
        Study::ParetoFront => {
            "What is moved: the embedding, the scales and shifts that it becomes in every layer (modulation), these and then the finished motion (with a finish), or what the \
             rivals move, with their numbers of the tables above. Emphasis is how much the component that is asked for counts in the loss beside the others, here the \
             same for all four."
        }
        Study::Rise => "From the first step to the last, along half a cosine.",
        Study::Steps => "Every step is an update too.",
        Study::Update => {
            "Lagged: the step is made with the evaluation that the gradient came from, and what is moved acts from the next one on."
        }
        Study::Updates => "Of what is moved, at every DDIM step.",
        Study::Finish => {
            "So many small updates of the motion itself, with the same loss, after the guided pass or instead of it."
        }
        Study::Divisor => {
            "The difference to the target, relative to the baseline at the frame (as in the paper) or to its mean over time; the same of the rival raw frame update."
        }
        Study::Smoothing => {
            "What guidance measures: positions smoothed once, before each difference, or as they are. All rows are judged with the first."
        }
    };
    Some(text.into())
}

impl Report {
    /// Adds the text that introduces the studies.
    pub(super) fn add_studies_introduction(&mut self, plan: &EvalPlan) {
        let mut rows = plan.studies.iter().flat_map(|(_, rows)| rows);
        let Some((_, first)) = rows.next() else {
            return;
        };
        self.blocks.push(ReportBlock::heading("The studies"));
        self.blocks.push(ReportBlock::text(format!(
            "Each changes one thing of Laban guidance, over {} of the sentences and all eight tags. Diagonal is what the tags of Weight, Time, Flow and Shape change of their own \
             component, of the 2.0, 0.5, 0.5 and 2.0 that they ask for; the other columns are those of the tables above, over these sentences alone. Text alone is sampled in {} \
             steps: where a row has another number of them, that too makes a difference, to jerk above all.",
            first.prompts.iter().count(),
            plan.defaults.steps()
        )));
    }

    /// Adds the table and the plots of a study. `rows` are the labels and settings of its rows.
    pub(super) fn add_study(
        &mut self,
        study: Study,
        rows: &[(String, MethodSetting)],
        plan: &EvalPlan,
        cache: &mut FigureCache<'_>,
    ) -> Result<(), ReportError> {
        if let Some(note) = study_note(study, &plan.defaults) {
            self.blocks.push(ReportBlock::text(note));
        }
        let mut table = Vec::new();
        let (mut numbers, mut measured) = (Vec::new(), Vec::new());
        let mut points: Vec<(f64, f64, Option<f64>)> = Vec::new();
        // The first row is the text alone, over the sentences of the study.
        let text = plan
            .defaults
            .method_setting(Method::Text, rows[0].1.prompts);
        let text = [("text alone".to_owned(), text)];
        for (label, setting) in text.iter().chain(rows) {
            let figures = cache.figures(setting)?.clone();
            let (diagonality, diagonal) = match &figures.control {
                Some(ControlTable {
                    mean, diagonality, ..
                }) => (
                    format!("{diagonality:.3}"),
                    (0..COMPONENTS)
                        .map(|i| format_number(mean[i][i], 2))
                        .collect::<Vec<_>>()
                        .join(" "),
                ),
                None => (NO_VALUE.into(), NO_VALUE.into()),
            };
            let top = figures.r_precision.map(|ranks| ranks[2]);
            table.push(vec![
                label.clone(),
                diagonality,
                diagonal,
                format_mean(figures.error, 3),
                format_mean(top, 3),
                format_mean(figures.fid, 3),
                format_mean(figures.distance, 3),
                format_mean(figures.bodies.jerk, 0),
                format_mean(figures.bodies.drift, 3),
                figures.failed.len().to_string(),
            ]);
            let number = label.split(' ').find_map(|word| word.parse::<f64>().ok());
            if let (Some(number), Some(error)) = (number, figures.error) {
                points.push((number, error.mean, top.map(|top| top.mean)));
            }
            numbers.push(json!({ "row": label, "figures": figures }));
            measured.push(figures);
        }
        let measured = &measured[text.len()..];
        self.other_figures
            .insert(study.title().into(), numbers.into());
        self.blocks.push(ReportBlock::table(
            [
                "",
                "diagonality",
                "diagonal",
                "error",
                "top 3",
                "FID",
                "distance",
                "jerk",
                "bone drift",
                "failed",
            ],
            table,
        ));
        if study == Study::ParetoFront {
            self.add_front(rows, measured)?;
        }
        let axis = match study {
            Study::Steps => "DDIM steps",
            Study::LearningRate => "learning rate",
            _ => return Ok(()),
        };
        let errors = points.iter().map(|(x, error, _)| [*x, *error]);
        let tops = points.iter().filter_map(|(x, _, top)| Some([*x, (*top)?]));
        self.add_curve("Laban error", axis, COLOURS[0], errors.collect())?;
        self.add_curve("R-precision, top 3", axis, COLOURS[1], tops.collect())
    }

    /// Adds a plot of a figure over the number that the study varies, if there are at least two points.
    fn add_curve(
        &mut self,
        figure: &str,
        axis: &str,
        colour: [u8; 3],
        points: Vec<[f64; 2]>,
    ) -> Result<(), ReportError> {
        if points.len() < 2 {
            return Ok(());
        }
        let line = PlotLine {
            label: "",
            points,
            colour,
            marked: true,
        };
        let title = format!("{figure}, by {axis}");
        let axes = [PlotAxis::logarithmic(axis), PlotAxis::linear(figure)];
        let svg = plot(&title, axes, &[line])?;
        let name = title.replace(',', "");
        self.blocks.push(ReportBlock::picture(&name, title, svg));
        Ok(())
    }

    /// Adds the plot of the Pareto front: diagonality (the share of the squared changes on the diagonal of the table of
    /// control) over the distance from the requested factor. Each line connects the emphases of one method.
    fn add_front(
        &mut self,
        rows: &[(String, MethodSetting)],
        figures: &[SettingFigures],
    ) -> Result<(), ReportError> {
        let line = |label: &'static str, colour| {
            let rows = rows.iter().zip(figures);
            // The label of a row begins with that of its line; the emphasis follows after a comma.
            let rows = rows.filter(|((row, _), _)| row.split(',').next() == Some(label));
            let points = rows.filter_map(|(_, figures)| {
                let control = figures.control.as_ref()?;
                Some([figures.error?.mean, control.diagonality])
            });
            PlotLine {
                label,
                points: points.collect(),
                colour,
                marked: true,
            }
        };
        let axes = [
            PlotAxis::logarithmic("distance from what was asked"),
            PlotAxis::linear("diagonality"),
        ];
        let lines = [
            line("embedding", [213, 94, 0]),
            line("modulation", [0, 114, 178]),
            line("modulation with a finish", [17, 24, 39]),
            line("modulation and body", [230, 159, 0]),
            line("finished motion", [0, 158, 115]),
            line("predicted motion", [156, 163, 175]),
            line("start noise", [204, 121, 167]),
        ];
        let lines = lines.into_iter().filter(|line| !line.points.is_empty());
        let lines: Vec<PlotLine<'_>> = lines.collect();
        let title = Study::ParetoFront.title();
        let svg = plot(title, axes, &lines)?;
        let caption = "Diagonality over the distance from what was asked; each line goes from little emphasis on the right to much on the left";
        self.blocks.push(ReportBlock::picture(title, caption, svg));
        Ok(())
    }

    /// Adds the table and the plot of the factors that were reached.
    pub(super) fn add_interpolation(
        &mut self,
        setting: &MethodSetting,
        data: &EvalData<'_>,
    ) -> Result<(), ReportError> {
        let ratios = data.factor_ratios(setting);
        let find_ratio = |component: Component, factor: f32| {
            let mut ratios = ratios.iter();
            ratios.find(|ratio| (ratio.component, ratio.asked) == (component, factor))
        };
        let mut table = Vec::new();
        let mut lines = vec![PlotLine {
            label: "asked",
            points: INTERPOLATION.map(|factor| [f64::from(factor); 2]).into(),
            colour: [156, 163, 175],
            marked: false,
        }];
        for component in Component::ALL {
            let ratios = INTERPOLATION.map(|factor| find_ratio(component, factor));
            let place = component.index();
            let mut row = vec![NAMES[place].to_owned()];
            let cell = |ratio: &FactorRatio| format!("{:.3}", ratio.reached);
            row.extend(ratios.map(|ratio| ratio.map_or(NO_VALUE.into(), cell)));
            table.push(row);
            let points = ratios.iter().flatten();
            let points = points.map(|ratio| [f64::from(ratio.asked), ratio.reached]);
            lines.push(PlotLine {
                label: NAMES[place],
                points: points.collect(),
                colour: COLOURS[place],
                marked: true,
            });
        }
        let mut header = vec!["asked".to_owned()];
        header.extend(INTERPOLATION.map(|factor| format!("{factor}")));
        let svg = plot(
            "Scale interpolation",
            [
                PlotAxis::linear("factor asked for"),
                PlotAxis::linear("factor that came out"),
            ],
            &lines,
        )?;
        self.blocks.push(ReportBlock::text(
            "What came out, guided over baseline by the mean over time, when a component alone is asked for by a factor.",
        ));
        self.blocks.push(ReportBlock::Table {
            header,
            rows: table,
        });
        let caption = "The factor that came out over the one asked for";
        self.blocks
            .push(ReportBlock::picture("Scale interpolation", caption, svg));
        let name = Study::Interpolation.title();
        self.other_figures.insert(name.into(), json!(ratios));
        Ok(())
    }
}
