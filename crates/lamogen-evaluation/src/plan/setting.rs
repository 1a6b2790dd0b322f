//! The settings, and the motions that are generated with them.

use lamogen::guide::prompt_with_tags;
use lamogen::{COMPONENTS, Guidance, Request, Scale};
use lamogen_data::Checksum;

use super::super::record::RecordKey;
use super::condition::Condition;
use super::method::Method;
use super::prompts::{EvalPrompt, PromptSelection};

/// A method with its options, conditions and prompts.
#[derive(Clone, Debug, PartialEq)]
pub struct MethodSetting {
    /// The unique name of the setting, which is part of the record keys.
    pub name: String,
    pub method: Method,
    pub guidance: Guidance,
    pub steps: usize,
    pub conditions: Vec<Condition>,
    /// The prompts that the setting is used for.
    pub prompts: PromptSelection,
}

impl MethodSetting {
    /// Whether both settings generate the same motions.
    pub fn generates_same_motions(&self, other: &MethodSetting) -> bool {
        self.guidance == other.guidance
            && self.steps == other.steps
            && self.conditions == other.conditions
    }
}

/// One motion of the plan.
#[derive(Clone, Copy, Debug)]
pub struct PlannedMotion<'a> {
    pub setting: &'a MethodSetting,
    pub condition: Condition,
    /// The place of the prompt among all prompts.
    pub prompt: usize,
    /// The number of the repeat, from 0.
    pub repeat: u64,
    /// The number of the motion among those of one prompt, condition and repeat: above 0 only for MultiModality.
    pub variant: u64,
}

impl PlannedMotion<'_> {
    /// Returns the key of the motion's record.
    pub fn key(&self) -> RecordKey {
        let PlannedMotion {
            setting,
            condition,
            prompt,
            repeat,
            variant,
        } = self;
        let (guidance, phrase) = match condition {
            Condition::Nothing => (None, ""),
            Condition::Factor(..) => (Some(&setting.guidance), ""),
            Condition::Phrase(tag) => (None, tag.phrase()),
        };
        let mut options = Checksum::new(0);
        options.add(format!("{} {guidance:?}{phrase}", setting.steps).as_bytes());
        let variant = match variant {
            0 => String::new(),
            variant => format!(" / {variant}"),
        };
        RecordKey {
            id: format!(
                "{} / {condition} / {prompt} / {repeat}{variant}",
                setting.name
            ),
            options: format!("{:016x}", options.value()),
        }
    }

    /// Returns the request for the motion. For one prompt and repeat, all settings and conditions have the same start
    /// noise.
    pub fn request(&self, prompt: &EvalPrompt) -> Request {
        let caption = prompt.caption(self.repeat);
        let text = match self.condition {
            Condition::Phrase(tag) => prompt_with_tags(caption, [tag]),
            _ => caption.to_owned(),
        };
        let request = self.unguided(prompt, text);
        match self.condition {
            Condition::Factor(component, factor) => {
                let mut factors = [1.0; COMPONENTS];
                factors[component.index()] = factor;
                let scale = Scale::new(factors).expect("factors of the plan are finite");
                request.scale(scale).guidance(self.setting.guidance.clone())
            }
            Condition::Nothing | Condition::Phrase(_) => request,
        }
    }

    /// Returns the request for the motion of the sentence alone, which the motion is compared with.
    pub fn baseline(&self, prompt: &EvalPrompt) -> Request {
        self.unguided(prompt, prompt.caption(self.repeat).to_owned())
    }

    /// Returns the request for a motion of `text` without guidance.
    fn unguided(&self, prompt: &EvalPrompt, text: String) -> Request {
        Request::new(text)
            .frames(prompt.frames(self.repeat))
            .steps(self.setting.steps)
            .seed(VARIANT_SEEDS * self.variant + 100_000 * self.repeat + self.prompt as u64)
    }
}

/// How far the seeds of two motions of one prompt are from each other: further than those of any prompts and repeats.
const VARIANT_SEEDS: u64 = 1 << 40;

/// Returns all motions of a setting.
pub fn planned_motions(
    setting: &MethodSetting,
    repeats: u64,
) -> impl Iterator<Item = PlannedMotion<'_>> {
    let conditions = setting.conditions.iter();
    conditions.flat_map(move |&condition| {
        (0..repeats).flat_map(move |repeat| {
            setting.prompts.iter().map(move |prompt| PlannedMotion {
                setting,
                condition,
                prompt,
                repeat,
                variant: 0,
            })
        })
    })
}
