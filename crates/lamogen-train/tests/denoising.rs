//! Training of small denoisers on synthetic motions.

mod kinds;
mod runs;

use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use burn::tensor::{Device, Tensor};
use kinds::dataset;
use lamogen_guide::{LossTarget, LossTerm};
use lamogen_model::{Checkpoint, MotionDiffuse, Prediction};
use lamogen_motion::{JOINTS, POSE_FEATURES, npy};
use lamogen_train::{
    DenoisingTask, LogLine, LossWeights, RunLength, RunOutcome, RunPlan, StepReport, TrainError,
    Trainer, TrainingConfig, TrainingTask, identity, run,
};
use runs::{StopAfter, tokens};
use serde_json::json;

fn config(prediction: &str) -> TrainingConfig {
    let config = json!({
        "model": {
            "input_feats": POSE_FEATURES, "num_frames": 90, "latent_dim": 32, "ff_size": 48,
            "num_layers": 2, "num_heads": 4, "text_latent_dim": 24, "text_ff_size": 32,
            "text_num_heads": 2, "num_text_layers": 1,
            "clip": { "vocab_size": 300, "context_length": 12, "width": 24, "heads": 2, "layers": 1 },
            "prediction": prediction,
        },
        "denoising": { "frames_per_batch": 400, "length_buckets": 2, "crop": 0.2 },
        "optimization": { "learning_rate": 4e-3, "warm_up_steps": 5, "average_decay": 0.9 },
    });
    TrainingConfig::from_json(config.to_string().as_bytes(), "test").unwrap()
}

/// Starts or resumes a run of 12 steps, and stops it after `stop` of them.
fn train(
    config: &TrainingConfig,
    data: &Path,
    out: &Path,
    stop: Option<u64>,
    checkpoint_every: Duration,
) -> Result<RunOutcome, TrainError> {
    let dataset = dataset(data);
    let tokens = tokens(&dataset, 12);
    let device = Device::flex();
    let task = DenoisingTask::new(&dataset, &tokens, config, &device)?;
    let plan = RunPlan {
        length: RunLength::Steps(12),
        validate_every: 5,
        checkpoint_every,
    };
    let identity = identity("denoiser", config, &dataset, &tokens);
    run(&task, out, &identity, &plan, &device, &mut StopAfter(stop))
}

const NEVER: Duration = Duration::from_secs(3600);

/// Reads the files that a finished run leaves.
fn results(out: &Path) -> Vec<(String, Vec<u8>)> {
    let names = [
        "losses.jsonl",
        "model/model.safetensors",
        "model/config.json",
        "model/tokenizer.json",
        "model/mean.npy",
        "model/std.npy",
        "best/model.safetensors",
    ];
    let read = |name: &str| (name.to_owned(), fs::read(out.join(name)).unwrap());
    names.map(read).into_iter().collect()
}

/// Asserts that two runs left the same files.
fn assert_same_results(a: &Path, b: &Path, case: &str) {
    for ((name, a), (_, b)) in results(a).into_iter().zip(results(b)) {
        assert!(a == b, "{case}: {name} differs");
    }
}

