//! Files of long motions that were stopped: of the stretches that were finished.

use lamogen::FinishedStretches;
use serde_json::{Map, Value, json};

use crate::arguments::WritingArguments;
use crate::console::Console;
use crate::failure::Failure;
use crate::output::OutputFile;
use crate::scene::Scene;
use crate::source::ModelSource;

/// A long motion of which some stretches were finished when it was stopped.
pub struct UnfinishedMotion<'a> {
    /// The first sentence.
    pub prompt: &'a str,
    pub seed: u64,
    /// The length of the whole motion in seconds.
    pub seconds: f32,
    pub stretches: FinishedStretches,
}

impl UnfinishedMotion<'_> {
    /// Writes the files of the finished stretches, under names that say that it is not the whole ([`OutputFile::unfinished`]).
    pub fn write(
        self,
        outputs: &[OutputFile],
        writing: &WritingArguments,
        source: &ModelSource,
        console: &Console,
    ) -> Result<(), Failure> {
        let facts = self.facts(source);
        let (seconds, is_guided) = (self.stretches.motion.seconds(), self.stretches.is_guided);
        let label = if is_guided { "guided" } else { "text alone" };
        let scene = Scene::from_stretches(label, self.stretches, facts, &source.device());
        for output in outputs {
            let output = output.unfinished();
            output.write(&scene, writing, console)?;
            console.notice(format!(
                "{output} has the first {seconds:.1} s of {:.1} s ({label})",
                self.seconds
            ));
        }
        Ok(())
    }

    /// Returns the facts about the motion that its files contain.
    fn facts(&self, source: &ModelSource) -> Map<String, Value> {
        let licence = source.model.licence().map(ToString::to_string);
        let facts = json!({
            "prompt": self.prompt,
            "seed": self.seed,
            "seconds": self.stretches.motion.seconds(),
            "unfinished": true,
            "model": source.name,
            "licence": licence,
        });
        facts.as_object().cloned().unwrap_or_default()
    }
}
