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
use lamogen::{
    Body, COMPONENTS, Component, Finish, Guidance, LossDivisor, Preset, Request, Scale, Tag,
    UpdateTiming,
};
use lamogen_data::Checksum;

use super::record::Key;
use crate::arguments::{Eval, PresetName};

/// A way to make a motion follow Laban tags.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, ValueEnum)]
pub enum Method {
    /// The sentence alone.
    Text,
    /// Laban guidance as the model is used, by its preset.
    Laban,
    /// Laban guidance that moves the sentence embedding: the paper's method, with the preset fast.
    Embedding,
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
            Method::Embedding => "Laban guidance, embedding",
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

/// Which prompts a setting is for: some, at equal distances from all of them, which may be sorted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Places {
    some: usize,
    all: usize,
}

impl Places {
    /// So many of all; all where there are no more.
    pub fn spread(some: usize, all: usize) -> Places {
        let some = some.min(all);
        Places { some, all }
    }

    /// The places, ascending.
    pub fn iter(self) -> impl Iterator<Item = usize> + Clone {
        (0..self.some).map(move |place| place * self.all / self.some)
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
    /// Which of the prompts.
    pub prompts: Places,
}

impl Setting {
    /// Whether the motions of both are the same.
    fn generates_as(&self, other: &Setting) -> bool {
        self.guidance == other.guidance
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
    /// What its record goes by.
    pub fn key(&self) -> Key {
        let Cell {
            setting,
            demand,
            prompt,
            repeat,
        } = self;
        let (guidance, phrase) = match demand {
            Demand::Nothing => (None, ""),
            Demand::Factor(..) => (Some(&setting.guidance), ""),
            Demand::Phrase(tag) => (None, tag.phrase()),
        };
        let mut options = Checksum::new(0);
        options.add(format!("{} {guidance:?}{phrase}", setting.steps).as_bytes());
        Key {
            id: format!("{} / {demand} / {prompt} / {repeat}", setting.name),
            options: format!("{:016x}", options.value()),
        }
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
    /// The presets, each with its steps; among them the paper's own numbers.
    Presets,
    /// A learning rate that stays, rises or falls from step to step.
    Rise,
    /// DDIM steps.
    Steps,
    /// Immediate and lagged updates.
    Update,
    /// Updates a step: 1, 2, 4.
    Updates,
    /// What is moved and how much the asked component counts: how exactly tags are followed against how much else moves.
    ParetoFront,
    /// Updates of the finished motion, after guidance and without it.
    Finish,
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
            Study::Presets => "Presets",
            Study::Rise => "A learning rate that rises",
            Study::Steps => "DDIM steps",
            Study::Update => "Immediate and lagged updates",
            Study::Updates => "Updates a step",
            Study::Finish => "Updates of the finished motion",
            Study::ParetoFront => "Exactness against selectivity",
            Study::Divisor => "What the loss divides by",
            Study::Smoothing => "Smoothing",
        }
    }
}

/// The factors of [`Study::Interpolation`].
pub const INTERPOLATION: [f32; 5] = [0.5, 0.8, 1.0, 1.2, 1.5];

/// How much the asked component counts in [`Study::ParetoFront`].
const FRONT: [f32; 3] = [1.0, 3.0, 10.0];

/// How everything is generated that a setting does not change.
#[derive(Clone, Copy, Debug)]
pub struct Basis {
    pub preset: Preset,
    /// If they are given: DDIM steps of every preset.
    pub given_steps: Option<usize>,
    /// Of the start noise, whose every update is a pass.
    pub noise_steps: usize,
}

impl Basis {
    /// DDIM steps of a preset.
    pub fn steps_of(&self, preset: Preset) -> usize {
        self.given_steps.unwrap_or(preset.steps())
    }

    /// DDIM steps where nothing else is said.
    pub fn steps(&self) -> usize {
        self.steps_of(self.preset)
    }

    fn laban(&self, name: String, prompts: Places, change: impl FnOnce(&mut Setting)) -> Setting {
        let mut setting = Setting {
            name,
            method: Method::Laban,
            guidance: self.preset.guidance(),
            steps: self.steps(),
            demands: tags(factor),
            prompts,
        };
        change(&mut setting);
        setting
    }

