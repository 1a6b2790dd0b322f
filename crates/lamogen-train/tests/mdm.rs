//! Training of a small MDM on synthetic motions.

mod kinds;
mod runs;

use std::fs;
use std::path::Path;
use std::time::Duration;

use burn::tensor::Device;
use lamogen_data::Dataset;
use lamogen_model::{Denoiser, Mdm, MdmConfig, MdmText, NoiseSchedule, TokenBatch};
use lamogen_train::{
    AnyTrainingConfig, CaptionTokens, DenoisingTask, MdmModelConfig, RunLength, RunOutcome,
    RunPlan, Trainer, TrainingConfig, TrainingTask, identity, run,
};
use runs::{StopAfter, tokens};
use serde_json::{Value, json};

fn recipe(arch: &str) -> Value {
    json!({
        "model": {
            "arch": arch, "layers": 2, "latent_dim": 32, "ff_size": 48, "diffusion_steps": 20,
            "clip": { "vocab_size": 300, "context_length": 12, "width": 64, "heads": 1, "layers": 1 },
        },
        "denoising": { "frames_per_batch": 400, "length_buckets": 2, "crop": 0.2, "text_dropout": 0.2 },
        "optimization": { "learning_rate": 4e-3, "warm_up_steps": 5, "average_decay": 0.9 },
    })
}

fn config(arch: &str) -> TrainingConfig<MdmModelConfig> {
    TrainingConfig::from_json(recipe(arch).to_string().as_bytes(), "test").unwrap()
}

/// Starts or resumes a run of 8 steps, and stops it after `stop` of them.
fn train(
    config: &TrainingConfig<MdmModelConfig>,
    (dataset, tokens): (&Dataset, &CaptionTokens),
    out: &Path,
    stop: Option<u64>,
) -> RunOutcome {
    let device = Device::flex();
    let task = DenoisingTask::new(dataset, tokens, config, &device).unwrap();
    let plan = RunPlan {
        length: RunLength::Steps(8),
        validate_every: 4,
        checkpoint_every: Duration::from_secs(3600),
    };
    let identity = identity("denoiser", config, dataset, tokens);
    run(&task, out, &identity, &plan, &device, &mut StopAfter(stop)).unwrap()
}

#[test]
fn a_resumed_run_ends_like_one_that_was_not_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let dataset = kinds::dataset(&folder.join("data"));
    let tokens = tokens(&dataset, 12);
    let data = (&dataset, &tokens);
    let config = config("trans_enc");
    let [whole, stopped] = ["whole", "stopped"].map(|name| folder.join(name));
    assert!(train(&config, data, &whole, None).finished);
    for step in [3, 6] {
        let outcome = train(&config, data, &stopped, Some(3));
        assert_eq!((outcome.finished, outcome.progress.step), (false, step));
    }
    assert!(train(&config, data, &stopped, None).finished);
    for name in [
        "losses.jsonl",
        "model/model.safetensors",
        "model/clip.safetensors",
        "model/args.json",
        "model/tokenizer.json",
        "model/words.txt",
        "model/mean.npy",
        "best/model.safetensors",
    ] {
        let [a, b] = [&whole, &stopped].map(|run| fs::read(run.join(name)).unwrap());
        assert!(a == b, "{name} differs");
    }
}

#[test]
fn encoders_and_decoders_learn_the_clean_motion() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = kinds::dataset(folder.path());
    let tokens = tokens(&dataset, 12);
    for arch in ["trans_enc", "trans_dec"] {
        let config = config(arch);
        let task = DenoisingTask::new(&dataset, &tokens, &config, &Device::flex()).unwrap();
        let mut trainer = Trainer::new(&task, &Device::flex());
        let before = task.validate(trainer.average()).unwrap();
        let reports = (0..80).map(|_| trainer.advance(Some(80)).unwrap().loss);
        let losses: Vec<f64> = reports.collect();
        let after = task.validate(trainer.average()).unwrap();
        let mean = |losses: &[f64]| losses.iter().sum::<f64>() / losses.len() as f64;
        let (first, last) = (mean(&losses[..10]), mean(&losses[70..]));
        assert!(last < 0.8 * first, "{arch}: {first} to {last}");
        assert!(after < 0.8 * before, "{arch}: {before} to {after}");
    }
}

