//! Several motions for some texts, for MultiModality.

use super::setting::{MethodSetting, PlannedMotion};

/// The texts with several motions, as the public evaluation has them. A text that motions are generated for with tags has one of them, in turn.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Multimodality {
    /// The number of motions of each text.
    pub motions: u64,
    /// The places of the texts' prompts, for each repeat.
    pub prompts: Vec<Vec<usize>>,
}

impl Multimodality {
    /// Returns the motions for the texts of a repeat: for each text all of its motions. The first ones are motions of the setting as well.
    pub fn planned_motions<'a>(
        &'a self,
        setting: &'a MethodSetting,
        repeat: u64,
    ) -> impl Iterator<Item = impl Iterator<Item = PlannedMotion<'a>>> {
        let prompts = self.prompts[repeat as usize].iter().enumerate();
        prompts.map(move |(place, &prompt)| {
            let condition = setting.conditions[place % setting.conditions.len()];
            (0..self.motions).map(move |variant| PlannedMotion {
                setting,
                condition,
                prompt,
                repeat,
                variant,
            })
        })
    }
}