#[test]
fn a_resumed_run_ends_like_one_that_was_not_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut config = config("sample");
    config.denoising.losses = LossWeights {
        change: 0.5,
        velocity: 0.1,
        ..LossWeights::default()
    };
    let data = folder.join("data");
    let whole = folder.join("whole");
    let outcome = train(&config, &data, &whole, None, NEVER).unwrap();
    assert!(outcome.finished && outcome.progress.step == 12 && outcome.best <= outcome.last);

    // The run is stopped after every third step, with a checkpoint.
    let stopped = folder.join("stopped");
    for step in [3, 6, 9] {
        let outcome = train(&config, &data, &stopped, Some(3), NEVER).unwrap();
        assert!(!outcome.finished && outcome.progress.step == step);
    }
    let outcome = train(&config, &data, &stopped, None, NEVER).unwrap();
    assert!(outcome.finished && outcome.progress.resumed_at == 9);
    assert_same_results(&whole, &stopped, "stopped three times");

    // A lost machine: the last checkpoint is older than the log and the models, and another one is unfinished.
    let lost = folder.join("lost");
    train(&config, &data, &lost, Some(7), NEVER).unwrap();
    let newest = lost.join("checkpoints/step-00000007");
    let kept = folder.join("kept");
    fs::rename(&newest, &kept).unwrap();
    let outcome = train(&config, &data, &lost, Some(10), NEVER).unwrap();
    assert_eq!(outcome.progress.resumed_at, 0, "no checkpoint is left");
    fs::remove_dir_all(lost.join("checkpoints")).unwrap();
    fs::create_dir_all(lost.join("checkpoints/.step-00000010")).unwrap();
    fs::rename(&kept, &newest).unwrap();
    let outcome = train(&config, &data, &lost, None, NEVER).unwrap();
    assert_eq!((outcome.progress.resumed_at, outcome.finished), (7, true));
    assert_same_results(&whole, &lost, "lost");

    let unfinished = lost.join("checkpoints/.step-00000010");
    assert!(!unfinished.exists(), "unfinished checkpoints are removed");

    // A finished run has nothing left to do.
    let outcome = train(&config, &data, &whole, None, NEVER).unwrap();
    assert!(outcome.finished && outcome.progress.resumed_at == 12);
    assert_same_results(&whole, &stopped, "called again");
}

#[test]
fn two_checkpoints_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    let (data, out) = (folder.path().join("data"), folder.path().join("run"));
    train(&config("sample"), &data, &out, None, Duration::ZERO).unwrap();
    let mut names: Vec<_> = fs::read_dir(out.join("checkpoints"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    assert_eq!(names, ["step-00000011", "step-00000012"]);
}

#[test]
fn a_folder_with_another_run_is_refused_and_unchanged() {
    let folder = tempfile::tempdir().unwrap();
    let (data, out) = (folder.path().join("data"), folder.path().join("run"));
    let first = config("sample");
    train(&first, &data, &out, Some(2), NEVER).unwrap();
    let before = fs::read(out.join("losses.jsonl")).unwrap();
    let mut other = first.clone();
    other.optimization.learning_rate = 1e-3;
    let error = train(&other, &data, &out, None, NEVER).unwrap_err();
    let message = error.to_string();
    for part in ["optimization.learning_rate", "0.001", "0.004", "run.json"] {
        assert!(message.contains(part), "{part} is not in {message}");
    }
    assert_eq!(fs::read(out.join("losses.jsonl")).unwrap(), before);
}

#[test]
fn a_damaged_checkpoint_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let (data, out) = (folder.path().join("data"), folder.path().join("run"));
    train(&config("sample"), &data, &out, Some(2), NEVER).unwrap();
    let path = out.join("checkpoints/step-00000002/moment_2.bpk");
    let bytes = fs::read(&path).unwrap();
    fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    let error = train(&config("sample"), &data, &out, None, NEVER).unwrap_err();
    assert!(matches!(error, TrainError::Checkpoint { .. }), "{error}");
    assert!(error.to_string().contains("moment_2.bpk"), "{error}");
}

#[test]
fn every_kind_of_prediction_learns_the_clean_motion() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    let tokens = tokens(&dataset, 12);
    for prediction in ["sample", "v_prediction", "epsilon"] {
        let config = config(prediction);
        let task = DenoisingTask::new(&dataset, &tokens, &config, &Device::flex()).unwrap();
        let mut trainer = Trainer::new(&task, &Device::flex());
        let before = task.validate(trainer.average()).unwrap();
        let mut losses = Vec::new();
        for _ in 0..120 {
            losses.push(trainer.advance(Some(120)).unwrap().loss);
        }
        let after = task.validate(trainer.average()).unwrap();
        let mean = |losses: &[f64]| losses.iter().sum::<f64>() / losses.len() as f64;
        let (first, last) = (mean(&losses[..10]), mean(&losses[110..]));
        // Noise is harder to predict: it has more dimensions than the network has channels.
        let share = if prediction == "epsilon" { 0.95 } else { 0.8 };
        assert!(last < share * first, "{prediction}: {first} to {last}");
        assert!(after < share * before, "{prediction}: {before} to {after}");
    }
}

