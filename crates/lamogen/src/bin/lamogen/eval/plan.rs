//! What is generated: settings, each for some prompts, seeds and demands.
//!
//! ```text
//! --methods, --studies ──▶ Setting (a method with its options) ──┐
//! --prompts, --repeats ──▶ prompt, seed ─────────────────────────┼──▶ Cell: one motion
//!                          Demand (a component and a factor) ────┘
//! ```

use std::fmt;

use clap::ValueEnum;
use lamogen::guide::edited_prompt;
use lamogen::laban::{Gaussian, Smoothing};
use lamogen::{COMPONENTS, Component, Divisor, Guidance, Preset, Request, Scale, Tag, Update};

use crate::arguments::{Eval, PresetName};

/// A way to make a motion follow Laban tags.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, ValueEnum)]
pub enum Method {
    /// The sentence alone.
    Text,
    /// Laban guidance: the paper's method.
    Laban,
    /// Phrases in the prompt.
    Prompt,
    /// Raw frame update: the finished motion is moved.
    Raw,
    /// Classifier guidance: the predicted motion is moved.
    Classifier,
    /// The start noise is moved.
    Noise,
}

impl Method {
    /// As the paper's tables call it.
    pub fn title(self) -> &'static str {
        match self {
            Method::Text => "Text alone",
            Method::Laban => "Laban guidance",
            Method::Prompt => "Prompt editing",
            Method::Raw => "Raw frame update",
            Method::Classifier => "Classifier guidance",
            Method::Noise => "Start noise",
        }
    }
}

/// What is asked of a motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Demand {
    /// Nothing: the sentence alone.
    Nothing,
    /// A factor on a component.
    Factor(Component, f32),
    /// A tag's phrase.
    Phrase(Tag),
}

impl fmt::Display for Demand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Demand::Nothing => f.write_str("nothing"),
            Demand::Factor(component, factor) => write!(f, "{component} {factor}"),
            Demand::Phrase(tag) => write!(f, "phrase {tag}"),
        }
    }
}

impl Demand {
    /// The component and factor that are asked for, by a tag's phrase too.
    pub fn factor(self) -> Option<(Component, f32)> {
        match self {
            Demand::Nothing => None,
            Demand::Factor(component, factor) => Some((component, factor)),
            Demand::Phrase(tag) => Some((tag.component(), tag.scale())),
        }
    }
}

/// A method with its options, and what is asked of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting {
    /// Tells it from the others; in the records too.
    pub name: String,
    pub method: Method,
    pub guidance: Guidance,
    pub steps: usize,
    pub demands: Vec<Demand>,
    /// How many of the prompts.
    pub prompts: usize,
}

impl Setting {
    /// Whether the motions of both are the same.
    fn generates_as(&self, other: &Setting) -> bool {
        self.method == other.method
            && self.guidance == other.guidance
            && self.steps == other.steps
            && self.demands == other.demands
    }
}

/// One motion.
#[derive(Clone, Copy, Debug)]
pub struct Cell<'a> {
    pub setting: &'a Setting,
    pub demand: Demand,
    pub prompt: usize,
    pub repeat: u64,
}

/// A sentence of the data, with the length of its motion.
#[derive(Clone, Debug)]
pub struct Prompt {
    pub captions: Vec<String>,
    pub frames: usize,
}

impl Prompt {
    /// The sentence of a repeat: each has several, and they take turns.
    pub fn caption(&self, repeat: u64) -> &str {
        &self.captions[repeat as usize % self.captions.len()]
    }
}

impl Cell<'_> {
    /// The name of its record.
    pub fn id(&self) -> String {
        let Cell {
            setting,
            demand,
            prompt,
            repeat,
        } = self;
        format!("{} / {demand} / {prompt} / {repeat}", setting.name)
    }

    /// The request for it. Every setting and demand begins with the same noise for one prompt and repeat.
    pub fn request(&self, prompt: &Prompt) -> Request {
        let caption = prompt.caption(self.repeat);
        let text = match self.demand {
            Demand::Phrase(tag) => edited_prompt(caption, [tag]),
            _ => caption.to_owned(),
        };
        let request = self.plain(prompt, text);
        match self.demand {
            Demand::Factor(component, factor) => {
                let mut factors = [1.0; COMPONENTS];
                factors[component.index()] = factor;
                let scale = Scale::new(factors).expect("factors of the plan are finite");
                request.scale(scale).guidance(self.setting.guidance.clone())
            }
            Demand::Nothing | Demand::Phrase(_) => request,
        }
    }

    /// The request for the sentence alone, which the motion is held against.
    pub fn baseline(&self, prompt: &Prompt) -> Request {
        self.plain(prompt, prompt.caption(self.repeat).to_owned())
    }

    fn plain(&self, prompt: &Prompt, text: String) -> Request {
        Request::new(text)
            .frames(prompt.frames)
            .steps(self.setting.steps)
            .seed(100_000 * self.repeat + self.prompt as u64)
    }
}

