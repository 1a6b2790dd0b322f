//! The studies (ablations), and their settings.

use lamogen::laban::{GaussianKernel, Smoothing};
use lamogen::{Body, COMPONENTS, Component, Finish, Guidance, LossDivisor, Preset, UpdateTiming};

use super::PlanDefaults;
use super::condition::Condition;
use super::method::Method;
use super::prompts::PromptSelection;
use super::setting::MethodSetting;

/// The studies (ablations); each varies one option of Laban guidance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
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
    #[cfg_attr(feature = "clap", value(alias = "front"))]
    ParetoFront,
    /// Updates of the finished motion, after guidance and without it.
    Finish,
    /// What the loss divides by.
    Divisor,
    /// Smoothing before the differences are taken, before each, and none.
    Smoothing,
}

impl Study {
    /// All studies.
    pub const ALL: [Study; 11] = [
        Study::Interpolation,
        Study::ParetoFront,
        Study::Presets,
        Study::LearningRate,
        Study::Rise,
        Study::Steps,
        Study::Update,
        Study::Updates,
        Study::Finish,
        Study::Divisor,
        Study::Smoothing,
    ];

    /// Returns the title of the study in the report.
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

/// The weights in the loss of the component that shall change, in [`Study::ParetoFront`].
const PARETO_EMPHASES: [f32; 3] = [1.0, 3.0, 10.0];

impl PlanDefaults {
    /// Returns the settings of a study, each with the label of its row.
    pub fn study_settings(
        &self,
        study: Study,
        prompts: PromptSelection,
    ) -> Vec<(String, MethodSetting)> {
        let default_guidance = self.preset.guidance();
        let vary = |label: String, change: &dyn Fn(&mut MethodSetting)| {
            let name = format!("laban, {label}");
            let mut setting = self.laban_setting(name, prompts, change);
            // A setting that generates the same motions as a method takes its name, so that they are generated once.
            let methods = [Method::Laban, Method::Embedding];
            let methods = methods.map(|method| self.method_setting(method, prompts));
            if let Some(method) = methods
                .into_iter()
                .find(|m| m.generates_same_motions(&setting))
            {
                setting.name = method.name;
            }
            (label, setting)
        };
        match study {
            Study::Interpolation => {
                let all = Component::ALL.into_iter().flat_map(|component| {
                    INTERPOLATION.map(|factor| Condition::Factor(component, factor))
                });
                let conditions: Vec<Condition> = all.collect();
                vec![vary("factors from 0.5 to 1.5".into(), &|setting| {
                    setting.conditions = conditions.clone();
                })]
            }
            Study::LearningRate => [0.001, 0.005, 0.02, 0.05, 0.1, 0.5]
                .map(|rate| {
                    vary(format!("learning rate {rate}"), &|setting| {
                        // The ratio of the last rate to the first is that of the preset.
                        let last = default_guidance.final_learning_rate;
                        setting.guidance.final_learning_rate =
                            last.map(|last| last / default_guidance.learning_rate * rate);
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
                let low = default_guidance.learning_rate;
                let high = default_guidance.final_learning_rate.unwrap_or(4.0 * low);
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
                // The variables of the network are compared on the network's own motions, and, in one row, together
                // with the fit to the body.
                let without_body = |guidance| Guidance {
                    body: Body::Network,
                    ..guidance
                };
                let modulation_with_finish = without_body(Guidance::precise());
                let modulation = Guidance {
                    finish: None,
                    ..modulation_with_finish.clone()
                };
                let variables = [
                    (
                        "embedding",
                        without_body(Guidance::fast()),
                        self.steps_of(Preset::Fast),
                    ),
                    ("modulation", modulation, self.steps()),
                    (
                        "modulation with a finish",
                        modulation_with_finish,
                        self.steps(),
                    ),
                    ("modulation and body", Guidance::precise(), self.steps()),
                ];
                let rows = variables.into_iter().flat_map(|(name, guidance, steps)| {
                    PARETO_EMPHASES.map(|emphasis| {
                        vary(format!("{name}, emphasis {emphasis}"), &|setting| {
                            setting.guidance = Guidance {
                                emphasis: [emphasis; COMPONENTS],
                                ..guidance.clone()
                            };
                            setting.steps = steps;
                        })
                    })
                });
                // The other methods run without emphasis, as in the paper.
                let others = [
                    ("finished motion", Method::Raw),
                    ("predicted motion", Method::Classifier),
                    ("start noise", Method::Noise),
                ];
                let others = others
                    .map(|(name, method)| (name.into(), self.method_setting(method, prompts)));
                rows.chain(others).collect()
            }
            Study::Finish => {
                let default_finish = default_guidance.finish.unwrap_or_default();
                let after = [0, 50, 100, 200].map(|iterations| {
                    let label = format!("{iterations} after guidance");
                    vary(label, &|setting| {
                        let finish = Finish {
                            iterations,
                            ..default_finish
                        };
                        setting.guidance.body = Body::Network;
                        setting.guidance.finish = (iterations > 0).then_some(finish);
                    })
                });
                let alone = [100, 300].map(|iterations| {
                    let label = format!("{iterations} without guidance");
                    vary(label, &|setting| {
                        let finish = Finish {
                            iterations,
                            ..default_finish
                        };
                        setting.guidance = finish.alone(&setting.guidance);
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
                    let mut setting = self.method_setting(Method::Raw, prompts);
                    if setting.guidance.divisor != divisor {
                        setting.guidance.divisor = divisor;
                        setting.name = label.clone();
                    }
                    (label, setting)
                });
                guided.into_iter().chain(finished).collect()
            }
            Study::Smoothing => [
                ("before all differences", default_guidance.laban.smoothing),
                (
                    "before each difference",
                    Smoothing::EachDifference(GaussianKernel::PAPER),
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