#[test]
fn the_losses_of_the_clean_motion_fall_too() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    let tokens = tokens(&dataset, 12);
    let none = LossWeights::default();
    let parts = [
        (
            "change",
            LossWeights {
                change: 1.0,
                ..none
            },
        ),
        (
            "position",
            LossWeights {
                position: 1.0,
                ..none
            },
        ),
        (
            "velocity",
            LossWeights {
                velocity: 100.0,
                ..none
            },
        ),
        (
            "foot_contact",
            LossWeights {
                foot_contact: 100.0,
                ..none
            },
        ),
    ];
    for (name, losses) in parts {
        let mut config = config("sample");
        config.denoising.losses = losses;
        let task = DenoisingTask::new(&dataset, &tokens, &config, &Device::flex()).unwrap();
        let mut trainer = Trainer::new(&task, &Device::flex());
        let other = |report: &StepReport| report.total_loss - report.loss;
        let first = trainer.advance(Some(60)).unwrap();
        let reports: Vec<StepReport> = (0..59)
            .map(|_| trainer.advance(Some(60)).unwrap())
            .collect();
        let last = reports[49..].iter().map(other).sum::<f64>() / 10.0;
        match name {
            // The network starts with the mean pose, whose feet do not slide, so that this loss does not fall.
            "foot_contact" => assert!(last.is_finite() && last > 0.0, "{name}: {last}"),
            _ => assert!(last < other(&first), "{name}: {} to {last}", other(&first)),
        }
    }
}

/// The positions of all joints, which shall be those of the data; the loss is the mean over joints, times `weight`.
#[derive(Debug)]
struct Positions {
    weight: f32,
    values: usize,
}

impl LossTerm for Positions {
    fn name(&self) -> String {
        "positions".into()
    }

    fn measure(&self, joints: Tensor<4>, _lengths: &[usize]) -> Tensor<3> {
        let [batch, frames, ..] = joints.dims();
        joints.reshape([batch, frames, 3 * JOINTS])
    }

    fn target(&self, data: Tensor<3>, _lengths: &[usize]) -> LossTarget {
        let weight = (self.weight / JOINTS as f32).sqrt();
        let weight = Tensor::full([1, 1, self.values], weight, &data.device());
        LossTarget {
            values: data,
            weight,
        }
    }
}

#[test]
fn a_term_of_ones_own_is_learned_like_the_losses_there_are() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    let tokens = tokens(&dataset, 12);
    let device = Device::flex();
    for prediction in ["sample", "epsilon"] {
        let plain = config(prediction);
        let mut own = plain.clone();
        own.denoising.losses.position = 2.0;
        let own = DenoisingTask::new(&dataset, &tokens, &own, &device).unwrap();
        let term = Positions {
            weight: 2.0,
            values: 1,
        };
        let with_term = DenoisingTask::new(&dataset, &tokens, &plain, &device).unwrap();
        let with_term = with_term.with_loss_term(Arc::new(term)).unwrap();
        let without = DenoisingTask::new(&dataset, &tokens, &plain, &device).unwrap();
        let [own, with_term, without] = [&own, &with_term, &without].map(|task| {
            let mut trainer = Trainer::new(task, &device);
            let reports: Vec<StepReport> =
                (0..5).map(|_| trainer.advance(Some(5)).unwrap()).collect();
            reports
        });
        for (own, with_term) in own.iter().zip(&with_term) {
            for (own, with_term) in [
                (own.loss, with_term.loss),
                (own.total_loss, with_term.total_loss),
                (own.gradient_norm, with_term.gradient_norm),
            ] {
                let difference = (own - with_term).abs() / own;
                assert!(difference < 1e-3, "{prediction}: {own} {with_term}");
            }
        }
        assert!(with_term[0].total_loss > 1.01 * without[0].total_loss);
    }
    let plain = config("sample");
    let task = DenoisingTask::new(&dataset, &tokens, &plain, &device).unwrap();
    let wide = Positions {
        weight: 1.0,
        values: 5,
    };
    let error = task.with_loss_term(Arc::new(wide)).err().unwrap();
    let message = error.to_string();
    assert!(
        message.contains("`positions`: expected weights of the shape"),
        "{message}"
    );
}