    /// The setting of a method.
    pub fn method(&self, method: Method, prompts: Places) -> Setting {
        let name = method.to_possible_value().expect("all have names");
        self.laban(name.get_name().to_owned(), prompts, |setting| {
            setting.method = method;
            match method {
                Method::Laban => {}
                Method::Embedding => {
                    setting.guidance = Guidance::fast();
                    setting.steps = self.steps_of(Preset::Fast);
                }
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
    pub fn study(&self, study: Study, prompts: Places) -> Vec<(String, Setting)> {
        let usual = self.preset.guidance();
        let vary = |label: String, change: &dyn Fn(&mut Setting)| {
            let name = format!("laban, {label}");
            let mut setting = self.laban(name, prompts, change);
            // Generated once, under one name, whatever else is asked for.
            let methods = [Method::Laban, Method::Embedding];
            let methods = methods.map(|method| self.method(method, prompts));
            if let Some(method) = methods.into_iter().find(|m| m.generates_as(&setting)) {
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
            Study::LearningRate => [0.001, 0.005, 0.02, 0.05, 0.1, 0.5]
                .map(|rate| {
                    vary(format!("learning rate {rate}"), &|setting| {
                        // Where it rises, it rises as much.
                        let last = usual.final_learning_rate;
                        setting.guidance.final_learning_rate =
                            last.map(|last| last / usual.learning_rate * rate);
                        setting.guidance.learning_rate = rate;
                    })
                })
                .into(),
            Study::Presets => [Preset::Precise, Preset::Fast, Preset::Paper]
                .map(|preset| {
                    let steps = self.steps_of(preset);
                    let name = preset.name();
                    vary(format!("{name}, {steps} steps"), &|setting| {
                        setting.guidance = preset.guidance();
                        setting.steps = steps;
                    })
                })
                .into(),
            Study::Rise => {
                let low = usual.learning_rate;
                let high = usual.final_learning_rate.unwrap_or(4.0 * low);
                let rows = [
                    (format!("{low} all the time"), low, None),
                    (format!("{high} all the time"), high, None),
                    (format!("rising from {low} to {high}"), low, Some(high)),
                    (format!("falling from {high} to {low}"), high, Some(low)),
                ];
                rows.map(|(name, first, last)| {
                    vary(format!("learning rate {name}"), &|setting| {
                        setting.guidance.learning_rate = first;
                        setting.guidance.final_learning_rate = last;
                    })
                })
                .into()
            }
            Study::Steps => [10, 20, 50, 100, 200, 1000]
                .map(|steps| vary(format!("{steps} steps"), &|setting| setting.steps = steps))
                .into(),
            Study::Update => [
                ("immediate", UpdateTiming::Immediate),
                ("lagged", UpdateTiming::Lagged),
            ]
            .map(|(name, update)| vary(name.into(), &|setting| setting.guidance.update = update))
            .into(),
            Study::Updates => [1, 2, 4]
                .map(|updates| {
                    vary(format!("{updates} a step"), &|setting| {
                        setting.guidance.updates_per_step = updates;
                    })
                })
                .into(),
            Study::ParetoFront => {
                // What is moved of the network is compared on its own motions, and with the body beside them.
                let on_the_network = |guidance| Guidance {
                    body: Body::Network,
                    ..guidance
                };
                let finished = on_the_network(Guidance::precise());
                let modulation = Guidance {
                    finish: None,
                    ..finished.clone()
                };
                let moved = [
                    (
                        "embedding",
                        on_the_network(Guidance::fast()),
                        self.steps_of(Preset::Fast),
                    ),
                    ("modulation", modulation, self.steps()),
                    ("modulation with a finish", finished, self.steps()),
                    ("modulation and body", Guidance::precise(), self.steps()),
                ];
                let rows = moved.into_iter().flat_map(|(name, guidance, steps)| {
                    FRONT.map(|emphasis| {
                        vary(format!("{name}, emphasis {emphasis}"), &|setting| {
                            setting.guidance = Guidance {
                                emphasis: [emphasis; COMPONENTS],
                                ..guidance.clone()
                            };
                            setting.steps = steps;
                        })
                    })
                });
                // The rivals as they are: the paper gives them no emphasis.
                let others = [
                    ("finished motion", Method::Raw),
                    ("predicted motion", Method::Classifier),
                    ("start noise", Method::Noise),
                ];
                let others =
                    others.map(|(name, method)| (name.into(), self.method(method, prompts)));
                rows.chain(others).collect()
            }
            Study::Finish => {
                let usual = usual.finish.unwrap_or_default();
                let after = [0, 50, 100, 200].map(|iterations| {
                    let label = format!("{iterations} after guidance");
                    vary(label, &|setting| {
                        let finish = Finish {
                            iterations,
                            ..usual
                        };
                        setting.guidance.body = Body::Network;
                        setting.guidance.finish = (iterations > 0).then_some(finish);
                    })
                });
                let alone = [100, 300].map(|iterations| {
                    let label = format!("{iterations} without guidance");
                    vary(label, &|setting| {
                        let updates = Finish {
                            iterations,
                            ..usual
                        };
                        setting.guidance = updates.alone(&setting.guidance);
                    })
                });
                after.into_iter().chain(alone).collect()
            }
            Study::Divisor => {
                let divisors = [
                    ("by each frame", LossDivisor::Frame),
                    ("by the mean over time", LossDivisor::Mean),
                ];
                let guided = divisors.map(|(name, divisor)| {
                    vary(name.into(), &|setting| {
                        setting.guidance.divisor = divisor;
                    })
                });
                let finished = divisors.map(|(name, divisor)| {
                    let label = format!("raw frame update, {name}");
                    let mut setting = self.method(Method::Raw, prompts);
                    if setting.guidance.divisor != divisor {
                        setting.guidance.divisor = divisor;
                        setting.name = label.clone();
                    }
                    (label, setting)
                });
                guided.into_iter().chain(finished).collect()
            }
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

/// Settings of one name only once: with the prompts of the first, which for a method are all.
fn merged(settings: impl IntoIterator<Item = Setting>) -> Vec<Setting> {
    let mut merged: Vec<Setting> = Vec::new();
    for setting in settings {
        if merged.iter().all(|other| other.name != setting.name) {
            merged.push(setting);
        }
    }
    merged
}

/// All cells of a setting.
pub fn cells(setting: &Setting, repeats: u64) -> impl Iterator<Item = Cell<'_>> {
    let demands = setting.demands.iter();
    demands.flat_map(move |&demand| {
        (0..repeats).flat_map(move |repeat| {
            setting.prompts.iter().map(move |prompt| Cell {
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
            given_steps: options.steps,
            noise_steps: options.noise_steps,
        };
        let methods = [Method::Text].iter().chain(&options.methods);
        let all = Places::spread(prompts, prompts);
        let methods = methods.map(|&method| basis.method(method, all));
        let mut methods = merged(methods);
        // With the preset fast both are the same.
        let laban = basis.method(Method::Laban, all);
        methods.retain(|setting| setting.name == laban.name || !setting.generates_as(&laban));
        let few = Places::spread(options.study_prompts as usize, prompts);
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

#[cfg(test)]
mod tests {
    use super::*;

    const BASIS: Basis = Basis {
        preset: Preset::Precise,
        given_steps: None,
        noise_steps: 10,
    };

    #[test]
    fn keys_tell_all_settings_and_other_options_of_the_same_name() {
        let few = Places::spread(2, 2);
        let studies = Study::value_variants().iter();
        let rows = studies.flat_map(|&study| BASIS.study(study, few));
        let methods = Method::value_variants().iter();
        let methods = methods.map(|&method| BASIS.method(method, few));
        let all: Vec<Setting> = methods.chain(rows.map(|(_, setting)| setting)).collect();
        for (place, setting) in all.iter().enumerate() {
            for other in all[..place].iter().filter(|s| s.name == setting.name) {
                assert!(setting.generates_as(other), "{} is two", setting.name);
            }
        }
        let all = merged(all);
        let mut keys = std::collections::HashSet::new();
        for setting in &all {
            for cell in cells(setting, 2) {
                assert!(keys.insert(cell.key()), "{:?} twice", cell.key());
            }
        }
        let key = |change: &dyn Fn(&mut Setting), demand| {
            let mut setting = BASIS.method(Method::Laban, few);
            change(&mut setting);
            let cell = Cell {
                setting: &setting,
                demand,
                prompt: 0,
                repeat: 0,
            };
            cell.key()
        };
        let strong = factor(Tag::Strong);
        let (same, steps) = (|_: &mut Setting| (), |s: &mut Setting| s.steps = 7);
        let rate = |s: &mut Setting| s.guidance.learning_rate *= 2.0;
        assert_eq!(key(&same, strong), key(&same, strong));
        for change in [&steps as &dyn Fn(&mut Setting), &rate] {
            let (one, other) = (key(&same, strong), key(change, strong));
            assert_eq!(one.id, other.id);
            assert_ne!(one.options, other.options);
        }
        // Nothing guides the sentence alone.
        assert_eq!(key(&rate, Demand::Nothing), key(&same, Demand::Nothing));
    }
}