#[test]
fn the_text_tower_and_the_frames_are_written_as_they_were_trained() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = kinds::dataset(&folder.path().join("data"));
    let tokens = tokens(&dataset, 12);
    let (config, device) = (config("trans_enc"), Device::flex());
    let task = DenoisingTask::new(&dataset, &tokens, &config, &device).unwrap();
    let mut trainer = Trainer::new(&task, &device);
    for _ in 0..4 {
        trainer.advance(Some(4)).unwrap();
    }
    let out = folder.path().join("model");
    fs::create_dir(&out).unwrap();
    task.save(trainer.average(), &out).unwrap();

    let arguments = MdmConfig::from_file(out.join("args.json")).unwrap();
    assert_eq!(
        (arguments.text_dropout, arguments.noise_schedule),
        (0.2, NoiseSchedule::Cosine { timesteps: 20 })
    );
    let weights = arguments.open_weights(out.join("model.safetensors"));
    let weights = weights.unwrap();
    let arguments = arguments.with_sizes_of(&weights).unwrap();
    let text = MdmText::clip(out.join("clip.safetensors"), &device).unwrap();
    let again = Mdm::load(&weights, &arguments, text, &device).unwrap();
    let encode = |network: &Mdm| {
        let ids = tokens.tokenizer().encode("it is quick").unwrap();
        let tokens = TokenBatch::new([&ids], &device);
        let prompt = network.encode(&tokens);
        let without = network.unconditional(&prompt, &tokens);
        let time = network.embed_timesteps(&[7]);
        let all = [prompt.embedding, without.embedding, time];
        all.map(|numbers| numbers.try_into_vec_as::<f32>().unwrap())
    };
    // Loaded weights are transposed in memory, so products may be rounded differently.
    for (before, after) in encode(trainer.average()).iter().zip(encode(&again)) {
        let pairs = before.iter().zip(&after);
        let distance = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(distance < 1e-5 && before.len() == after.len(), "{distance}");
    }
    let losses = [trainer.average(), &again].map(|network| task.validate(network).unwrap());
    assert!((losses[0] - losses[1]).abs() < 1e-6, "{losses:?}");
    // What the text adds was learned, and a text that is left out adds the bias.
    let [with, without, _] = encode(&again);
    assert_ne!(with, without);
}

#[test]
fn a_recipe_with_an_arch_is_an_mdm_and_its_mistakes_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mine.json");
    let read = |recipe: &Value| {
        fs::write(&path, recipe.to_string()).unwrap();
        AnyTrainingConfig::from_file(&path)
    };
    let found = read(&recipe("trans_dec")).unwrap();
    assert_eq!(found, AnyTrainingConfig::Mdm(config("trans_dec")));
    for (pointer, value, parts) in [
        ("/model/arch", json!("gru"), ["gru", "trans_enc"]),
        ("/model/latent_dim", json!(30), ["model.latent_dim", "30"]),
        ("/model/layers", json!(0), ["model.layers", "found 0"]),
        ("/model/ff_size", json!(0), ["model.ff_size", "found 0"]),
        ("/model/diffusion_steps", json!(0), ["diffusion_steps", "0"]),
        ("/model/clip/heads", json!(2), ["model.clip", "2 heads"]),
        ("/model/clip/width", json!(48), ["model.clip", "48"]),
        (
            "/denoising/laban_share",
            json!(0.5),
            ["denoising.laban_share", "MDM"],
        ),
        (
            "/denoising/noises_per_motion",
            json!(21),
            ["noises_per_motion", "20 timesteps"],
        ),
    ] {
        let mut recipe = recipe("trans_enc");
        recipe["denoising"]["laban_share"] = 0.into();
        recipe["denoising"]["noises_per_motion"] = 1.into();
        *recipe.pointer_mut(pointer).unwrap() = value;
        let message = read(&recipe).unwrap_err().to_string();
        assert!(message.contains("mine.json"), "{message}");
        assert!(parts.iter().all(|part| message.contains(part)), "{message}");
    }
}

#[test]
fn the_recipe_that_comes_with_the_crate_is_valid() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/mdm-compact.json");
    assert!(matches!(
        AnyTrainingConfig::from_file(path),
        Ok(AnyTrainingConfig::Mdm(_))
    ));
}