#[test]
fn a_larger_network_goes_on_where_a_smaller_one_stands() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    let tokens = tokens(&dataset, 12);
    let device = Device::flex();
    let small = config("sample");
    let task = DenoisingTask::new(&dataset, &tokens, &small, &device).unwrap();
    let mut trainer = Trainer::new(&task, &device);
    for _ in 0..30 {
        trainer.advance(Some(30)).unwrap();
    }
    let network = trainer.average().clone();
    let before = task.validate(&network).unwrap();

    let mut large = small.clone();
    large.model.num_layers += 2;
    let task = DenoisingTask::new(&dataset, &tokens, &large, &device).unwrap();
    let task = task.with_initial_network(network.clone()).unwrap();
    let mut trainer = Trainer::new(&task, &device);
    let layers = trainer.average().config().num_layers;
    assert_eq!(layers, small.model.num_layers + 2);
    let begun = task.validate(trainer.average()).unwrap();
    assert!((begun - before).abs() < 1e-6 * before, "{begun} {before}");
    for _ in 0..60 {
        trainer.advance(Some(60)).unwrap();
    }
    let after = task.validate(trainer.average()).unwrap();
    assert!(after < before, "{before} to {after}");

    // Fewer layers are another network.
    let task = DenoisingTask::new(&dataset, &tokens, &small, &device).unwrap();
    let error = task.with_initial_network(trainer.average().clone()).err();
    let message = error.unwrap().to_string();
    assert!(message.contains("num_layers"), "{message}");
}

#[test]
fn a_run_leaves_a_model_that_can_be_loaded() {
    let folder = tempfile::tempdir().unwrap();
    let (data, out) = (folder.path().join("data"), folder.path().join("run"));
    let config = config("v_prediction");
    train(&config, &data, &out, None, NEVER).unwrap();
    let checkpoint = Checkpoint::open(out.join("model/model.safetensors")).unwrap();
    let saved = fs::read(out.join("model/config.json")).unwrap();
    let sizes = lamogen_model::ModelConfig::from_json(&saved, "config.json").unwrap();
    assert_eq!(sizes.prediction, Prediction::V);
    let network: MotionDiffuse = checkpoint.load(&sizes, &Device::flex()).unwrap();
    let dataset = dataset(&data);
    let tokens = tokens(&dataset, 12);
    let task = DenoisingTask::new(&dataset, &tokens, &config, &Device::flex()).unwrap();
    let lines = LogLine::read(out.join("losses.jsonl")).unwrap();
    assert_eq!(lines.len(), 12 + 3);
    let last = lines.iter().rev().find_map(|line| match line {
        LogLine::Validation {
            validation_loss, ..
        } => Some(*validation_loss),
        LogLine::Step(_) => None,
    });
    assert!((task.validate(&network).unwrap() / last.unwrap() - 1.0).abs() < 1e-5);
}

#[test]
fn motions_that_are_too_short_for_the_network_are_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    let tokens = tokens(&dataset, 12);
    let mut config = config("sample");
    (config.model.num_frames, config.model.min_frames) = (900, Some(800));
    let Err(error) = DenoisingTask::new(&dataset, &tokens, &config, &Device::flex()) else {
        panic!("expected an error");
    };
    let message = error.to_string();
    assert!(
        message.contains("train") && message.contains("800"),
        "{message}"
    );
}

#[test]
fn two_processes_cannot_train_in_one_folder() {
    let folder = tempfile::tempdir().unwrap();
    let (data, out) = (folder.path().join("data"), folder.path().join("run"));
    fs::create_dir_all(&out).unwrap();
    let lock = fs::File::create(out.join(".lock")).unwrap();
    lock.lock().unwrap();
    let error = train(&config("sample"), &data, &out, None, NEVER).unwrap_err();
    assert!(matches!(error, TrainError::Busy { .. }), "{error}");
    drop(lock);
    train(&config("sample"), &data, &out, Some(1), NEVER).unwrap();
}

