//! Training of small evaluators on synthetic motions.

mod common;
mod runs;

use std::fs;
use std::path::Path;
use std::time::Duration;

use burn::tensor::Device;
use common::{Clip, pack_clips};
use lamogen_data::{Dataset, Split};
use lamogen_eval::{CaptionedMotions, Evaluator, evaluate_real_motions};
use lamogen_motion::POSE_FEATURES;
use lamogen_train::{
    EvaluatorTrainingConfig, MatchingError, MatchingTask, Negatives, RunLength, RunOutcome,
    RunPlan, StepReport, TrainError, Trainer, TrainingTask, captioned, identity, run,
};
use runs::{StopAfter, tokens};
use serde_json::json;

const PACES: [(&str, f32); 4] = [
    ("slowly", 0.1),
    ("at ease", 0.3),
    ("fast", 0.7),
    ("madly", 1.2),
];
const REACHES: [(&str, f32); 2] = [("a little", 0.05), ("widely", 0.2)];

/// A data set of eight kinds of motions, each with four motions for training and two for validation.
fn dataset(folder: &Path) -> Dataset {
    let mut clips = Vec::new();
    for number in 0..6 {
        for (place, (pace, per_frame)) in PACES.into_iter().enumerate() {
            for (reach, metres) in REACHES {
                clips.push(Clip {
                    split: if number < 4 { "train" } else { "val" },
                    content: Some(pace),
                    style: Some(reach),
                    captions: vec![
                        format!("someone swings {reach}, {pace}"),
                        format!("it sways {pace} and {reach}"),
                    ],
                    frames: 40 + 3 * number + place,
                    swing: (per_frame, metres),
                    mirrored: number < 2,
                });
            }
        }
    }
    pack_clips(folder, &clips)
}

fn config() -> EvaluatorTrainingConfig {
    let config = json!({
        "evaluator": {
            "dim_pose": POSE_FEATURES, "max_motion_length": 60, "dim_movement_enc_hidden": 24,
            "dim_movement_latent": 24, "dim_motion_hidden": 24, "dim_text_hidden": 24, "dim_coemb_hidden": 16,
            "text": { "tokens": { "vocab_size": 300, "context_length": 40, "dim_word": 16 } },
        },
        "matching": { "pairs_per_batch": 8, "margin": 10.0, "crop": 0.2 },
        "optimization": { "learning_rate": 4e-3, "warm_up_steps": 5, "average_decay": 0.9 },
    });
    EvaluatorTrainingConfig::from_json(config.to_string().as_bytes(), "test").unwrap()
}

#[test]
fn motions_find_their_texts_and_the_evaluator_can_be_loaded() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(&folder.path().join("data"));
    let tokens = tokens(&dataset, 40);
    // One negative per text needs more steps than seven.
    for (others, steps) in [(Negatives::All, 100), (Negatives::One, 300)] {
        let mut config = config();
        config.matching.others = others;
        let task = MatchingTask::new(&dataset, &tokens, &config, &Device::flex()).unwrap();
        assert_eq!(task.motions(), 8 * (4 + 2));
        let mut trainer = Trainer::new(&task, &Device::flex());
        let before = task.validate(trainer.average()).unwrap();
        let reports: Vec<StepReport> = (0..steps)
            .map(|_| trainer.advance(Some(steps)).unwrap())
            .collect();
        let mean = |reports: &[StepReport]| {
            reports.iter().map(|report| report.loss).sum::<f64>() / reports.len() as f64
        };
        let (first, last) = (mean(&reports[..5]), mean(&reports[reports.len() - 10..]));
        assert!(last < 0.5 * first, "{others:?}: {first} to {last}");
        // With eight kinds, chance gives the R-precisions 1/8, 2/8 and 3/8.
        let after = task.validate(trainer.average()).unwrap();
        assert!(
            before > 0.6 && after < 0.3,
            "{others:?}: {before} to {after}"
        );

        task.save(trainer.average(), folder.path()).unwrap();
        let evaluator = Evaluator::load(folder.path(), &Device::flex()).unwrap();
        let motions = || captioned(&dataset, Split::Validation, evaluator.network().config());
        let [saved, trained] = [&evaluator, &task.evaluator(trainer.average())]
            .map(|evaluator| CaptionedMotions::embed(evaluator, motions()).unwrap());
        let matching = saved.matching(8, 1).unwrap();
        let expected = trained.matching(8, 1).unwrap();
        assert_eq!(matching.r_precision, expected.r_precision);
        assert!((matching.distance / expected.distance - 1.0).abs() < 1e-4);
        assert!(matching.r_precision[2] > 0.7, "{matching:?}");
        let few = evaluate_real_motions(&saved, 20, 0)
            .unwrap_err()
            .to_string();
        assert!(few.contains("at least 32"), "{few}");
    }
}

