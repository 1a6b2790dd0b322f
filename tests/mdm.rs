//! MDM folders as their users have them: with small networks of random weights.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use lamogen::model::{AnyConfig, Denoiser, SamplingMethod};
use lamogen::motion::{POSE_FEATURES, npy};
use lamogen::{Device, Guidance, LaMoGen, Preset, Request, Tag};
use safetensors::tensor::{Dtype, TensorView};
use tempfile::TempDir;

/// The golden networks of `lamogen-model`.
fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../lamogen-model/tests/golden/mdm")
        .join(name)
}

/// Writes a CLIP text tower with CLIP's vocabulary and otherwise small sizes, under the names of Hugging Face. `output` is
/// the width of the sentence embedding.
fn write_clip(path: &Path, vocabulary: usize, output: usize) {
    const WIDTH: usize = 8;
    let mut shapes: Vec<(String, Vec<usize>)> = vec![
        (
            "embeddings.token_embedding.weight".into(),
            vec![vocabulary, WIDTH],
        ),
        (
            "embeddings.position_embedding.weight".into(),
            vec![77, WIDTH],
        ),
    ];
    let mut layer = |name: &str, shape: &[usize]| {
        shapes.push((format!("{name}.weight"), shape.to_vec()));
        shapes.push((format!("{name}.bias"), shape[..1].to_vec()));
    };
    for part in ["q_proj", "k_proj", "v_proj", "out_proj"] {
        layer(
            &format!("encoder.layers.0.self_attn.{part}"),
            &[WIDTH, WIDTH],
        );
    }
    layer("encoder.layers.0.mlp.fc1", &[4 * WIDTH, WIDTH]);
    layer("encoder.layers.0.mlp.fc2", &[WIDTH, 4 * WIDTH]);
    for norm in [
        "encoder.layers.0.layer_norm1",
        "encoder.layers.0.layer_norm2",
        "final_layer_norm",
    ] {
        layer(norm, &[WIDTH]);
    }
    let mut shapes: Vec<_> = { shapes.into_iter() }
        .map(|(name, shape)| (format!("text_model.{name}"), shape))
        .collect();
    shapes.push(("text_projection.weight".into(), vec![output, WIDTH]));
    write_tensors(path, &shapes);
}

/// Writes tensors of numbers that differ from each other.
fn write_tensors(path: &Path, shapes: &[(String, Vec<usize>)]) {
    let mut state = 1u64;
    let mut number = || {
        state = state
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (state >> 40) as f32 / (1u64 << 24) as f32 - 0.5
    };
    let tensors: Vec<(&String, &Vec<usize>, Vec<u8>)> = { shapes.iter() }
        .map(|(key, shape)| {
            let count: usize = shape.iter().product();
            let bytes = (0..count).flat_map(|_| number().to_le_bytes()).collect();
            (key, shape, bytes)
        })
        .collect();
    let views = tensors.iter().map(|(key, shape, bytes)| {
        (
            *key,
            TensorView::new(Dtype::F32, (*shape).clone(), bytes).unwrap(),
        )
    });
    safetensors::serialize_to_file(views, None::<HashMap<String, String>>, path).unwrap();
}

/// Writes statistics like those of HumanML3D. `contact` is the deviation of the foot contacts.
fn write_statistics(folder: &Path, contact: f32) {
    let mut mean = vec![0.0; POSE_FEATURES];
    let mut std = vec![0.1; POSE_FEATURES];
    mean[3] = 0.93;
    mean[POSE_FEATURES - 4..].fill(0.85);
    std[POSE_FEATURES - 4..].fill(contact);
    npy::write(folder.join("Mean.npy"), &mean, &[POSE_FEATURES]).unwrap();
    npy::write(folder.join("Std.npy"), &std, &[POSE_FEATURES]).unwrap();
}

/// Writes a folder with an encoder of 50 steps.
fn encoder_folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for name in ["args.json", "model000000010.pt"] {
        std::fs::copy(golden("trans_enc").join(name), folder.path().join(name)).unwrap();
    }
    write_clip(&folder.path().join("clip.safetensors"), 49408, 10);
    write_statistics(folder.path(), 0.356);
    folder
}

fn load(folder: &Path) -> LaMoGen {
    LaMoGen::load(folder, &Device::flex()).unwrap()
}

fn refusal(folder: &Path) -> String {
    let error = LaMoGen::load(folder, &Device::flex()).err();
    error.expect("the folder has no model").to_string()
}

