//! Training an evaluator.

use lamogen_data::{LoadOptions, Split};
use lamogen_eval::{CaptionedMotions, Estimate, Evaluator, TextForm, real_motions};
use lamogen_train::{EvaluatorTrainingConfig, MatchingTask, captioned, identity};
use serde_json::json;

use super::{Vocabulary, ended, metadata, open, read, tokens, work};
use crate::arguments::Train;
use crate::console::Console;
use crate::failure::{Code, Failure};
use crate::source::device;

/// Draws of captions and batches behind each figure.
const REPETITIONS: usize = 20;

pub fn run(options: &Train, console: &Console) -> Result<(), Failure> {
    let device = device(options.device)?;
    let config = match options.config.to_str() {
        Some("compact") => EvaluatorTrainingConfig::compact(),
        _ => EvaluatorTrainingConfig::from_file(&options.config)?,
    };
    let TextForm::Tokens {
        vocab_size,
        context_length,
        ..
    } = config.evaluator.text
    else {
        let message = "expected a config whose text is of \"tokens\": networks that read word vectors are loaded, not trained";
        return Err(Failure::new(Code::Usage, message));
    };
    let vocabulary = Vocabulary {
        size: vocab_size,
        context_length,
    };
    let usual = LoadOptions::default();
    let longest = config.evaluator.max_motion_length;
    let dataset = open(options, usual.min_frames..=longest, console)?;
    let tokenizer = options.tokenizer.as_deref().map(read).transpose()?;
    let tokens = tokens(tokenizer, vocabulary, &dataset, 0, "", console)?;
    let failed = |error| Failure::new(Code::Input, error);
    let task = MatchingTask::new(&dataset, &tokens, &config, &device).map_err(failed)?;
    let task = task.with_metadata(metadata(options, None));
    let identity = identity("evaluator", &config, &dataset, &tokens);
    let counted = (&task, task.motions());
    let result = work(counted, &identity, &device, |_, _| Ok(()), options, console)?;
    let mut measured = Vec::new();
    let folder = options.out.join("best");
    if result.finished && folder.exists() {
        let evaluator =
            Evaluator::load(&folder, &device).map_err(|error| Failure::new(Code::Input, error))?;
        for split in [Split::Validation, Split::Test] {
            let motions = captioned(&dataset, split, evaluator.network().config());
            let motions = CaptionedMotions::embed(&evaluator, motions);
            let motions = motions.map_err(|error| Failure::new(Code::Run, error))?;
            let Ok(found) = real_motions(&motions, REPETITIONS, 0) else {
                console.notice(format!("{split}: too few motions for batches of 32"));
                continue;
            };
            let text = |place: usize| {
                let estimate = &found.r_precision[place];
                format!("{:.3} ± {:.3}", estimate.mean, estimate.interval)
            };
            let estimate = |estimate: &Estimate| json!({ "mean": estimate.mean, "interval": estimate.interval });
            measured.push(json!({
                "split": split.name(),
                "motions": found.motions,
                "r_precision": found.r_precision.iter().map(estimate).collect::<Vec<_>>(),
                "distance": estimate(&found.distance),
            }));
            if !console.json {
                console.say(format!(
                    "{split}: R-precision of {} real motions, top 1 {}, top 2 {}, top 3 {}",
                    found.motions,
                    text(0),
                    text(1),
                    text(2)
                ))?;
            }
        }
    }
    ended(options, &result, "", &measured, console)
}
