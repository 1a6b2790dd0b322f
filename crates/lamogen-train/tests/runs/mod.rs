//! Helpers for tests of runs.

use std::ops::ControlFlow;

use lamogen_data::Dataset;
use lamogen_model::{Tokenizer, train_tokenizer};
use lamogen_train::{CaptionTokens, RunObserver, RunProgress, StepReport, TrainingTask};

/// Encodes the captions of a data set with a tokenizer that is trained on them.
pub fn tokens(dataset: &Dataset, context_length: usize) -> CaptionTokens {
    let captions = dataset.entries().iter().flat_map(|entry| &entry.captions);
    let texts: Vec<&str> = captions.map(|caption| &*caption.text).collect();
    let json = train_tokenizer(texts.into_iter(), 300).unwrap();
    let tokenizer = Tokenizer::from_json(&json, "learned", 300, context_length).unwrap();
    CaptionTokens::new(dataset, tokenizer, Some(json), 0).unwrap()
}

/// Stops a run after a number of steps of the current call; `None` never stops it.
pub struct StopAfter(pub Option<u64>);

impl<T: TrainingTask> RunObserver<T> for StopAfter {
    fn step(&mut self, _: &StepReport, progress: &RunProgress) -> ControlFlow<()> {
        match self.0 == Some(progress.step - progress.resumed_at) {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    }
}