#[test]
fn lines_of_losses_after_the_checkpoint_may_be_damaged_but_none_before() {
    let folder = tempfile::tempdir().unwrap();
    let (data, out) = (folder.path().join("data"), folder.path().join("run"));
    let whole = folder.path().join("whole");
    train(&config("sample"), &data, &whole, None, NEVER).unwrap();
    train(&config("sample"), &data, &out, Some(4), NEVER).unwrap();
    let path = out.join("losses.jsonl");
    let good = fs::read(&path).unwrap();
    fs::write(
        &path,
        [&good[..], b"{\"step\":5,\"lo\0\0\0\n\xff\n"].concat(),
    )
    .unwrap();
    train(&config("sample"), &data, &out, Some(1), NEVER).unwrap();
    fs::write(&path, &good[..good.len() / 2]).unwrap();
    let error = train(&config("sample"), &data, &out, None, NEVER).unwrap_err();
    assert!(error.to_string().contains("losses.jsonl"), "{error}");
    let restored = fs::read(whole.join("losses.jsonl")).unwrap();
    fs::write(&path, restored).unwrap();
    train(&config("sample"), &data, &out, None, NEVER).unwrap();
    assert_same_results(&whole, &out, "repaired");
}

#[test]
fn longer_motions_are_used_in_parts() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    let tokens = tokens(&dataset, 12);
    let mut config = config("sample");
    config.model.num_frames = 50;
    let task = DenoisingTask::new(&dataset, &tokens, &config, &Device::flex()).unwrap();
    assert_eq!(task.motions(), 12, "none is too long");
    let mut trainer = Trainer::new(&task, &Device::flex());
    let report = trainer.advance(None).unwrap();
    assert!(report.frames <= 50 * report.motions);
    assert!(task.validate(trainer.average()).unwrap().is_finite());
}

/// A config with every condition: paraphrased captions, captions that are left out, Laban features, sentences.
fn with_conditions() -> TrainingConfig {
    let mut config = config("sample");
    config.denoising = lamogen_train::DenoisingConfig {
        phrasings: 3,
        text_dropout: 0.3,
        laban_share: 0.5,
        source_balance: 0.5,
        sentences_per_batch: 4,
        sentence_weight: 0.5,
        ..config.denoising
    };
    config
}

fn sentences(
    folder: &Path,
    tokens: &lamogen_train::CaptionTokens,
) -> lamogen_train::SentenceEmbeddings {
    let path = folder.join("sentences.npy");
    let rows: Vec<f32> = (0..6 * 5).map(|i| (i as f32 * 1.3).sin()).collect();
    npy::write(&path, &rows, &[6, 5]).unwrap();
    let lines = "a slow one\na quick one\nit is slow\nit is quick\nvery quick\nslow\n";
    fs::write(path.with_extension("txt"), lines).unwrap();
    lamogen_train::SentenceEmbeddings::read(&path, tokens.tokenizer()).unwrap()
}

#[test]
fn conditions_are_learned_and_a_run_with_them_can_be_resumed() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let data = dataset(&folder.join("data"));
    let tokens = tokens(&data, 12);
    let (config, device) = (with_conditions(), Device::flex());
    let sentences = sentences(folder, &tokens);
    let task = DenoisingTask::new(&data, &tokens, &config, &device).unwrap();
    let task = task.with_sentences(&sentences);
    let condition = task.model().laban_condition.expect("measured");
    assert!(condition.std.iter().all(|std| *std > 0.0));
    let plan = RunPlan {
        length: RunLength::Steps(12),
        validate_every: 5,
        checkpoint_every: NEVER,
    };
    let identity = identity("denoiser", &config, &data, &tokens);
    let train = |out: &str, stop| {
        let out = folder.join(out);
        run(&task, &out, &identity, &plan, &device, &mut StopAfter(stop)).unwrap()
    };
    train("whole", None);
    train("parts", Some(7));
    train("parts", None);
    let [whole, parts] = ["whole", "parts"].map(|name| folder.join(name));
    assert_same_results(&whole, &parts, "with conditions");
    // The total loss includes that of the sentences, and the folder has all files of a model.
    let losses = LogLine::read(whole.join("losses.jsonl")).unwrap();
    let steps = losses.iter().filter_map(|line| match line {
        LogLine::Step(report) => Some(report),
        LogLine::Validation { .. } => None,
    });
    assert!(steps.clone().count() == 12 && steps.clone().all(|step| step.total_loss > step.loss));
    let words = fs::read_to_string(whole.join("model/words.txt")).unwrap();
    assert!(words.lines().any(|word| word == "quick"));
    let json = fs::read(whole.join("model/config.json")).unwrap();
    let model = lamogen_model::ModelConfig::from_json(&json, "config.json").unwrap();
    assert_eq!(model.laban_condition, Some(condition));
    let weights = Checkpoint::open(whole.join("model/model.safetensors")).unwrap();
    weights.load(&model, &device).unwrap();
}

