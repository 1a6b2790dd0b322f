//! MDM folders as their users have them: with small networks of random weights.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use lamogen::model::{AnyConfig, Denoiser, MotionWindow, SamplingMethod};
use lamogen::motion::{POSE_FEATURES, npy};
use lamogen::{Device, Error, Guidance, GuidanceVariable, LaMoGen, Motion, Preset, Request, Tag};
use safetensors::tensor::{Dtype, TensorView};
use serde_json::json;
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

/// Writes a folder with one of the golden decoders, a DistilBERT and its tokenizer.
fn decoder_folder(name: &str) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for name in ["args.json", "model000000010.pt"].map(|file| (name, file)) {
        std::fs::copy(golden(name.0).join(name.1), folder.path().join(name.1)).unwrap();
    }
    let bert = folder.path().join("distilbert-base-uncased");
    std::fs::create_dir(&bert).unwrap();
    std::fs::copy(
        golden("distilbert.safetensors"),
        bert.join("model.safetensors"),
    )
    .unwrap();
    write_tokenizer(
        &bert.join("tokenizer.json"),
        "WordPiece",
        ["[CLS]", "[SEP]"],
    );
    write_statistics(folder.path(), 0.356);
    folder
}

/// Writes a tokenizer of a few words between two special tokens.
fn write_tokenizer(path: &Path, kind: &str, ends: [&str; 2]) {
    let words = [
        "[PAD]", "[UNK]", "a", "person", "jump", "##s", "walk", ends[0], ends[1],
    ];
    let vocabulary: serde_json::Map<_, _> = { words.iter().enumerate() }
        .map(|(id, word)| (word.to_string(), json!(id)))
        .collect();
    let special = ends.map(|token| {
        let token = json!({"id": token, "ids": [vocabulary[token]], "tokens": [token]});
        (token["id"].as_str().unwrap().to_owned(), token)
    });
    let special: serde_json::Map<_, _> = special.into_iter().collect();
    let piece = |kind: &str, id: &str| json!({kind: {"id": id, "type_id": 0}});
    let single = [
        piece("SpecialToken", ends[0]),
        piece("Sequence", "A"),
        piece("SpecialToken", ends[1]),
    ];
    let mut model = json!({"type": kind, "unk_token": "[UNK]", "vocab": vocabulary});
    match kind {
        "WordPiece" => {
            model["continuing_subword_prefix"] = json!("##");
            model["max_input_chars_per_word"] = json!(100);
        }
        _ => model["merges"] = json!([]),
    }
    let tokenizer = json!({
        "version": "1.0",
        "truncation": null,
        "padding": null,
        "added_tokens": [],
        "normalizer": {"type": "BertNormalizer", "clean_text": true, "handle_chinese_chars": true, "strip_accents": null, "lowercase": true},
        "pre_tokenizer": {"type": "BertPreTokenizer"},
        "post_processor": {"type": "TemplateProcessing", "single": single, "pair": single, "special_tokens": special},
        "decoder": null,
        "model": model,
    });
    std::fs::write(path, tokenizer.to_string()).unwrap();
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
    assert_eq!(
        (model.text_scale().scale, model.preset()),
        (2.5, Preset::Fast)
    );
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

#[test]
fn a_decoder_reads_word_pieces() {
    let folder = decoder_folder("trans_dec");
    let model = load(folder.path());
    let tokens = model.tokenizer().encode("A person JUMPS, jumps").unwrap();
    // The comma is not among the words.
    assert_eq!(tokens.ids, [7, 2, 3, 4, 5, 1, 4, 5, 8]);
    assert_eq!((tokens.length, tokens.cut, tokens.own), (9, 0, 7));
    let cut = model
        .tokenizer()
        .encode("a person jumps a person jumps")
        .unwrap();
    assert_eq!((cut.ids.len(), cut.ids[8], cut.cut), (9, 8, 1));
    // Sentences of different lengths share a batch.
    let model = model.with_batch_size(2);
    let requests = ["a person jumps", "walks"].map(|prompt| Request::new(prompt).frames(40));
    let together = model.generate_all(&requests).unwrap();
    for (request, together) in requests.iter().zip(together) {
        let alone = model.generate(request).unwrap();
        let distance = alone.network.baseline.distance(&together.network.baseline);
        assert!(distance < 1e-3, "{distance}");
    }
    for variable in [GuidanceVariable::Tokens, GuidanceVariable::Modulation] {
        let guidance = Guidance {
            variable,
            ..Guidance::fast()
        };
        let request = requests[0].clone().tag(Tag::Strong).guidance(guidance);
        let generation = model.generate(&request).unwrap();
        assert_ne!(
            generation.network.baseline.joints(),
            generation.network.guided.joints()
        );
    }
}

#[test]
fn dip_continues_a_motion_to_any_length_with_other_sentences() {
    let folder = decoder_folder("dip");
    let model = load(folder.path());
    let window = MotionWindow {
        prefix: 4,
        frames: 6,
    };
    assert_eq!(model.network().window(), Some(window));
    assert_eq!(
        (model.text_scale().scale, model.default_steps(Preset::Fast)),
        (7.5, 4)
    );
    // Longer than any clip of the training, and not a whole number of windows.
    let request = Request::new("a person walks").frames(220).seed(5);
    let walk = model.generate(&request).unwrap().network.baseline;
    assert_eq!(walk.frames(), 220);
    let features = |motion: &Motion| motion.features().unwrap().to_vec();
    let jump = model
        .generate(
            &Request::new("a person walks")
                .frames(40)
                .seed(5)
                .then(Request::new("a person jumps").frames(180)),
        )
        .unwrap();
    let jump = jump.network.baseline;
    // The sentence of a window is that of its middle.
    assert_eq!(jump.frames(), 220);
    assert_eq!(features(&walk)[..42], features(&jump)[..42]);
    assert_ne!(features(&walk)[42], features(&jump)[42]);
    // The last frames of a clip are another start.
    let after = model
        .generate(&request.clone().after(&walk))
        .unwrap()
        .network
        .baseline;
    assert_ne!(features(&walk)[0], features(&after)[0]);
    let guided = request.clone().frames(40).tag(Tag::Strong);
    let guided = model.generate(&guided).unwrap();
    assert_eq!(guided.loss.len(), 4 * 40usize.div_ceil(6));
    assert_ne!(
        guided.network.baseline.joints(),
        guided.network.guided.joints()
    );

    let short = Motion::from_pose_features(features(&walk)[..3].to_vec()).unwrap();
    let error = model
        .generate(&request.after(&short))
        .unwrap_err()
        .to_string();
    says(&error, &["at least 4 frames", "found 3"]);
}

#[test]
fn a_stopped_chain_returns_the_windows_that_are_made() {
    let folder = decoder_folder("dip");
    let model = load(folder.path());
    let request = Request::new("a person walks").frames(40);
    let stopped = model.generate_with(&request, &mut |progress| match progress.done {
        10 => std::ops::ControlFlow::Break(()),
        _ => std::ops::ControlFlow::Continue(()),
    });
    let Err(Error::Stopped(stopped)) = stopped else {
        panic!("the run was stopped");
    };
    assert_eq!((stopped.index, stopped.steps), (9, 28));
    let prediction = stopped.partial.unfinished[0].prediction.as_ref();
    assert_eq!(prediction.unwrap().frames(), 18);
}

#[test]
fn models_of_whole_motions_continue_motions_and_change_sentences() {
    let folder = encoder_folder();
    let model = load(folder.path());
    let request = Request::new("a person walks").frames(40).steps(2);
    let motion = model.generate(&request).unwrap().baseline;
    let two = request
        .clone()
        .then(Request::new("a person jumps").frames(50));
    assert_eq!(model.generate(&two).unwrap().network.baseline.frames(), 90);
    let after = request.clone().tag(Tag::Strong).after(&motion);
    let after = model.generate(&after).unwrap();
    assert_eq!(after.network.guided.frames(), 40);
    assert_ne!(after.network.guided, after.network.baseline);
    let folder = decoder_folder("dip");
    let error = load(folder.path()).generate(&request.before(&motion));
    says(
        &error.unwrap_err().to_string(),
        &["lead to", "a window at a time"],
    );
}

#[test]
fn tokenizers_of_another_family_are_refused() {
    let folder = decoder_folder("trans_dec");
    let path = folder.path().join("distilbert-base-uncased/tokenizer.json");
    write_tokenizer(&path, "BPE", ["<|start|>", "<|end|>"]);
    says(
        &refusal(folder.path()),
        &[
            "tokenizer.json",
            "WordPiece",
            "[CLS]",
            "distilbert-base-uncased",
        ],
    );
    std::fs::remove_file(&path).unwrap();
    says(
        &refusal(folder.path()),
        &["distilbert-base-uncased/tokenizer.json"],
    );
    std::fs::remove_dir_all(path.parent().unwrap()).unwrap();
    says(
        &refusal(folder.path()),
        &["distilbert-base-uncased/model.safetensors", "folder above"],
    );
}

#[test]
fn the_command_generates_and_describes() {
    let folder = decoder_folder("dip");
    let run = |arguments: &[&str]| {
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_lamogen"))
            .args(arguments)
            .current_dir(folder.path())
            .output()
            .unwrap();
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        assert!(output.status.success(), "{}", text(&output.stderr));
        text(&output.stdout)
    };
    let info = run(&["--json", "model", "info", "."]);
    let info: serde_json::Value = serde_json::from_str(&info).unwrap();
    assert_eq!(info["config"]["arch"], "trans_dec");
    assert_eq!(
        (&info["text_scale"], &info["steps"]),
        (&json!(7.5), &json!(4))
    );
    let sentence = [
        "a person walks",
        "--then",
        "a person jumps",
        "--seconds",
        "9",
    ];
    let generate = [
        &["generate"],
        &sentence[..],
        &["--model", ".", "--out", "walk.npy"],
    ];
    run(&generate.concat());
    let joints = npy::read(folder.path().join("walk.npy")).unwrap();
    assert_eq!(joints.shape, [240, 22, 3]);
}