#[test]
fn a_seed_determines_the_network() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    let tokens = tokens(&dataset, 40);
    let trained_weights = |seed: u64| {
        let mut config = config();
        config.optimization.seed = seed;
        let task = MatchingTask::new(&dataset, &tokens, &config, &Device::flex()).unwrap();
        let mut trainer = Trainer::new(&task, &Device::flex());
        for _ in 0..4 {
            trainer.advance(Some(4)).unwrap();
        }
        let out = tempfile::tempdir().unwrap();
        task.save(trainer.average(), out.path()).unwrap();
        fs::read(out.path().join("model.safetensors")).unwrap()
    };
    let first = trained_weights(1);
    assert!(
        first == trained_weights(1),
        "the same seed gives other weights"
    );
    assert!(
        first != trained_weights(2),
        "another seed gives the same weights"
    );
}

/// Starts or resumes a run of 10 steps, and stops it after `stop` of them.
fn train(data: &Path, out: &Path, stop: Option<u64>) -> Result<RunOutcome, TrainError> {
    let (dataset, config) = (dataset(data), config());
    let tokens = tokens(&dataset, 40);
    let task = MatchingTask::new(&dataset, &tokens, &config, &Device::flex()).unwrap();
    let plan = RunPlan {
        length: RunLength::Steps(10),
        validate_every: 4,
        checkpoint_every: Duration::from_secs(3600),
    };
    let identity = identity("evaluator", &config, &dataset, &tokens);
    let mut observer = StopAfter(stop);
    run(&task, out, &identity, &plan, &Device::flex(), &mut observer)
}

#[test]
fn a_resumed_run_ends_like_one_that_was_not_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let [data, whole, stopped] = ["data", "whole", "stopped"].map(|name| folder.path().join(name));
    assert!(train(&data, &whole, None).unwrap().finished);
    for step in [3, 6] {
        let outcome = train(&data, &stopped, Some(3)).unwrap();
        assert!(!outcome.finished && outcome.progress.step == step);
    }
    assert_eq!(train(&data, &stopped, None).unwrap().progress.resumed_at, 6);
    for name in [
        "losses.jsonl",
        "model/model.safetensors",
        "model/config.json",
        "model/tokenizer.json",
        "model/mean.npy",
        "model/std.npy",
        "best/model.safetensors",
    ] {
        let [whole, stopped] = [&whole, &stopped].map(|out| fs::read(out.join(name)).unwrap());
        assert!(whole == stopped, "{name} differs");
    }
}

#[test]
fn unusable_data_are_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let config = config();
    let problem = |dataset: &Dataset, context_length: usize| {
        let tokens = tokens(dataset, context_length);
        let task = MatchingTask::new(dataset, &tokens, &config, &Device::flex());
        task.err().unwrap()
    };
    let eight = dataset(&folder.path().join("eight"));
    let error = problem(&eight, 20);
    let sizes = matches!(
        error,
        MatchingError::Context {
            expected: 40,
            found: 20
        }
    );
    assert!(sizes, "{error}");

    // Three motions of which any two have a caption in common.
    let clip = |captions: &[&str], frames: usize| Clip {
        split: "train",
        content: None,
        style: None,
        captions: captions.iter().map(|&caption| caption.into()).collect(),
        frames,
        swing: (0.5, 0.1),
        mirrored: false,
    };
    let clips = [
        clip(&["a man walks", "someone goes"], 40),
        clip(&["Someone goes.", "a dog runs"], 44),
        clip(&["a dog runs", "a man walks"], 64),
    ];
    let same = pack_clips(&folder.path().join("same"), &clips);
    let error = problem(&same, 40).to_string();
    for part in ["at least 2", "4 to 63 frames", "none among 3"] {
        assert!(error.contains(part), "{part} is not in: {error}");
    }
}