fn says(message: &str, parts: &[&str]) {
    for part in parts {
        assert!(message.contains(part), "{part:?} is not in: {message}");
    }
}

#[test]
fn a_folder_of_its_authors_generates_motions() {
    let folder = encoder_folder();
    let model = load(folder.path());
    assert!(matches!(model.config(), AnyConfig::Mdm(config) if config.layers == 2));
    assert_eq!((model.text_scale(), model.preset()), (2.5, Preset::Fast));
    assert_eq!(model.sampling_method(), SamplingMethod::Ddpm);
    assert_eq!(model.default_steps(Preset::Fast), 50);
    assert_eq!(model.network().max_frames(), 196);
    let request = Request::new("a person jumps").frames(40).seed(3);
    let [first, again] = [(); 2].map(|()| model.generate(&request).unwrap());
    assert_eq!(first.baseline.frames(), 40);
    // A seed means one motion, though the sampler is stochastic.
    assert_eq!(first.baseline.joints(), again.baseline.joints());
    let other = model.generate(&request.clone().seed(4)).unwrap();
    assert_ne!(first.baseline.joints(), other.baseline.joints());
    // The named weights are the same file.
    let named = load(&folder.path().join("model000000010.pt"));
    let named = named.generate(&request).unwrap();
    assert_eq!(first.baseline.joints(), named.baseline.joints());
    let deterministic = model.with_sampling_method(SamplingMethod::Ddim);
    let deterministic = deterministic.generate(&request).unwrap();
    assert_ne!(first.baseline.joints(), deterministic.baseline.joints());
}

#[test]
fn guidance_moves_its_embedding() {
    let folder = encoder_folder();
    let request = Request::new("a person jumps")
        .tag(Tag::Strong)
        .frames(40)
        .steps(5)
        .guidance(Guidance::paper());
    let generation = load(folder.path()).generate(&request).unwrap();
    assert_eq!(generation.loss.len(), 5);
    assert_ne!(generation.baseline.joints(), generation.guided.joints());
}

#[test]
fn statistics_of_the_evaluators_are_refused() {
    let folder = encoder_folder();
    write_statistics(folder.path(), 0.0141);
    says(
        &refusal(folder.path()),
        &["Std.npy", "t2m_std.npy", "HumanML3D's own", "0.0141"],
    );
}

#[test]
fn options_without_weights_and_weights_without_options_are_refused() {
    let folder = encoder_folder();
    std::fs::rename(
        folder.path().join("args.json"),
        folder.path().join("arguments.json"),
    )
    .unwrap();
    says(
        &refusal(folder.path()),
        &[
            "model000000010.pt",
            "expected an args.json",
            "arguments.json",
        ],
    );
    let folder = encoder_folder();
    std::fs::remove_file(folder.path().join("model000000010.pt")).unwrap();
    says(
        &refusal(folder.path()),
        &["model000750000.pt", "found", "args.json, clip.safetensors"],
    );
}

#[test]
fn networks_that_are_not_there_are_refused() {
    let folder = encoder_folder();
    for (json, parts) in [
        (r#"{"dataset": "kit"}"#, ["263", "found 251"]),
        (r#"{"arch": "gru"}"#, ["args.json", "found gru"]),
        (
            r#"{"arch": "trans_enc", "layers": 2, "latent_dim": 32}"#,
            ["model000000010.pt", "[16, 10]"],
        ),
        (
            r#"{"arch": "trans_dec", "layers": 2, "latent_dim": 16}"#,
            ["model000000010.pt", "seqTransDecoder"],
        ),
    ] {
        std::fs::write(folder.path().join("args.json"), json).unwrap();
        says(&refusal(folder.path()), &parts);
    }
}

#[test]
fn text_encoders_that_do_not_fit_are_refused() {
    let folder = encoder_folder();
    let clip = folder.path().join("clip.safetensors");
    write_clip(&clip, 49408, 12);
    says(
        &refusal(folder.path()),
        &[
            "clip.safetensors",
            "ViT-B/32",
            "10 numbers",
            "features of 12",
        ],
    );
    write_clip(&clip, 100, 10);
    says(&refusal(folder.path()), &["49408", "100"]);
    std::fs::remove_file(&clip).unwrap();
    says(
        &refusal(folder.path()),
        &["CLIP ViT-B/32", "latest.tar", "folder above", "Mean.npy"],
    );
    write_tensors(&clip, &[("weight".into(), vec![2])]);
    says(&refusal(folder.path()), &["clip.safetensors", "text tower"]);
}
