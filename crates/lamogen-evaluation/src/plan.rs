//! The plan of an evaluation: settings, each for some prompts, seeds and conditions.
//!
//! ```text
//! --methods, --studies ──▶ MethodSetting (a method with its options) ──┐
//! --prompts, --repeats ──▶ prompt, seed ───────────────────────────────┼──▶ PlannedMotion
//!                          Condition (a component and a factor) ───────┘
//! ```

mod condition;
mod method;
mod multimodality;
mod prompts;
mod setting;
mod study;

use lamogen::{Guidance, Preset};

use super::EvaluationOptions;
pub use condition::Condition;
use condition::{factor_condition, tag_conditions};
pub use method::Method;
pub use multimodality::Multimodality;
pub use prompts::{EvalPrompt, PromptSelection};
pub use setting::{MethodSetting, PlannedMotion, planned_motions};
pub use study::{INTERPOLATION, Study};

/// The options of all settings, where a setting does not change them.
#[derive(Clone, Copy, Debug)]
pub struct PlanDefaults {
    pub preset: Preset,
    /// The number of DDIM steps for all presets, if the user states one.
    pub given_steps: Option<usize>,
    /// The number of DDIM steps of the method that changes the start noise; each of its updates is a pass.
    pub noise_steps: usize,
    /// The number of timesteps that the network was trained with, beyond which no preset goes.
    pub timesteps: usize,
}

impl PlanDefaults {
    /// Returns the number of DDIM steps of a preset.
    pub fn steps_of(&self, preset: Preset) -> usize {
        { self.given_steps }.unwrap_or(preset.steps().min(self.timesteps))
    }

    /// Returns the default number of DDIM steps.
    pub fn steps(&self) -> usize {
        self.steps_of(self.preset)
    }

    /// Makes a setting of Laban guidance with the default options, except for what `change` changes.
    fn laban_setting(
        &self,
        name: String,
        prompts: PromptSelection,
        change: impl FnOnce(&mut MethodSetting),
    ) -> MethodSetting {
        let mut setting = MethodSetting {
            name,
            method: Method::Laban,
            guidance: self.preset.guidance(),
            steps: self.steps(),
            conditions: tag_conditions(factor_condition),
            prompts,
        };
        change(&mut setting);
        setting
    }

    /// Returns the setting of a method.
    pub fn method_setting(&self, method: Method, prompts: PromptSelection) -> MethodSetting {
        let name = method.name().to_owned();
        self.laban_setting(name, prompts, |setting| {
            setting.method = method;
            match method {
                Method::Laban => {}
                Method::Embedding => {
                    setting.guidance = Guidance::fast();
                    setting.steps = self.steps_of(Preset::Fast);
                }
                Method::Text => setting.conditions = vec![Condition::Nothing],
                Method::Prompt => setting.conditions = tag_conditions(Condition::Phrase),
                Method::Raw => setting.guidance = Guidance::raw_frame_update(),
                Method::Classifier => setting.guidance = Guidance::classifier(),
                Method::Noise => {
                    setting.guidance = Guidance::start_noise();
                    setting.steps = self.noise_steps;
                }
            }
        })
    }
}

/// Removes settings with the same name as an earlier one. The first one is kept: for a method that is the setting with
/// all prompts.
fn unique_settings(settings: impl IntoIterator<Item = MethodSetting>) -> Vec<MethodSetting> {
    let mut unique: Vec<MethodSetting> = Vec::new();
    for setting in settings {
        if unique.iter().all(|other| other.name != setting.name) {
            unique.push(setting);
        }
    }
    unique
}

/// The plan of an evaluation.
pub struct EvalPlan {
    pub defaults: PlanDefaults,
    /// The settings of the methods that are compared.
    pub methods: Vec<MethodSetting>,
    /// Each study with its rows: a label and a setting.
    pub studies: Vec<(Study, Vec<(String, MethodSetting)>)>,
    /// The settings of methods and studies, each only once.
    pub settings: Vec<MethodSetting>,
    /// The number of motions for each prompt and condition, from as many seeds.
    pub repeats: u64,
    /// The texts with several motions by each method; `None` without MultiModality.
    pub multimodality: Option<Multimodality>,
}