#[test]
fn the_target_of_guidance_distillation_depends_on_the_text() {
    let folder = tempfile::tempdir().unwrap();
    let data = dataset(folder.path());
    let tokens = tokens(&data, 12);
    let device = Device::flex();
    let mut config = config("sample");
    let first = MotionDiffuse::initial(&config.model, 5, &device);
    let loss_at = |config: &TrainingConfig| {
        let task = DenoisingTask::new(&data, &tokens, config, &device).unwrap();
        let task = task.with_initial_network(first.clone()).unwrap();
        Trainer::new(&task, &device).advance(Some(1)).unwrap().loss
    };
    // A network with initial weights predicts the same for every sentence, so that guidance has no effect.
    let plain = loss_at(&config);
    config.denoising.text_scale = 3.0;
    assert!((loss_at(&config) - plain).abs() < 1e-6 * plain);
    // A network that distinguishes sentences changes the target.
    let text_dependent = MotionDiffuse::new(&config.model, &device);
    let loss_at = |config: &TrainingConfig| {
        let task = DenoisingTask::new(&data, &tokens, config, &device).unwrap();
        let task = task.with_initial_network(text_dependent.clone()).unwrap();
        Trainer::new(&task, &device).advance(Some(1)).unwrap().loss
    };
    let scaled = loss_at(&config);
    config.denoising.text_scale = 1.0;
    assert!((loss_at(&config) - scaled).abs() > 1e-6 * scaled);
}

#[test]
fn files_of_sentences_that_do_not_fit_together_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let data = dataset(folder.path());
    let tokens = tokens(&data, 12);
    let path = folder.path().join("s.npy");
    let refused = |rows: usize, text: &str, numbers: f32| {
        npy::write(&path, &vec![numbers; rows * 3], &[rows, 3]).unwrap();
        fs::write(path.with_extension("txt"), text).unwrap();
        let refused = lamogen_train::SentenceEmbeddings::read(&path, tokens.tokenizer());
        refused.expect_err("they do not fit").to_string()
    };
    assert!(refused(3, "one\nquick\n", 1.0).contains("2 sentences"));
    assert!(refused(1, "one\n", 1.0).contains("at least two"));
    assert!(refused(2, "one\nquick\n", 0.0).contains("row 0"));
    fs::remove_file(path.with_extension("txt")).unwrap();
    let missing = lamogen_train::SentenceEmbeddings::read(&path, tokens.tokenizer());
    assert!(missing.unwrap_err().to_string().contains("s.txt"));
    fs::write(&path, "").unwrap();
    let empty = lamogen_train::SentenceEmbeddings::read(&path, tokens.tokenizer());
    let message = empty.unwrap_err().to_string();
    assert_eq!(message.matches("s.npy").count(), 1, "{message}");
}

#[test]
fn the_recipes_of_the_library_are_valid() {
    for name in ["compact", "compact-finish", "open", "open-finish"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("configs/{name}.json"));
        let config: TrainingConfig = TrainingConfig::from_file(path).unwrap();
        assert_eq!(config.model.input_feats, POSE_FEATURES);
    }
}