/// Both tags of every component.
fn tags(of: impl Fn(Tag) -> Demand) -> Vec<Demand> {
    Tag::ALL.into_iter().map(of).collect()
}

fn factor(tag: Tag) -> Demand {
    Demand::Factor(tag.component(), tag.scale())
}

/// What the ablations vary.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, ValueEnum)]
pub enum Study {
    /// Factors 0.5, 0.8, 1, 1.2 and 1.5 on every component.
    Interpolation,
    /// The learning rate, up to where it fails.
    LearningRate,
    /// DDIM steps.
    Steps,
    /// Immediate and lagged updates.
    Update,
    /// Updates a step: 1, 2, 4.
    Updates,
    /// How much the component that is asked for counts in the loss.
    Emphasis,
    /// What the loss divides by.
    Divisor,
    /// Smoothing before the differences are taken, before each, and none.
    Smoothing,
}

impl Study {
    pub fn title(self) -> &'static str {
        match self {
            Study::Interpolation => "Scale interpolation",
            Study::LearningRate => "Learning rate",
            Study::Steps => "DDIM steps",
            Study::Update => "Immediate and lagged updates",
            Study::Updates => "Updates a step",
            Study::Emphasis => "Emphasis",
            Study::Divisor => "What the loss divides by",
            Study::Smoothing => "Smoothing",
        }
    }
}

/// The factors of [`Study::Interpolation`].
pub const INTERPOLATION: [f32; 5] = [0.5, 0.8, 1.0, 1.2, 1.5];

/// How everything is generated that a setting does not change.
#[derive(Clone, Copy, Debug)]
pub struct Basis {
    pub preset: Preset,
    pub steps: usize,
    /// Of the start noise, whose every update is a pass.
    pub noise_steps: usize,
}

impl Basis {
    fn laban(&self, name: String, prompts: usize, change: impl FnOnce(&mut Setting)) -> Setting {
        let mut setting = Setting {
            name,
            method: Method::Laban,
            guidance: self.preset.guidance(),
            steps: self.steps,
            demands: tags(factor),
            prompts,
        };
        change(&mut setting);
        setting
    }

    /// The setting of a method.
    pub fn method(&self, method: Method, prompts: usize) -> Setting {
        let name = method.to_possible_value().expect("all have names");
        self.laban(name.get_name().to_owned(), prompts, |setting| {
            setting.method = method;
            match method {
                Method::Laban => {}
                Method::Text => setting.demands = vec![Demand::Nothing],
                Method::Prompt => setting.demands = tags(Demand::Phrase),
                Method::Raw => setting.guidance = Guidance::raw_frame_update(),
                Method::Classifier => setting.guidance = Guidance::classifier(),
                Method::Noise => {
                    setting.guidance = Guidance::start_noise();
                    setting.steps = self.noise_steps;
                }
            }
        })
    }

