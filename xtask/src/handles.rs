//! What guidance can take hold of in a network, measured side by side: the sentence embedding, the tokens at each layer, and
//! what scales and shifts the hidden state.

use std::error::Error;
use std::fmt::Write;
use std::time::Instant;

use burn::tensor::Device;
use lamogen::motion::{FootSliding, Jitter};
use lamogen::{
    Component, Guidance, GuidanceVariable, LaMoGen, LabanOptions, LabanSeries, Motion, Request, Tag,
};
use lamogen_eval::{ChangeMatrix, ControlRange};
use lamogen_model::Denoiser;

use crate::subject::Subject;

/// The options of the measurement.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    #[command(flatten)]
    #[allow(missing_docs)]
    pub subject: Subject,
    /// A sentence, several times for several; eight everyday ones without.
    #[arg(long)]
    pub prompt: Vec<String>,
    /// Length of the motions in seconds.
    #[arg(long, default_value_t = 4.0)]
    pub seconds: f32,
    /// Seeds of the start noise: this many, from 1.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub seeds: u64,
    /// Only rows whose name contains this text.
    #[arg(long)]
    pub only: Option<String>,
}

const PROMPTS: [&str; 8] = [
    "a person walks forward",
    "a person runs",
    "a person jumps",
    "a person waves",
    "a person dances",
    "a person kicks",
    "a person throws a ball",
    "a person sits down",
];

/// The tags of each component, the smaller value first.
const TAGS: [[Tag; 2]; 4] = [
    [Tag::Light, Tag::Strong],
    [Tag::Sustained, Tag::Sudden],
    [Tag::Bound, Tag::Free],
    [Tag::Near, Tag::Far],
];

/// What is moved, and by which optimiser: that of the preset fast, whose every number moves equally far, or that of precise, whose numbers
/// move in proportion to their gradients.
fn rows() -> Vec<(String, Guidance)> {
    let variables = [
        ("embedding", GuidanceVariable::Embedding),
        ("tokens", GuidanceVariable::Tokens),
        ("scales and shifts", GuidanceVariable::Modulation),
    ];
    let optimisers = [("fast", Guidance::fast()), ("precise", Guidance::precise())];
    let rows = variables.into_iter().flat_map(|(name, variable)| {
        optimisers.clone().map(|(optimiser, guidance)| {
            let guidance = Guidance {
                variable,
                ..guidance
            };
            (format!("{name}, {optimiser}"), guidance)
        })
    });
    rows.collect()
}

/// Measures every handle that a network has and returns a table in Markdown. `report` receives one line of text for each row.
///
/// # Errors
///
/// If the model cannot be read or a motion cannot be generated.
pub fn run(
    options: &Options,
    device: &Device,
    report: &mut dyn FnMut(&str),
) -> Result<String, Box<dyn Error>> {
    let model = options.subject.open(device)?;
    let mut table = String::from(
        "| handle, optimiser | motion | Weight | Time | Flow | Shape | diagonality | others | jerk, m/s³ | sliding, m/s | s |\n\
         |---|---|---|---|---|---|---|---|---|---|---|\n",
    );
    let asked = |name: &str| { options.only.as_ref() }.is_none_or(|only| name.contains(only));
    for (name, guidance) in rows().into_iter().filter(|(name, _)| asked(name)) {
        let width = match guidance.variable {
            GuidanceVariable::Tokens => model.network().token_offset_width(),
            GuidanceVariable::Modulation => model.network().modulation_width(),
            _ => 1,
        };
        if width == 0 {
            continue;
        }
        let start = Instant::now();
        let rows = measure(&model, options, &guidance, device)?;
        let seconds = start.elapsed().as_secs_f64() / rows[0].motions as f64;
        for (motion, row) in ["network", "rigid body"].into_iter().zip(rows) {
            let line = format!("| {name} | {motion} | {} | {seconds:.2} |", row.cells()?);
            report(&line);
            writeln!(table, "{line}")?;
        }
    }
    Ok(table)
}

/// The measurements of one kind of motions of a handle.
#[derive(Default)]
struct Row {
    motions: usize,
    /// `[component][motion]`
    ranges: [Vec<ControlRange>; 4],
    jerk: f64,
    sliding: f64,
}

/// Generates all motions of a handle. Returns the measurements of the network's own motions and of those of the rigid body.
fn measure(
    model: &LaMoGen,
    options: &Options,
    guidance: &Guidance,
    device: &Device,
) -> Result<[Row; 2], Box<dyn Error>> {
    let sentences: Vec<&str> = match &options.prompt[..] {
        [] => PROMPTS.to_vec(),
        prompts => prompts.iter().map(String::as_str).collect(),
    };
    let mut rows = [Row::default(), Row::default()];
    for sentence in sentences {
        for seed in 1..=options.seeds {
            let request = |tag: &Tag| {
                let request = Request::new(sentence)
                    .seconds(options.seconds)
                    .seed(seed)
                    .tag(*tag);
                let request = options.subject.with_steps(request);
                request.guidance(guidance.clone())
            };
            let requests: Vec<Request> = TAGS.as_flattened().iter().map(request).collect();
            let generations = model.generate_all(&requests)?;
            for (component, pair) in Component::ALL.into_iter().zip(generations.chunks(2)) {
                let of_kinds = [
                    [&pair[0].network.guided, &pair[1].network.guided],
                    [&pair[0].guided, &pair[1].guided],
                ];
                for (row, motions) in rows.iter_mut().zip(of_kinds) {
                    row.add(component, motions, device);
                }
            }
        }
    }
    Ok(rows)
}

impl Row {
    /// Adds the motions with the smaller and with the larger tag of a component.
    fn add(&mut self, component: Component, motions: [&Motion; 2], device: &Device) {
        let [small, large] = motions.map(|motion| {
            self.motions += 1;
            self.jerk += f64::from(Jitter::of(motion).jerk);
            self.sliding += f64::from(FootSliding::of(motion).speed);
            let series = LabanSeries::of(motion, &LabanOptions::default(), device);
            series.known_means(0..series.frames().len()).map(f64::from)
        });
        self.ranges[component.index()].push(ControlRange { small, large });
    }

    /// Returns the cells of the table: the change of each component where it was asked for, the share of these in all changes, the mean size of all
    /// other changes, jerk and sliding.
    fn cells(&self) -> Result<String, Box<dyn Error>> {
        let matrix = ChangeMatrix::of(self.ranges.each_ref().map(Vec::as_slice))?;
        let diagonal: [f64; 4] = std::array::from_fn(|i| matrix.mean[i][i]);
        let others = (0..16).filter(|cell| cell / 4 != cell % 4);
        let others: f64 = { others }
            .map(|cell| matrix.mean[cell / 4][cell % 4].abs())
            .sum();
        let [jerk, sliding] = [self.jerk, self.sliding].map(|sum| sum / self.motions as f64);
        let diagonal = diagonal.map(|change| format!("{change:.2}")).join(" | ");
        Ok(format!(
            "{diagonal} | {:.3} | {:.3} | {jerk:.0} | {sliding:.3}",
            matrix.diagonality(),
            others / 12.0
        ))
    }
}
