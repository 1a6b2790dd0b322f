//! The ablations: a table each, and a plot where there is one to draw.

use lamogen::{COMPONENTS, Component};
use lamogen_view::{Axis, Line, plot};
use serde_json::json;

use super::super::document::Block;
use super::super::plan::{INTERPOLATION, Setting, Study};
use super::super::summary::{Control, Evidence, Figures, Ratio};
use super::{COLOURS, NAMES, NOTHING, Report, ReportError, shown};

impl Report {
    /// An ablation.
    pub(super) fn study(
        &mut self,
        study: Study,
        rows: &[(String, Setting)],
        evidence: &Evidence<'_>,
    ) -> Result<(), ReportError> {
        let mut table = Vec::new();
        let (mut numbers, mut measured) = (Vec::new(), Vec::new());
        let mut points: Vec<(f64, f64, Option<f64>)> = Vec::new();
        for (label, setting) in rows {
            // Over the sentences of the study alone, so that its rows can be compared.
            let figures = evidence.figures(setting)?;
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
                None => (NOTHING.into(), NOTHING.into()),
            };
            let top = figures.r_precision.map(|ranks| ranks[2]);
            table.push(vec![
                label.clone(),
                diagonality,
                diagonal,
                shown(figures.error, 3),
                shown(top, 3),
                shown(figures.fid, 3),
                shown(figures.distance, 3),
                shown(figures.jerk, 0),
                shown(figures.drift, 3),
                figures.failed.len().to_string(),
            ]);
            let number = label.split(' ').find_map(|word| word.parse::<f64>().ok());
            if let (Some(number), Some(error)) = (number, figures.error) {
                points.push((number, error.mean, top.map(|top| top.mean)));
            }
            numbers.push(json!({ "row": label, "figures": figures }));
            measured.push(figures);
        }
        self.others.insert(study.title().into(), numbers.into());
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
                "bone drift",
                "failed",
            ],
            table,
        ));
        if study == Study::Front {
            self.front(rows, &measured)?;
        }
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
            let label = match study {
                Study::Steps => "DDIM steps",
                _ => "learning rate",
            };
            let axes = [Axis::logarithmic(label), Axis::linear("")];
            let mut lines = vec![line("Laban error", COLOURS[0], errors)];
            if !tops.is_empty() {
                lines.push(line("R-precision, top 3", COLOURS[1], tops));
            }
            let svg = plot(study.title(), axes, &lines)?;
            let caption = format!("Laban error and R-precision by {label}");
            self.blocks
                .push(Block::picture(study.title(), caption, svg));
        }
        Ok(())
    }

    /// How far from what was asked, against how much of all change was asked for: a line for all that one thing moved makes.
    fn front(
        &mut self,
        rows: &[(String, Setting)],
        figures: &[Figures],
    ) -> Result<(), ReportError> {
        let line = |label: &'static str, colour| {
            let own = rows.iter().zip(figures);
            // A row is called after its line, and what else there is to say of it.
            let own = own.filter(|((row, _), _)| row.split(',').next() == Some(label));
            let points = own.filter_map(|(_, figures)| {
                let control = figures.control.as_ref()?;
                Some([figures.error?.mean, control.diagonality])
            });
            Line {
                label,
                points: points.collect(),
                colour,
                marked: true,
            }
        };
        let axes = [
            Axis::linear("distance from what was asked"),
            Axis::linear("diagonality"),
        ];
        let lines = [
            line("embedding", COLOURS[0]),
            line("modulation", COLOURS[1]),
            line("modulation with a finish", [8, 145, 178]),
            line("finished motion", COLOURS[2]),
            line("predicted motion", [156, 163, 175]),
            line("start noise", COLOURS[3]),
        ];
        let lines = lines.into_iter().filter(|line| !line.points.is_empty());
        let lines: Vec<Line<'_>> = lines.collect();
        let title = Study::Front.title();
        let svg = plot(title, axes, &lines)?;
        let caption = "Diagonality over the distance from what was asked; each line goes from little emphasis on the right to much on the left";
        self.blocks.push(Block::picture(title, caption, svg));
        Ok(())
    }

    pub(super) fn interpolation(
        &mut self,
        setting: &Setting,
        evidence: &Evidence<'_>,
    ) -> Result<(), ReportError> {
        let ratios = evidence.ratios(setting);
        let of = |component: Component, factor: f32| {
            let mut ratios = ratios.iter();
            ratios.find(|ratio| (ratio.component, ratio.asked) == (component, factor))
        };
        let mut table = Vec::new();
        let mut lines = vec![Line {
            label: "asked",
            points: INTERPOLATION.map(|factor| [f64::from(factor); 2]).into(),
            colour: [156, 163, 175],
            marked: false,
        }];
        for component in Component::ALL {
            let found = INTERPOLATION.map(|factor| of(component, factor));
            let place = component.index();
            let mut row = vec![NAMES[place].to_owned()];
            let cell = |ratio: &Ratio| format!("{:.3}", ratio.came_out);
            row.extend(found.map(|ratio| ratio.map_or(NOTHING.into(), cell)));
            table.push(row);
            let points = found.iter().flatten();
            let points = points.map(|ratio| [f64::from(ratio.asked), ratio.came_out]);
            lines.push(Line {
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
                Axis::linear("factor asked for"),
                Axis::linear("factor that came out"),
            ],
            &lines,
        )?;
        self.blocks.push(Block::text(
            "What came out, guided over baseline by the mean over time, when a component alone is asked for by a factor.",
        ));
        self.blocks.push(Block::Table {
            header,
            rows: table,
        });
        let caption = "The factor that came out over the one asked for";
        self.blocks
            .push(Block::picture("Scale interpolation", caption, svg));
        let name = Study::Interpolation.title();
        self.others.insert(name.into(), json!(ratios));
        Ok(())
    }
}