    /// The settings of a study, each with what stands in its row.
    pub fn study(&self, study: Study, prompts: usize) -> Vec<(String, Setting)> {
        let usual = self.preset.guidance();
        let vary = |label: String, change: &dyn Fn(&mut Setting)| {
            let name = format!("laban, {label}");
            let mut setting = self.laban(name, prompts, change);
            // Generated once, under one name, whatever else is asked for.
            let method = self.method(Method::Laban, prompts);
            if setting.generates_as(&method) {
                setting.name = method.name;
            }
            (label, setting)
        };
        match study {
            Study::Interpolation => {
                let all = Component::ALL.into_iter().flat_map(|component| {
                    INTERPOLATION.map(|factor| Demand::Factor(component, factor))
                });
                let demands: Vec<Demand> = all.collect();
                vec![vary("factors from 0.5 to 1.5".into(), &|setting| {
                    setting.demands = demands.clone();
                })]
            }
            Study::LearningRate => [0.001, 0.005, 0.02, 0.05, 0.1, 0.2, 0.5]
                .map(|rate| {
                    vary(format!("learning rate {rate}"), &|setting| {
                        setting.guidance.learning_rate = rate;
                    })
                })
                .into(),
            Study::Steps => [10, 20, 50, 100, 200, 500, 1000]
                .map(|steps| vary(format!("{steps} steps"), &|setting| setting.steps = steps))
                .into(),
            Study::Update => [("immediate", Update::Immediate), ("lagged", Update::Lagged)]
                .map(|(name, update)| {
                    vary(name.into(), &|setting| setting.guidance.update = update)
                })
                .into(),
            Study::Updates => [1, 2, 4]
                .map(|updates| {
                    vary(format!("{updates} a step"), &|setting| {
                        setting.guidance.updates_per_step = updates;
                    })
                })
                .into(),
            Study::Emphasis => [1.0, 3.0, 10.0, 30.0]
                .map(|emphasis| {
                    vary(format!("emphasis {emphasis}"), &|setting| {
                        setting.guidance.emphasis = emphasis;
                    })
                })
                .into(),
            Study::Divisor => [
                ("by each frame", Divisor::Frame),
                ("by the mean over time", Divisor::Mean),
            ]
            .map(|(name, divisor)| {
                vary(name.into(), &|setting| {
                    setting.guidance.divisor = divisor;
                })
            })
            .into(),
            Study::Smoothing => [
                ("before all differences", usual.laban.smoothing),
                (
                    "before each difference",
                    Smoothing::EachDifference(Gaussian::PAPER),
                ),
                ("none", Smoothing::None),
            ]
            .map(|(name, smoothing)| {
                vary(format!("smoothing {name}"), &|setting| {
                    setting.guidance.laban.smoothing = smoothing;
                })
            })
            .into(),
        }
    }
}

/// Settings of one name only once, with as many prompts as any of them wants.
fn merged(settings: impl IntoIterator<Item = Setting>) -> Vec<Setting> {
    let mut merged: Vec<Setting> = Vec::new();
    for setting in settings {
        match merged.iter_mut().find(|other| other.name == setting.name) {
            Some(other) => other.prompts = other.prompts.max(setting.prompts),
            None => merged.push(setting),
        }
    }
    merged
}

/// All cells of a setting.
pub fn cells(setting: &Setting, repeats: u64) -> impl Iterator<Item = Cell<'_>> {
    let demands = setting.demands.iter();
    demands.flat_map(move |&demand| {
        (0..repeats).flat_map(move |repeat| {
            (0..setting.prompts).map(move |prompt| Cell {
                setting,
                demand,
                prompt,
                repeat,
            })
        })
    })
}

/// All that is generated.
pub struct Plan {
    pub basis: Basis,
    pub methods: Vec<Setting>,
    /// Each with its rows: a label and a setting.
    pub studies: Vec<(Study, Vec<(String, Setting)>)>,
    /// Of both, each once.
    pub settings: Vec<Setting>,
    pub repeats: u64,
}

impl Plan {
    /// The plan of some options, for a model that runs with `preset` if nothing else is said.
    pub fn new(options: &Eval, preset: Preset, prompts: usize) -> Plan {
        let preset = options.preset.map_or(preset, PresetName::preset);
        let basis = Basis {
            preset,
            steps: options.steps.unwrap_or(preset.steps()),
            noise_steps: options.noise_steps,
        };
        let methods = [Method::Text].iter().chain(&options.methods);
        let methods = methods.map(|&method| basis.method(method, prompts));
        let methods = merged(methods);
        let few = (options.study_prompts as usize).min(prompts);
        let mut studies: Vec<(Study, Vec<(String, Setting)>)> = Vec::new();
        for &study in &options.studies {
            if studies.iter().all(|(other, _)| *other != study) {
                studies.push((study, basis.study(study, few)));
            }
        }
        let of_studies = studies
            .iter()
            .flat_map(|(_, rows)| rows.iter().map(|(_, setting)| setting));
        let settings = merged(methods.iter().chain(of_studies).cloned());
        Plan {
            basis,
            methods,
            studies,
            settings,
            repeats: options.repeats,
        }
    }

    /// All motions.
    pub fn cells(&self) -> impl Iterator<Item = Cell<'_>> {
        let settings = self.settings.iter();
        settings.flat_map(|setting| cells(setting, self.repeats))
    }
}
