//! Training an evaluator.

use lamogen_data::{LoadOptions, Split};
use lamogen_eval::{CaptionedMotions, Estimate, Evaluator, TextForm, evaluate_real_motions};
use lamogen_train::{EvaluatorTrainingConfig, MatchingTask, captioned, identity};
use serde_json::json;

use super::{
    Vocabulary, caption_tokens, metadata, open_dataset, read_file, report_outcome, run_training,
};
use crate::arguments::TrainArguments;
use crate::console::Console;
use crate::failure::{Failure, FailureCode};
use crate::source::open_device;

/// The number of random draws of captions and batches for each estimate.
const REPETITIONS: usize = 20;

/// Trains an evaluator, and measures it on real motions.
pub fn run(options: &TrainArguments, console: &Console) -> Result<(), Failure> {
    let device = open_device(options.device)?;
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
        return Err(Failure::new(FailureCode::Usage, message));
    };
    let vocabulary = Vocabulary {
        size: vocab_size,
        context_length,
    };
    let shortest = LoadOptions::default().min_frames;
    let longest = config.evaluator.max_motion_length;
    let dataset = open_dataset(options, shortest..=longest, console)?;
    let tokenizer = options.tokenizer.as_deref().map(read_file).transpose()?;
    let tokens = caption_tokens(tokenizer, vocabulary, &dataset, 0, "", console)?;
    let failed = |error| Failure::new(FailureCode::Input, error);
    let task = MatchingTask::new(&dataset, &tokens, &config, &device).map_err(failed)?;
    let task = task.with_metadata(metadata(options, None));
    let identity = identity("evaluator", &config, &dataset, &tokens);
    let counted_task = (&task, task.motions());
    let outcome = run_training(
        counted_task,
        &identity,
        &device,
        |_, _| Ok(()),
        options,
        console,
    )?;
    let mut measured = Vec::new();
    let folder = options.out.join("best");
    if outcome.finished && folder.exists() {
        let evaluator = Evaluator::load(&folder, &device)
            .map_err(|error| Failure::new(FailureCode::Input, error))?;
        for split in [Split::Validation, Split::Test] {
            let motions = captioned(&dataset, split, evaluator.network().config());
            let motions = CaptionedMotions::embed(&evaluator, motions);
            let motions = motions.map_err(|error| Failure::new(FailureCode::Run, error))?;
            let Ok(scores) = evaluate_real_motions(&motions, REPETITIONS, 0) else {
                console.notice(format!("{split}: too few motions for batches of 32"));
                continue;
            };
            let text = |rank: usize| {
                let estimate = &scores.r_precision[rank];
                format!("{:.3} ± {:.3}", estimate.mean, estimate.interval)
            };
            let estimate = |estimate: &Estimate| json!({ "mean": estimate.mean, "interval": estimate.interval });
            measured.push(json!({
                "split": split.name(),
                "motions": scores.motions,
                "r_precision": scores.r_precision.iter().map(estimate).collect::<Vec<_>>(),
                "distance": estimate(&scores.distance),
            }));
            if !console.json {
                console.print(format!(
                    "{split}: R-precision of {} real motions, top 1 {}, top 2 {}, top 3 {}",
                    scores.motions,
                    text(0),
                    text(1),
                    text(2)
                ))?;
            }
        }
    }
    report_outcome(options, &outcome, "", &measured, console)
}