impl EvalPlan {
    /// Makes the plan of some options. `preset` is that of the model, for options without a preset; `timesteps` are those that
    /// its network was trained with.
    pub fn new(
        options: &EvaluationOptions,
        (preset, timesteps): (Preset, usize),
        prompts: usize,
    ) -> EvalPlan {
        let preset = options.preset.unwrap_or(preset);
        let defaults = PlanDefaults {
            preset,
            given_steps: options.steps,
            noise_steps: options.noise_steps.min(timesteps),
            timesteps,
        };
        let methods = [Method::Text].iter().chain(&options.methods);
        let all = PromptSelection::spread(prompts, prompts);
        let methods = methods.map(|&method| defaults.method_setting(method, all));
        let mut methods = unique_settings(methods);
        // With the preset fast, the methods `laban` and `embedding` are the same.
        let laban = defaults.method_setting(Method::Laban, all);
        methods.retain(|setting| {
            setting.name == laban.name || !setting.generates_same_motions(&laban)
        });
        let study_prompts = PromptSelection::spread(options.study_prompts, prompts);
        let mut studies: Vec<(Study, Vec<(String, MethodSetting)>)> = Vec::new();
        for &study in &options.studies {
            if studies.iter().all(|(other, _)| *other != study) {
                studies.push((study, defaults.study_settings(study, study_prompts)));
            }
        }
        let study_settings = studies
            .iter()
            .flat_map(|(_, rows)| rows.iter().map(|(_, setting)| setting));
        let settings = unique_settings(methods.iter().chain(study_settings).cloned());
        EvalPlan {
            defaults,
            methods,
            studies,
            settings,
            repeats: options.repeats,
            multimodality: None,
        }
    }

    /// Adds several motions for some texts by each method.
    pub fn with_multimodality(self, multimodality: Option<Multimodality>) -> EvalPlan {
        EvalPlan {
            multimodality,
            ..self
        }
    }

    /// Returns all motions of the plan.
    pub fn planned_motions(&self) -> impl Iterator<Item = PlannedMotion<'_>> {
        let settings = self.settings.iter();
        settings.flat_map(|setting| {
            planned_motions(setting, self.repeats).chain(self.further_motions(setting))
        })
    }

    /// Returns the motions of a method that are for MultiModality only.
    fn further_motions<'a>(
        &'a self,
        setting: &'a MethodSetting,
    ) -> impl Iterator<Item = PlannedMotion<'a>> {
        let is_method = { self.methods.iter() }.any(|method| method.name == setting.name);
        let multimodality = self.multimodality.as_ref().filter(|_| is_method);
        let sets = multimodality.into_iter().flat_map(move |multimodality| {
            (0..self.repeats).flat_map(move |repeat| multimodality.planned_motions(setting, repeat))
        });
        sets.flatten().filter(|planned| planned.variant > 0)
    }
}

#[cfg(test)]
mod tests {
    use lamogen::Tag;

    use super::*;

    const DEFAULTS: PlanDefaults = PlanDefaults {
        preset: Preset::Precise,
        given_steps: None,
        noise_steps: 10,
        timesteps: 1000,
    };

    #[test]
    fn keys_differ_between_settings_and_between_options_of_one_name() {
        let selection = PromptSelection::spread(2, 2);
        let studies = Study::ALL.iter();
        let rows = studies.flat_map(|&study| DEFAULTS.study_settings(study, selection));
        let methods = [Method::Text].iter().chain(&Method::RIVALS);
        let methods = methods.map(|&method| DEFAULTS.method_setting(method, selection));
        let all: Vec<MethodSetting> = methods.chain(rows.map(|(_, setting)| setting)).collect();
        for (place, setting) in all.iter().enumerate() {
            for other in all[..place].iter().filter(|s| s.name == setting.name) {
                assert!(
                    setting.generates_same_motions(other),
                    "{} is two",
                    setting.name
                );
            }
        }
        let all = unique_settings(all);
        let mut keys = std::collections::HashSet::new();
        for setting in &all {
            for planned in planned_motions(setting, 2) {
                assert!(keys.insert(planned.key()), "{:?} twice", planned.key());
            }
        }
        let key = |change: &dyn Fn(&mut MethodSetting), condition| {
            let mut setting = DEFAULTS.method_setting(Method::Laban, selection);
            change(&mut setting);
            let planned = PlannedMotion {
                variant: 0,
                setting: &setting,
                condition,
                prompt: 0,
                repeat: 0,
            };
            planned.key()
        };
        let strong = factor_condition(Tag::Strong);
        let (same, steps) = (
            |_: &mut MethodSetting| (),
            |s: &mut MethodSetting| s.steps = 7,
        );
        let rate = |s: &mut MethodSetting| s.guidance.learning_rate *= 2.0;
        assert_eq!(key(&same, strong), key(&same, strong));
        for change in [&steps as &dyn Fn(&mut MethodSetting), &rate] {
            let (one, other) = (key(&same, strong), key(change, strong));
            assert_eq!(one.id, other.id);
            assert_ne!(one.options, other.options);
        }
        // Guidance options do not matter for the sentence alone.
        assert_eq!(
            key(&rate, Condition::Nothing),
            key(&same, Condition::Nothing)
        );
    }
}
